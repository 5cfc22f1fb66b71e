# SPDX-License-Identifier: GPL-3.0-or-later
"""Lungs, between two limits."""

import bpy

bpy.context.scene.ctmc.show_preset(threshold=-950.0, upper=-600.0, stride=(2, 2, 1), min_part_mm3=1000.0, reduction=0.8)
