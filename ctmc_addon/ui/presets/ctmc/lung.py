"""Airways and lungs as hollows."""

import bpy

settings = bpy.context.scene.ctmc
settings.threshold = -500.0
settings.label = 1
settings.stride = (2, 2, 1)
settings.alpha = 1.0
settings.topology = "classic"
settings.soften_mm = 0.0
settings.close_border = False
settings.keep_parts = 0
settings.min_part_mm3 = 1000.0
settings.normals = "gradient"
settings.simplifier = "builtin"
settings.reduction = 0.8
settings.target_faces = 10000
settings.max_error_mm = 0.5
settings.use_threshold = True
settings.use_label = False
settings.use_reduction = True
settings.use_target_faces = False
settings.use_max_error_mm = False
