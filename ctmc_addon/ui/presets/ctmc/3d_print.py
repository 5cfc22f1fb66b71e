# SPDX-License-Identifier: GPL-3.0-or-later
"""Bone as one closed body, true to a tenth of a millimeter."""

import bpy

bpy.context.scene.ctmc.show_preset(threshold=200.0, close_border=True, keep_parts=1, max_error_mm=0.1)
