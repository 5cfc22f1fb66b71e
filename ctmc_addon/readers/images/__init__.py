# SPDX-License-Identifier: GPL-3.0-or-later
"""Read image slices: PNG, JPEG, BMP and TIFF."""
