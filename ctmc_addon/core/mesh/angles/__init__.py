# SPDX-License-Identifier: GPL-3.0-or-later
"""The angles of triangles: how good a surface is for simulation, and the alpha that makes it good enough."""
