# SPDX-License-Identifier: GPL-3.0-or-later
"""DICOM: headers, series, geometry and pixels."""
