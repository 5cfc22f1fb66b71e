# SPDX-License-Identifier: GPL-3.0-or-later
"""Bone at 200 HU, fine, without small components."""

import bpy

bpy.context.scene.ctmc.show_preset(threshold=200.0, min_part_mm3=50.0, reduction=0.5)
