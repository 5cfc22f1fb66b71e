# SPDX-License-Identifier: GPL-3.0-or-later
"""The body's surface, closed at the borders of the stack."""

import bpy

bpy.context.scene.ctmc.show_preset(threshold=-300.0, stride=(2, 2, 1), close_border=True, keep_parts=1, reduction=0.9)
