# SPDX-License-Identifier: GPL-3.0-or-later
"""Read labels: masks, outlines, several files as one label map, names and colors."""
