# SPDX-License-Identifier: GPL-3.0-or-later
"""Show previews and drawings in the 3D viewport, and follow the mouse there."""
