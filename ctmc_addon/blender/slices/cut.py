# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut surfaces open at a slice with a live modifier; the cap shows the slice's picture.

Everything beyond the slice towards the head, the front or the right is removed by Geometry Nodes (cut_nodes.py) that
ask an arrow on the slice: moving the slice moves the cut, and turning the arrow turns it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ...core import MeshError
from ...core.volume import slice_normal
from ..scene.ct_box import link_beside_ct
from .cut_nodes import cut_nodes
from .cuttable import require_cuttable
from .material import picture_coordinates
from .plane import SLICE, is_slice

CUT = "CTMC Cut"
IN_PLANE = 1e-4  # Points nearer to a slice's plane than this share of its diagonal lie in it.
ARROW = 0.1  # Length of the arrow, as a share of the slice's diagonal.


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
    """Return the node group that cuts at a slice, with its arrow; make it if needed."""
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


def cuts_of(obj: bpy.types.Object | None) -> list[bpy.types.NodeTree]:
    """Return the node groups that cut a surface, or cut at a slice, in the order in which they were made."""
    if obj is None:
        return []
    if is_slice(obj):
        return [tree for tree in bpy.data.node_groups if tree.get(CUT) == obj]
    groups = [modifier.node_group for modifier in obj.modifiers if modifier.type == "NODES"]
    return [tree for tree in groups if tree is not None and is_slice(tree.get(CUT))]


def flip(cut: bpy.types.NodeTree) -> None:
    """Make a cut keep the other half, in every surface that it cuts."""
    plane = cut[CUT]
    arrows = [node.inputs["Object"].default_value for node in cut.nodes if node.type == "OBJECT_INFO"]
    arrow = next((obj for obj in arrows if obj is not None and obj != plane), None)
    if arrow is None:
        raise MeshError(f"the arrow of {cut.name} was deleted; remove the modifier {CUT} and cut again")
    arrow.matrix_local = arrow.matrix_local @ Matrix.Rotation(math.pi, 4, "X")


def is_cut_in(scene: bpy.types.Scene, corners: NDArray[np.float64]) -> bool:
    """Return whether a visible surface is cut open in the plane of a slice.

    Parameters
    ----------
    scene : bpy.types.Scene
    corners : (4, 3) float64
        Corners of the slice, world space.
    """
    normal = slice_normal(corners)
    reach = float(np.linalg.norm(corners[2] - corners[0]))
    for cut in {cut for obj in scene.objects if obj.type == "MESH" and obj.visible_get() for cut in cuts_of(obj)}:
        plane = cut[CUT]
        cut_corners = np.array([plane.matrix_world @ corner.co for corner in plane.data.vertices], np.float64)
        if np.abs(((cut_corners - corners[0]) * normal).sum(axis=1)).max() < IN_PLANE * reach:
            return True
    return False


def frame(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a (4, 4) rotation whose z is normal to a slice, pointing to the head, the front or the right.

    z points to the side where the normal's largest component is positive. The slice has the corners (4, 3).

    Examples
    --------
    >>> frame(np.array([[-1, -2, 0], [-1, 2, 0], [1, 2, 0], [1, -2, 0.0]]))[:3, 2].tolist()
    [0.0, 0.0, 1.0]
    """
    across, normal = corners[1] - corners[0], slice_normal(corners)
    normal *= np.sign(normal[np.abs(normal).argmax()])
    across = across / np.linalg.norm(across)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([across, np.cross(normal, across), normal], axis=1) + 0.0
    return matrix
