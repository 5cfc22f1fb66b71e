# SPDX-License-Identifier: GPL-3.0-or-later
"""Show a large surface in the viewport with a share of its triangles: the display Light.

Two attributes of the mesh say which triangles are shown and where their corners go, and a Geometry Nodes modifier, the
first of the object and off in renders, shows them. So the light surface follows alpha, colors and materials, is copied,
undone and deleted with the mesh, and is never a second object. A mesh with another number of vertices, as after an
edit, is shown in full.
"""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core import Steps, finish
from ...core.mesh import light_faces_steps
from ..slices.node_builder import Nodes
from ..sockets import input_of, output_of
from . import mesh_data as meshes

ABOVE = 1_000_000
"""Surfaces with more triangles are shown light."""
GOAL = 300_000
"""Triangles of a light surface, about."""
LIGHT = "CTMC Light"
"""Name of the modifier and of its node group."""
COUNTS = "ctmc_light"
"""Custom property of the mesh: its vertices, and the triangles shown. The node group has it too."""
SHOWN, TARGET = ".ctmc_light_shown", ".ctmc_light_target"
"""Attributes of the mesh: on a shown triangle the number of vertices; for a vertex, the one that it moves to."""
SAME = 1e-5  # Vertices nearer than this, Blender units, become one: those that move to the same place.


def is_large(faces: int) -> bool:
    """Return whether a surface with this many triangles is shown with fewer."""
    return faces > ABOVE


Choice = tuple[NDArray[np.int64], NDArray[np.int32]]
"""Numbers of the triangles that Light shows, and the vertex that each vertex moves to."""


def choice_steps(
    vertices: NDArray[np.float32], faces: NDArray[np.int32], normals: NDArray[np.float32] | None = None
) -> Steps[Choice]:
    """Choose the triangles that Light shows.

    Parameters
    ----------
    vertices : (V, 3) float32
        Positions as they are seen, in any unit.
    faces : (F, 3) int32
    normals : (V, 3) float32, optional
        By default those of the faces.
    """
    return (yield from light_faces_steps(vertices, faces, GOAL, normals))


def write(mesh: bpy.types.Mesh, choice: Choice) -> None:
    """Write the choice of triangles to their mesh; nothing else of it changes."""
    kept, target = choice
    shown = np.zeros(len(mesh.polygons), np.int32)
    shown[kept] = len(mesh.vertices)
    for name, domain, values in ((SHOWN, "FACE", shown), (TARGET, "POINT", target)):
        attribute = mesh.attributes.get(name) or mesh.attributes.new(name, "INT", domain)
        attribute.data.foreach_set("value", values)
    mesh[COUNTS] = [len(mesh.vertices), len(kept)]


def prepare(obj: bpy.types.Object, vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> None:
    """Show a surface light that was not prepared for it."""
    write(obj.data, finish(choice_steps(vertices, faces)))
    fit_modifier(obj)


def is_prepared(obj: bpy.types.Object) -> bool:
    """Return whether a mesh has the triangles of Light, chosen for as many vertices as it has now."""
    counts = obj.data.get(COUNTS)
    return counts is not None and counts[0] == len(obj.data.vertices)


def light_modifier(obj: bpy.types.Object) -> bpy.types.NodesModifier | None:
    """Return the modifier that shows a surface light, or None."""
    return next((modifier for modifier in obj.modifiers if _is_light(modifier)), None)


def _is_light(modifier: bpy.types.Modifier) -> bool:
    return modifier.type == "NODES" and modifier.node_group is not None and COUNTS in modifier.node_group


def other_modifiers(obj: bpy.types.Object) -> list[bpy.types.Modifier]:
    """Return the modifiers that change a surface, without that of Light."""
    return [modifier for modifier in obj.modifiers if not _is_light(modifier)]


def shown_faces(obj: bpy.types.Object) -> int | None:
    """Return the triangles that Light shows of a surface; None while it is shown in full."""
    modifier = light_modifier(obj)
    if modifier is None or not modifier.show_viewport or not is_prepared(obj):
        return None
    return int(obj.data[COUNTS][1])


def fit_modifier(obj: bpy.types.Object) -> None:
    """Add the modifier to an object whose mesh is prepared for it, and remove it from any other."""
    modifier = light_modifier(obj)
    if not is_prepared(obj):
        if modifier is not None:
            obj.modifiers.remove(modifier)
        _forget(obj.data)
        return
    if modifier is None:
        modifier = obj.modifiers.new(LIGHT, "NODES")
        modifier.node_group = _nodes()
        obj.modifiers.move(len(obj.modifiers) - 1, 0)
        modifier = obj.modifiers[0]
        modifier.show_render = modifier.show_in_editmode = modifier.show_expanded = False


def _forget(mesh: bpy.types.Mesh) -> None:
    """Remove the attributes of Light from a mesh."""
    for name in (SHOWN, TARGET):
        if name in mesh.attributes:
            mesh.attributes.remove(mesh.attributes[name])
    mesh.pop(COUNTS, None)


def _nodes() -> bpy.types.NodeTree:
    """Return the node group of this file; make it if needed."""
    for tree in bpy.data.node_groups:
        if COUNTS in tree and tree.library is None:
            return tree
    return light_nodes()


def light_nodes() -> bpy.types.NodeTree:
    """Return a new node group that shows the prepared triangles, and a mesh that is not prepared as it is."""
    tree = bpy.data.node_groups.new(LIGHT, "GeometryNodeTree")
    tree.is_modifier, tree[COUNTS] = True, 1
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    nodes = Nodes(tree)
    surface = output_of(nodes.add("NodeGroupInput"), "Geometry")
    shown, target = (
        nodes.of("GeometryNodeInputNamedAttribute", "Attribute", {"Name": name}, data_type="INT")
        for name in (SHOWN, TARGET)
    )
    vertices = nodes.of("GeometryNodeAttributeDomainSize", "Point Count", {"Geometry": surface})
    numbers = {"A": shown, "B": vertices}  # By name: Blender 5.2 identifies them in another way than 5.0.
    is_shown = nodes.of("FunctionNodeCompare", "Result", numbers, data_type="INT", operation="EQUAL")
    kept, _ = nodes.separate(surface, is_shown, "FACE")
    sample = {"Geometry": surface, "Value": nodes.of("GeometryNodeInputPosition", "Position"), "Index": target}
    kinds = {"data_type": "FLOAT_VECTOR", "domain": "POINT"}
    moved = nodes.moved(kept, nodes.of("GeometryNodeSampleIndex", "Value", sample, **kinds))
    if not meshes.FREE_NORMALS:  # Blender stores angles against the normals of the full mesh.
        moved = nodes.of("GeometryNodeRemoveAttribute", "Geometry", {"Name": "custom_normal", "Geometry": moved})
    merged = nodes.of("GeometryNodeMergeByDistance", "Geometry", {"Distance": SAME, "Geometry": moved})
    count = nodes.of("GeometryNodeAttributeDomainSize", "Face Count", {"Geometry": merged})
    ways = {"Switch": nodes.compare("GREATER_THAN", count, 0.5), "False": surface, "True": merged}
    light = nodes.of("GeometryNodeSwitch", "Output", ways, input_type="GEOMETRY")
    nodes.link(light, input_of(nodes.add("NodeGroupOutput"), "Geometry"))
    nodes.arrange()
    return tree
