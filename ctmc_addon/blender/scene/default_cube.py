# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the cube that Blender puts into every new file."""

from __future__ import annotations

import bpy
import numpy as np

TYPES = ["CAMERA", "LIGHT", "MESH"]  # Types of the objects of a new file.


def untouched_cube(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Return the cube of a new, unchanged file; None in any other file."""
    if bpy.data.filepath or sorted(obj.type for obj in scene.objects) != TYPES:
        return None
    cube = next(obj for obj in scene.objects if obj.type == "MESH")
    corners = np.array([vertex.co for vertex in cube.data.vertices])
    is_cube = corners.shape == (8, 3) and len(cube.data.polygons) == 6 and bool((np.abs(corners) == 1.0).all())
    is_plain = cube.matrix_world.is_identity and not cube.modifiers and not cube.animation_data and not cube.keys()
    return cube if is_cube and is_plain and cube.data.shape_keys is None else None


def put_out_of_view(obj: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """Hide an object in viewports by its eye, and in renders."""
    for layer in scene.view_layers:
        obj.hide_set(True, view_layer=layer)
    obj.hide_render = True
