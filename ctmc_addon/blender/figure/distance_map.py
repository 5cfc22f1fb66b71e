# SPDX-License-Identifier: GPL-3.0-or-later
"""A distance map on a surface: every point in the color of its distance to another surface.

The surface is first cut into triangles no larger than the other's, or the inside of a large triangle, which is where a
coarse surface is wrong, would show what its corners have.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core import PAUSE, Steps, TriangleMesh
from ...core.mesh import ReferenceSurface, mean_longest_edge_steps, subdivided_steps, vertex_distances_steps
from ..materials import headlight, math_node, show_flat, use_nodes
from ..sockets import input_of, output_of
from .spec import ColorScale

DISTANCE = "deviation_mm"  # Vertex attribute that the map shows.
COLORS = "deviation"  # Attribute for the solid view of a viewport.
LARGEST = "ctmc_deviation_mm"  # Custom property of the mesh: the distance of its last color.
# From light to dark in even steps, so that what is right is light and large errors stand out, to the color-blind too:
# the lighter part of magma (Smith and van der Walt 2015), sRGB.
DISTANCE_COLORS = ("fcfdbf", "feca8d", "fd9668", "f1605d", "cd4071", "9e2f7f", "721f81", "440f76")
RIM = 0.72  # Share of the lightness at the rim: it shows form, and its color is not in the scale.


@dataclass(frozen=True)
class DistanceMap:
    """A finely cut surface with the distance of every vertex, mm."""

    mesh: TriangleMesh
    distances_mm: NDArray[np.float64]


def distance_map_steps(
    mesh: TriangleMesh, reference: ReferenceSurface, threads: int | None = None
) -> Steps[DistanceMap]:
    """Measure the distance of a surface to another, at the vertices of its triangles and of their subdivisions.

    Parameters
    ----------
    mesh : TriangleMesh
    reference : ReferenceSurface
    threads : int, optional
        By default one for each processor, at most 8.
    """
    yield PAUSE
    length = yield from mean_longest_edge_steps(reference.mesh)
    fine = yield from subdivided_steps(mesh, length)
    distances = yield from vertex_distances_steps(fine, reference, threads)
    return DistanceMap(fine, distances)


def color_scale(maps: Sequence[DistanceMap], limit_mm: float | None = None) -> ColorScale:
    """Return colors for several surfaces, which share the scale.

    Parameters
    ----------
    maps : sequence of DistanceMap
    limit_mm : float, optional
        Distance at which the colors end; by default the 99th percentile of the distances, rounded up.
    """
    every = np.concatenate([distance_map.distances_mm for distance_map in maps])
    most = float(every.max())
    if limit_mm is None:
        limit_mm = rounded_up(float(np.percentile(every, 99))) if most > 1e-6 else 1.0
    return ColorScale(limit_mm, bool(most > limit_mm * (1 + 1e-6)))


def rounded_up(value: float) -> float:
    """Return the smallest of 1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8 times a power of ten that is not below `value`.

    Examples
    --------
    >>> rounded_up(0.31), rounded_up(7.0)
    (0.4, 8.0)
    """
    power = 10.0 ** math.floor(math.log10(max(value, 1e-9)))
    steps = (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10)
    return float(f"{next(step * power for step in steps if step * power >= value * (1 - 1e-9)):.6g}")


def keep_distances(mesh: bpy.types.Mesh, distances_mm: NDArray[np.float64]) -> None:
    """Write distances as the vertex attribute that the map shows.

    Parameters
    ----------
    mesh : bpy.types.Mesh
    distances_mm : (V,) float64
    """
    attribute = mesh.attributes.get(DISTANCE) or mesh.attributes.new(DISTANCE, "FLOAT", "POINT")
    attribute.data.foreach_set("value", np.ascontiguousarray(distances_mm, np.float32))


def paint_distances(mesh: bpy.types.Mesh, distances_mm: NDArray[np.float64], largest_mm: float = 0.0) -> None:
    """Write distances and colors on the mesh; solid view shows them as Attribute.

    Parameters
    ----------
    mesh : bpy.types.Mesh
    distances_mm : (V,) float64
    largest_mm : float
        Distance of the last color, unless that of a vertex is larger.
    """
    largest_mm = max(largest_mm, float(distances_mm.max(initial=0.0)))
    keep_distances(mesh, distances_mm)
    colors = mesh.color_attributes.get(COLORS) or mesh.color_attributes.new(COLORS, "FLOAT_COLOR", "POINT")
    colors.data.foreach_set("color", colors_of(distances_mm, largest_mm).ravel())
    mesh.color_attributes.active_color_name = COLORS
    mesh[LARGEST] = largest_mm


def painted_mm(obj: bpy.types.Object | None) -> float | None:
    """Return the largest distance that an object's colors show, mm; None where it shows none."""
    if obj is None or obj.type != "MESH" or obj.data.color_attributes.active_color_name != COLORS:
        return None
    largest = obj.data.get(LARGEST)
    return float(largest) if isinstance(largest, float) else None


def colors_of(distances_mm: NDArray[np.float64], largest_mm: float) -> NDArray[np.float32]:
    """Return linear RGBA, (n, 4) float32, of (n,) distances from 0 to the largest."""
    share = distances_mm / (largest_mm or 1.0)
    stops = np.array([linear(color) for color in DISTANCE_COLORS])
    along = np.linspace(0.0, 1.0, len(stops))
    return np.stack([np.interp(share, along, stops[:, channel]) for channel in range(4)], axis=1).astype(np.float32)


def linear(color: str) -> tuple[float, float, float, float]:
    """Return the linear RGBA of an sRGB color such as 'fde725' (IEC 61966-2-1)."""
    parts = [int(color[at : at + 2], 16) / 255 for at in (0, 2, 4)]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return red, green, blue, 1.0


def distance_material(scale: ColorScale) -> bpy.types.Material:
    """Return a material that shows the attribute `DISTANCE`, unlit but slightly darker at the rim."""
    material = bpy.data.materials.new("CTMC Distance")
    use_nodes(material)
    tree = material.node_tree
    distance = tree.nodes.new("ShaderNodeAttribute")
    distance.attribute_name = DISTANCE
    share = math_node(tree, "DIVIDE", output_of(distance, "Fac"), scale.limit_mm)
    share.node.use_clamp = True
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    stops = ramp.color_ramp.elements
    while len(stops) < len(DISTANCE_COLORS):
        stops.new(1.0)
    for at, color in enumerate(DISTANCE_COLORS):
        stops[at].position = at / (len(DISTANCE_COLORS) - 1)
        stops[at].color = linear(color)
    tree.links.new(share, input_of(ramp, "Fac"))
    show_flat(material, headlight(material, ramp.outputs["Color"], RIM))
    return material
