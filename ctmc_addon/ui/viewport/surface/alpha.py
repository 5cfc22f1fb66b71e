# SPDX-License-Identifier: GPL-3.0-or-later
"""Move the selected surfaces at once with the slider of alpha, through their shape keys."""

from __future__ import annotations

import bpy

from ....blender.surface import refresh_normals, set_alpha
from ...state.results import surfaces
from . import preview


def move(scene: bpy.types.Scene, alpha: float) -> None:
    """Move the selected surfaces of the scene, and the preview."""
    if bpy.context.scene == scene:
        for obj in surfaces.selected_surfaces(bpy.context):
            if obj.library is None and obj.override_library is None:
                set_alpha(obj, alpha)
    preview.move(alpha)


def settle(scene: bpy.types.Scene) -> None:
    """Set the shading once the slider is idle, as Blender before 4.5 needs it."""
    for obj in surfaces.selected_surfaces(bpy.context) if bpy.context.scene == scene else ():
        if obj.library is None and obj.mode == "OBJECT":
            refresh_normals(obj)
