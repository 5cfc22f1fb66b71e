# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the series of a DICOM folder, and stack its slices."""
