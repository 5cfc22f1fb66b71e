# SPDX-License-Identifier: GPL-3.0-or-later
"""Remove the inside or outside of a box from surfaces with a live modifier.

Moving, turning or scaling the box changes the cut; `remove_cut_away` restores the surface.

The modifier is a node group with Blender's Mesh Boolean. The Boolean modifier would keep the normals that the surface
was given; the cut has none there, and 5.0 would draw it black.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.volume import determinant
from ..scene.ct_box import link_beside_ct
from ..sockets import input_of, output_of
from ..surface.mesh_data import NORMALS
from .cuttable import BOX, is_cut_box, require_cuttable
from .node_builder import Nodes

CUT_AWAY = "CTMC Cut Away"
OUTSIDE = "Outside"  # Label of the node that chooses which side is removed.
MARGIN = 0.01  # The first box extends this share of the diagonal beyond the surfaces, so that no faces coincide.
# Corner n has the upper end along x, y, z where bit 0, 1, 2 of n is set; the faces point outwards.
FACES = ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6))


def near_half(surfaces: Iterable[bpy.types.Object], towards: Sequence[float]) -> NDArray[np.float64]:
    """Return the box around the half of surfaces that is nearest to a viewer, (8, 3) world space.

    Parameters
    ----------
    towards : (x, y, z) float
        To the viewer; of the world's axes, the one that is nearest to it is halved.
    """
    points = np.array([obj.matrix_world @ type(obj.location)(corner) for obj in surfaces for corner in obj.bound_box])
    low, high = points.min(axis=0), points.max(axis=0)
    margin = MARGIN * float(np.linalg.norm(high - low))
    ends = np.array([low - margin, high + margin])  # (2, 3)
    axis = int(np.abs(towards).argmax())
    ends[0 if towards[axis] > 0 else 1, axis] = (low[axis] + high[axis]) / 2
    return np.array([[ends[corner >> along & 1, along] for along in range(3)] for corner in range(8)])


def add_cut_box(scene: bpy.types.Scene, corners: NDArray[np.float64], fingerprint: str = "") -> bpy.types.Object:
    """Return a new box that is drawn as lines and not rendered.

    Parameters
    ----------
    corners : (8, 3) float64
        World space, as `region_corners` orders them.
    fingerprint : str
        Fingerprint of the CT whose collection takes the box.
    """
    middle = corners.mean(axis=0)
    # In a mirrored space the faces would point inwards.
    mirrored = determinant(corners[[1, 2, 4]] - corners[0]) < 0
    mesh = bpy.data.meshes.new(CUT_AWAY)
    mesh.from_pydata((corners - middle).tolist(), [], [face[::-1] if mirrored else face for face in FACES])
    mesh.attributes.new(BOX, "BOOLEAN", "FACE").data.foreach_set("value", [True] * len(FACES))
    box = bpy.data.objects.new(CUT_AWAY, mesh)
    box.location = middle.tolist()
    box.display_type, box.hide_render, box[BOX] = "WIRE", True, True
    link_beside_ct(scene, box, fingerprint)
    return box


def cut_away(surfaces: Iterable[bpy.types.Object], box: bpy.types.Object) -> None:
    """Remove the inside of a box from surfaces; one that it cuts already stays as it is.

    Raises
    ------
    MeshError
        If one of them is not a surface.
    """
    surfaces = list(surfaces)
    for obj in surfaces:
        require_cuttable(obj)
    tree = nodes_of(box) or box_nodes(box)
    for obj in surfaces:
        if not any(modifier.node_group == tree for modifier in _cuts_away(obj)):
            obj.modifiers.new(CUT_AWAY, "NODES").node_group = tree


def nodes_of(box: bpy.types.Object) -> bpy.types.NodeTree | None:
    """Return the node group that cuts with a box, or None."""
    return next((tree for tree in bpy.data.node_groups if tree.get(CUT_AWAY) == box), None)


def box_nodes(box: bpy.types.Object) -> bpy.types.NodeTree:
    """Return a new node group that takes away what lies inside a box."""
    tree = bpy.data.node_groups.new(box.name, "GeometryNodeTree")
    tree.is_modifier = True
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    nodes = Nodes(tree)
    surface = output_of(nodes.add("NodeGroupInput"), "Geometry")
    box_mesh = nodes.of("GeometryNodeObjectInfo", "Geometry", {"Object": box}, transform_space="RELATIVE")
    outside = nodes.add("GeometryNodeSwitch", input_type="GEOMETRY", label=OUTSIDE)
    nodes.link(_boolean_of(nodes, "DIFFERENCE", surface, box_mesh), input_of(outside, "False"))
    nodes.link(_boolean_of(nodes, "INTERSECT", surface, box_mesh), input_of(outside, "True"))
    # Versions differ in the material that the faces of the box become.
    of_box = nodes.of("GeometryNodeInputNamedAttribute", "Attribute", {"Name": BOX}, data_type="BOOLEAN")
    faces = {"Geometry": output_of(outside, "Output"), "Selection": of_box, "Material Index": 0}
    kept = nodes.of("GeometryNodeSetMaterialIndex", "Geometry", faces)
    for name in (NORMALS, BOX):
        kept = nodes.of("GeometryNodeRemoveAttribute", "Geometry", {"Name": name, "Geometry": kept})
    # Without its box the surface is whole, whichever side was taken away.
    count = nodes.of("GeometryNodeAttributeDomainSize", "Face Count", {"Geometry": box_mesh})
    is_there = nodes.compare("GREATER_THAN", count, 0.5)
    ways = {"Switch": is_there, "False": surface, "True": kept}
    shown = nodes.of("GeometryNodeSwitch", "Output", ways, input_type="GEOMETRY")
    nodes.link(shown, input_of(nodes.add("NodeGroupOutput"), "Geometry"))
    nodes.arrange()
    tree[CUT_AWAY] = box
    return tree


def _boolean_of(nodes: Nodes, operation: str, surface: Any, box_mesh: Any) -> Any:
    """Return the remaining surface, and the part of the box inside it."""
    # The other solvers leave holes or refuse open surfaces, which Hole Tolerant caps.
    node = nodes.add("GeometryNodeMeshBoolean", operation=operation, solver="EXACT")
    nodes.link(True, input_of(node, "Hole Tolerant"))
    nodes.link(surface, input_of(node, "Mesh 1" if operation == "DIFFERENCE" else "Mesh 2"))
    nodes.link(box_mesh, input_of(node, "Mesh 2"))  # which takes several geometries where INTERSECT has no other
    return output_of(node, "Mesh")


def _cuts_away(obj: bpy.types.Object) -> list[bpy.types.NodesModifier]:
    """Return the modifiers of an object that cut with a box, in order."""
    cuts = [modifier for modifier in obj.modifiers if modifier.type == "NODES" and modifier.node_group is not None]
    return [cut for cut in cuts if is_cut_box(cut.node_group.get(CUT_AWAY))]


def cut_box_of(obj: bpy.types.Object | None) -> bpy.types.Object | None:
    """Return the object if it is a box, else the last box that cuts it, or None."""
    if obj is None or is_cut_box(obj):
        return obj
    return next((cut.node_group[CUT_AWAY] for cut in reversed(_cuts_away(obj))), None)


def flip_cut_away(box: bpy.types.Object) -> None:
    """Remove the outside of a box instead of the inside, or back, for every surface."""
    tree = nodes_of(box)
    for node in tree.nodes if tree is not None else ():
        if node.label == OUTSIDE:
            takes_outside = input_of(node, "Switch")
            takes_outside.default_value = not takes_outside.default_value


def remove_cut_away(box: bpy.types.Object) -> None:
    """Remove a box, and restore every surface that it cuts."""
    tree = nodes_of(box)
    for obj in bpy.data.objects:
        for cut in _cuts_away(obj):
            if cut.node_group == tree:
                obj.modifiers.remove(cut)
    if tree is not None:
        bpy.data.node_groups.remove(tree)
    bpy.data.meshes.remove(box.data)  # This removes the object too.
