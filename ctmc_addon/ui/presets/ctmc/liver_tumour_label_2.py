"""Label 2 of a LiTS segmentation, smoothed, as the paper's tumours."""

import bpy

bpy.context.scene.ctmc.show_preset(label=2, stride=(2, 2, 1), alpha=0.5, soften_mm=1.0, reduction=0.9)
