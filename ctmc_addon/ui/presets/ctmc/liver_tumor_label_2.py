# SPDX-License-Identifier: GPL-3.0-or-later
"""Label 2 of a LiTS segmentation, smoothed, as the paper's tumors."""

import bpy

bpy.context.scene.ctmc.show_preset(label=2, stride=(2, 2, 1), reduction=0.9)
