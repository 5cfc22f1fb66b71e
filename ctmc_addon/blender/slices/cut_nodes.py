# SPDX-License-Identifier: GPL-3.0-or-later
r"""Build the Geometry Nodes that cut a surface at a plane and cap it.

Every triangle is inside (z < 0 in the plane's space), outside or crosses the plane. Those that cross become islands of
their own and are clipped exactly: the corners that are outside slide along an edge to the plane, and where only one
is, a second copy of the triangle fills what is left of the square:

    C outside           P = CA at z = 0, Q = BC at z = 0
    | \                 first copy:  C to P             P A B
    P--Q                second copy: C to Q and A to P  Q P B
    |   \
    A----B

What lies in the plane afterwards is the section. Its edges are joined to chains, and what the chains enclose is filled
by the even-odd rule; so open surfaces are cut too, which Blender's Boolean solvers may refuse. Where chains touch
themselves at a point, a part of the section can stay open or be filled wrongly.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..sockets import input_of, output_of
from .material import UV
from .node_builder import Nodes

NEAR = 1e-6  # Points nearer to the plane than this share of the slice's reach lie on it; a few roundings of float32.
OFFSET = 1e-5  # The cut lies this share of the reach below the slice, on whose samples many vertices of a surface lie.
EQUAL = 5e-7  # Ends of the section's edges nearer than this share of the reach are the same point.


def cut_nodes(
    name: str, plane: bpy.types.Object, cut: bpy.types.Object, coordinates: NDArray[np.float64], reach: float
) -> bpy.types.NodeTree:
    """Return a node group that keeps the part below a plane and caps it.

    Parameters
    ----------
    plane : Object
        Its local x and y axes span the plane; points with a positive z are removed.
    cut : Object
        The slice, whose material the cap has.
    coordinates : (2, 3) float64
        Position on its picture, as `picture_coordinates` returns it.
    reach : float
        Size of the slice, Blender units.
    """
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree.is_modifier = True
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    nodes = Nodes(tree)
    surface = output_of(nodes.add("NodeGroupInput"), "Geometry")
    to_surface = nodes.transform_of(plane)
    to_plane = nodes.of("FunctionNodeInvertMatrix", "Matrix", {"Matrix": to_surface})
    at = nodes.of("GeometryNodeInputPosition", "Position")
    height = nodes.math("ADD", nodes.z_of(nodes.transformed(at, to_plane)), OFFSET * reach)
    inside = nodes.compare("LESS_THAN", height, 0.0)
    wholly_inside = nodes.at_points(inside)
    wholly_outside = nodes.at_points(nodes.negate(inside))

    # A vertex is at the rim if any of its faces is not wholly inside.
    surface, at_rim = nodes.captured(surface, nodes.on_faces(nodes.negate(wholly_inside)))
    below, remaining = nodes.separate(surface, wholly_inside, "FACE")
    _, crossing = nodes.separate(remaining, wholly_outside, "FACE")
    triangulated = nodes.of("GeometryNodeTriangulate", "Mesh", {"Mesh": crossing})
    triangles = nodes.of("GeometryNodeSplitEdges", "Mesh", {"Mesh": triangulated})

    # Every vertex of an island has one corner, so its neighbors in the triangle are known.
    corner = nodes.of("GeometryNodeCornersOfVertex", "Corner Index")
    after, before = (nodes.vertex_from(corner, steps) for steps in (1, 2))
    positions = {"own": at, "after": nodes.at_vertex("FLOAT_VECTOR", after, at)}
    positions["before"] = nodes.at_vertex("FLOAT_VECTOR", before, at)
    heights = {"own": height, "after": nodes.at_vertex("FLOAT", after, height)}
    heights["before"] = nodes.at_vertex("FLOAT", before, height)
    is_inside = {which: nodes.compare("LESS_THAN", value, 0.0) for which, value in heights.items()}
    is_outside = {which: nodes.negate(value) for which, value in is_inside.items()}

    def crossing_of(outer: str, inner: str) -> Any:
        """Return where the edge meets the plane, computed from its outer end so that both its triangles agree."""
        share = nodes.math("DIVIDE", heights[outer], nodes.math("SUBTRACT", heights[outer], heights[inner]))
        return nodes.between(share, positions[outer], positions[inner])

    count = nodes.total(is_inside.values())
    islands, _ = nodes.separate(
        triangles, nodes.compare("GREATER_THAN", count, 0.5), "POINT"
    )  # Other triangles have no corner inside.
    pairs = (("own", "after"), ("own", "before"), ("before", "own"))
    to_after, to_before, from_before = (crossing_of(*pair) for pair in pairs)
    target = nodes.switch(is_inside["after"], to_before, to_after)
    first = nodes.moved(islands, target, is_outside["own"])
    squares, _ = nodes.separate(islands, nodes.compare("EQUAL", count, 2.0), "POINT")
    moves = nodes.either(is_outside["own"], is_outside["before"])
    target = nodes.switch(is_outside["own"], from_before, to_before)
    second = nodes.moved(squares, target, moves)
    rim = nodes.join(first, second)

    on_plane = nodes.compare("LESS_THAN", nodes.math("ABSOLUTE", height), NEAR * reach)
    section, _ = nodes.separate(rim, nodes.at_points(on_plane), "EDGE")
    flat = nodes.moved(section, nodes.transformed(at, to_plane))
    chained = nodes.of("GeometryNodeMergeByDistance", "Geometry", {"Distance": EQUAL * reach, "Geometry": flat})
    outlines = nodes.of("GeometryNodeMeshToCurve", "Curve", {"Mesh": chained})
    filled = nodes.of("GeometryNodeFillCurve", "Mesh", {"Curve": outlines})
    below_slice = nodes.vector("ADD", at, (0.0, 0.0, -OFFSET * reach))  # it is at z = 0
    in_surface = nodes.transformed(below_slice, to_surface)
    lifted = nodes.moved(filled, in_surface)
    material = nodes.add("GeometryNodeSetMaterial")
    nodes.link(cut.data.materials[0], input_of(material, "Material"))
    to_slice = nodes.of("FunctionNodeInvertMatrix", "Matrix", {"Matrix": nodes.transform_of(cut)})
    at_slice = nodes.transformed(at, to_slice)
    shares = [nodes.vector("DOT_PRODUCT", at_slice, weights) for weights in coordinates]
    halves = [nodes.math("ADD", share, 0.5) for share in shares]
    on_picture = nodes.of("ShaderNodeCombineXYZ", "Vector", dict(zip("XY", halves, strict=True)))
    nodes.link(nodes.stored(lifted, UV, on_picture), input_of(material, "Geometry"))

    whole = nodes.join(below, rim, output_of(material, "Geometry"))
    seam = {"Distance": NEAR * reach, "Geometry": whole, "Selection": nodes.either(at_rim, on_plane)}
    merged = nodes.of("GeometryNodeMergeByDistance", "Geometry", seam)
    nodes.link(merged, input_of(nodes.add("NodeGroupOutput"), "Geometry"))
    nodes.arrange()
    return tree
