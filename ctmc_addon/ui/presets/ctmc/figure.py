"""Coarse voxels, midway alpha, flat triangles: what the paper's figures show."""

import bpy

settings = bpy.context.scene.ctmc
settings.threshold = 200.0
settings.label = 1
settings.stride = (3, 3, 1)
settings.alpha = 0.5
settings.topology = "classic"
settings.soften_mm = 0.0
settings.close_border = False
settings.keep_parts = 0
settings.min_part_mm3 = 50.0
settings.normals = "mesh"
settings.simplifier = "none"
settings.reduction = 0.9
settings.target_faces = 10000
settings.max_error_mm = 0.5
settings.use_threshold = True
settings.use_label = False
settings.use_reduction = False
settings.use_target_faces = False
settings.use_max_error_mm = False
