# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces cut open at a slice, by a modifier that stays live; the cap carries the slice's picture.

What lies beyond the slice towards the head, the front or the right is taken away, by Geometry Nodes (cut_nodes.py) that
ask an arrow on the slice: moving the slice moves the cut, and turning the arrow turns it.
"""

from __future__ import annotations

from collections.abc import Iterable

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ...core import MeshError
from ..ct_box import link_beside_ct
from .cut_nodes import cut_nodes
from .material import picture_coordinates
from .plane import SLICE, is_slice

CUT = "CTMC Cut"
ARROW = 0.1  # length of the arrow, of the slice's diagonal


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
    nodes = nodes_of(scene, plane)
    for obj in surfaces:
        obj.modifiers.new(CUT, "NODES").node_group = nodes


def nodes_of(scene: bpy.types.Scene, plane: bpy.types.Object) -> bpy.types.NodeTree:
    """Return the node group that cuts at a slice, with its arrow, made where there is none."""
    for tree in bpy.data.node_groups:
        if tree.get(CUT) == plane:
            return tree
    corners = np.array([corner.co for corner in plane.data.vertices], float)  # (4, 3), around the origin
    diagonal = float(np.linalg.norm(corners[2] - corners[0]))
    name = f"{plane.name} {CUT}"
    arrow = bpy.data.objects.new(name, None)
    arrow.empty_display_type, arrow.empty_display_size = "SINGLE_ARROW", ARROW * diagonal
    arrow.parent, arrow.matrix_local = plane, Matrix(frame(corners).tolist())
    link_beside_ct(scene, arrow, plane[SLICE])
    tree = cut_nodes(name, arrow, plane, picture_coordinates(corners), diagonal)
    tree[CUT] = plane
    return tree


def frame(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """A (4, 4) rotation whose z stands on a slice with these corners, (4, 3), towards the head, the front or the right.

    That is the side to which the normal's largest part is positive.

    Examples
    --------
    >>> frame(np.array([[-1, -2, 0], [-1, 2, 0], [1, 2, 0], [1, -2, 0.0]]))[:3, 2].tolist()
    [0.0, 0.0, 1.0]
    """
    across, down = corners[1] - corners[0], corners[3] - corners[0]
    normal = np.cross(across, down)
    normal *= np.sign(normal[np.abs(normal).argmax()]) / np.linalg.norm(normal)
    across = across / np.linalg.norm(across)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([across, np.cross(normal, across), normal], axis=1) + 0.0
    return matrix
