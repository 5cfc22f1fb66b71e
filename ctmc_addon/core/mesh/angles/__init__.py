# SPDX-License-Identifier: GPL-3.0-or-later
"""The angles of triangles, which decide whether a surface suits simulation, and the alpha that improves them."""
