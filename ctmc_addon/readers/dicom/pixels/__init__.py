# SPDX-License-Identifier: GPL-3.0-or-later
"""Read and decode the pixels of DICOM frames."""
