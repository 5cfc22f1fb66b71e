# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels: masks, outlines, several files as one label map, names and colors."""
