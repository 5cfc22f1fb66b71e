"""Bone as one closed body, true to a tenth of a millimetre."""

import bpy

settings = bpy.context.scene.ctmc
settings.threshold = 200.0
settings.label = 1
settings.stride = (1, 1, 1)
settings.alpha = 1.0
settings.topology = "classic"
settings.soften_mm = 0.0
settings.close_border = True
settings.keep_parts = 1
settings.min_part_mm3 = 0.0
settings.normals = "gradient"
settings.simplifier = "builtin"
settings.reduction = 0.9
settings.target_faces = 10000
settings.max_error_mm = 0.1
settings.use_threshold = True
settings.use_label = False
settings.use_reduction = False
settings.use_target_faces = False
settings.use_max_error_mm = True
