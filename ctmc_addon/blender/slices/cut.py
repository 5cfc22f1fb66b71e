# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces cut open at a slice, by a modifier that stays live; the cap carries the slice's picture.

What lies beyond the slice towards the head, the front or the right is taken away, by Blender's Boolean modifier with a
box that hangs on the slice: moving the slice moves the cut.
"""

from __future__ import annotations

from collections.abc import Iterable

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core import MeshError
from .plane import is_slice

CUT = "CTMC Cut"
REACH = 4.0  # how deep the box is, in diagonals of the slice


def require_cuttable(obj: bpy.types.Object) -> None:
    """Raise `MeshError` for an object that cannot be cut open."""
    if obj.type != "MESH" or is_slice(obj):
        raise MeshError(f"{obj.name} is not a surface; choose surfaces")


def cut_at_slice(scene: bpy.types.Scene, surfaces: Iterable[bpy.types.Object], plane: bpy.types.Object) -> None:
    """Cut surfaces at a slice that `add_slice` has made.

    Raises
    ------
    MeshError
        If one of them is not a surface.
    """
    surfaces = list(surfaces)
    for obj in surfaces:
        require_cuttable(obj)
    box = box_of(scene, plane)
    for obj in surfaces:
        cut = obj.modifiers.new(CUT, "BOOLEAN")
        cut.operation, cut.object = "DIFFERENCE", box
        solvers = cut.bl_rna.properties["solver"].enum_items.keys()
        cut.solver = next(name for name in ("MANIFOLD", "EXACT") if name in solvers)  # the first since 4.5
        cut.material_mode = "TRANSFER"


def box_of(scene: bpy.types.Scene, plane: bpy.types.Object) -> bpy.types.Object:
    """The box that hangs on a slice, made where there is none."""
    name = f"{plane.name} {CUT}"
    for child in plane.children:
        if child.name.startswith(name):
            return child
    mesh = bpy.data.meshes.new(name)
    corners = np.array([corner.co for corner in plane.data.vertices], float)
    vertices, faces = box(corners)
    mesh.from_pydata(vertices.tolist(), [], faces)
    mesh.materials.append(plane.data.materials[0])
    obj = bpy.data.objects.new(name, mesh)
    obj.parent = plane
    obj.display_type, obj.hide_render, obj.hide_viewport = "BOUNDS", True, True
    scene.collection.objects.link(obj)
    return obj


def box(corners: NDArray[np.float64]) -> tuple[NDArray[np.float64], list[tuple[int, ...]]]:
    """A box on one side of a slice whose `corners`, (4, 3), surround the origin: vertices and faces, pointing outwards.

    The side is that towards the head, the front or the right: the one to which the normal's largest part is positive.
    """
    across, down = corners[1] - corners[0], corners[3] - corners[0]
    normal = np.cross(across, down)
    normal /= np.linalg.norm(normal)
    turned = normal[np.abs(normal).argmax()] < 0
    if turned:
        normal = -normal
    reach = REACH * float(np.linalg.norm(corners[2] - corners[0]))
    base = corners * REACH  # beyond surfaces that reach out of the slice
    vertices = np.concatenate([base, base + reach * normal])
    # Counter-clockwise seen from outside if the corners run so seen against the normal.
    faces: list[tuple[int, ...]] = [
        (3, 2, 1, 0),
        (4, 5, 6, 7),
        *((n, (n + 1) % 4, 4 + (n + 1) % 4, 4 + n) for n in range(4)),
    ]
    return vertices, [face[::-1] for face in faces] if turned else faces
