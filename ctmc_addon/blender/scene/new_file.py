# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the cube, the light and the camera that Blender puts into every new file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np

TYPES = ["CAMERA", "LIGHT", "MESH"]  # Types of the objects of a new file.
LIGHT, LIGHT_TURN = (4.076, 1.005, 5.904), (0.6503, 0.0552, 1.8664)  # Position and rotation of the light, radians.
LIGHT_WATTS = 1000.0
CAMERA, CAMERA_TURN = (7.359, -6.926, 4.958), (1.1093, 0.0, 0.8149)  # Position and rotation of the camera.
CAMERA_MM = 50.0  # Its focal length.
GRAY = (0.8, 0.8, 0.8, 1.0)  # Color of the cube's material.


def untouched_cube(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Return the cube of a new, unchanged file; None in any other file."""
    if bpy.data.filepath or sorted(obj.type for obj in scene.objects) != TYPES:
        return None
    cube = next(obj for obj in scene.objects if obj.type == "MESH")
    corners = np.array([vertex.co for vertex in cube.data.vertices])
    is_cube = corners.shape == (8, 3) and len(cube.data.polygons) == 6 and bool((np.abs(corners) == 1.0).all())
    is_bare = not (cube.modifiers or cube.constraints or cube.vertex_groups or cube.children or cube.keys())
    is_still = cube.matrix_world.is_identity and cube.parent is None and cube.animation_data is None
    is_own = cube.data.shape_keys is None and cube.data.users == 1 and _is_plain(cube.data)
    return cube if is_cube and is_bare and is_still and is_own else None


def _is_plain(mesh: bpy.types.Mesh) -> bool:
    """Return whether a mesh has Blender's first material, unchanged, or none."""
    for material in mesh.materials:
        tree = None if material is None else material.node_tree  # None without nodes, before Blender 5.0.
        shaders = [node for node in tree.nodes if node.type == "BSDF_PRINCIPLED"] if tree is not None else []
        colors = [node.inputs["Base Color"].default_value for node in shaders]
        if len(colors) != 1 or not np.allclose([*colors, material.diffuse_color], GRAY):
            return False
    return True


def remove_cube(cube: bpy.types.Object) -> None:
    """Remove the cube of a new file with its mesh."""
    mesh: Any = cube.data
    bpy.data.objects.remove(cube)
    bpy.data.meshes.remove(mesh)


def is_first_light(obj: bpy.types.Object) -> bool:
    """Return whether an object is the light of a new file, unchanged: it knows nothing of the patient's size."""
    light: Any = obj.data
    same = obj.type == "LIGHT" and light.type == "POINT" and light.energy == LIGHT_WATTS
    return same and _stands(obj, LIGHT, LIGHT_TURN)


def is_first_camera(obj: bpy.types.Object) -> bool:
    """Return whether an object is the camera of a new file, unchanged: it looks past the patient."""
    camera: Any = obj.data
    same = obj.type == "CAMERA" and camera.type == "PERSP" and abs(camera.lens - CAMERA_MM) < 1e-3
    return same and _stands(obj, CAMERA, CAMERA_TURN)


def _stands(obj: bpy.types.Object, location: Sequence[float], turn: Sequence[float]) -> bool:
    """Return whether an object has this position and rotation, and nothing else moves it."""
    is_there = np.allclose([*obj.location, *obj.rotation_euler], [*location, *turn], atol=1e-3)
    return bool(is_there) and obj.parent is None and not obj.constraints and obj.rotation_mode == "XYZ"
