"""Label 2 of a LiTS segmentation, softened, as the paper's tumours."""

import bpy

settings = bpy.context.scene.ctmc
settings.threshold = 200.0
settings.label = 2
settings.stride = (2, 2, 1)
settings.alpha = 0.5
settings.topology = "classic"
settings.soften_mm = 1.0
settings.close_border = False
settings.keep_parts = 0
settings.min_part_mm3 = 0.0
settings.normals = "gradient"
settings.simplifier = "builtin"
settings.reduction = 0.9
settings.target_faces = 10000
settings.max_error_mm = 0.5
settings.use_threshold = False
settings.use_label = True
settings.use_reduction = True
settings.use_target_faces = False
settings.use_max_error_mm = False
