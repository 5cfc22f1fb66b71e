# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps: quantities on the vertices of a surface, such as the thickness of a wall."""
