# SPDX-License-Identifier: GPL-3.0-or-later
"""Read DICOM files that hold labels: segmentations and structure sets."""
