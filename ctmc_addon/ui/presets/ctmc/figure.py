# SPDX-License-Identifier: GPL-3.0-or-later
"""Coarse voxels, midway alpha, flat triangles: what the paper's figures show."""

import bpy

bpy.context.scene.ctmc.show_preset(
    threshold=200.0, stride=(3, 3, 1), alpha=0.5, min_part_mm3=50.0, normals="mesh", simplifier="none"
)
