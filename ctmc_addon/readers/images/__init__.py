# SPDX-License-Identifier: GPL-3.0-or-later
"""Image slices: PNG, JPEG, BMP and TIFF."""
