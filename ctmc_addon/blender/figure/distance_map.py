"""A map of distances on a surface: every point in the colour of its distance to another surface, and the colour bar.

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

from ...core import Step, Steps, TriangleMesh, within
from ...core.mesh import ReferenceSurface, longest_edges, subdivided, vertex_distances_steps
from ..materials import use_nodes
from ..surface import mesh_data as meshes
from .annotations import CAP, GAP_MM, Board
from .page import Box
from .styles import INK

HEAT = "ctmc_distance_mm"
# Even in lightness, and told apart by the colour-blind: viridis (van der Walt and Smith 2015), sRGB.
COLOURS = ("440154", "482878", "3e4989", "31688e", "26828e", "1f9e89", "35b779", "6ece58", "b5de2b", "fde725")


@dataclass(frozen=True)
class Heat:
    """Distances from 0 to `limit_mm` and their colours; `beyond` says that some are larger."""

    limit_mm: float
    beyond: bool = False
    title: str = "distance, mm"


@dataclass(frozen=True)
class Measured:
    """A finely cut surface with the distance of every vertex, mm."""

    mesh: TriangleMesh
    distances_mm: NDArray[np.float64]


def measured_steps(mesh: TriangleMesh, reference: ReferenceSurface, threads: int | None = None) -> Steps[Measured]:
    """The distance of a surface to another, at the vertices of its triangles and of their parts."""
    yield Step(0.0, "Cutting triangles for the map")
    fine = subdivided(mesh, float(longest_edges(reference.mesh).mean()))
    distances = yield from within(vertex_distances_steps(fine, reference, threads), 0.2, 1.0)
    return Measured(fine, distances)


def heat_of(measured: Sequence[Measured], limit_mm: float | None = None) -> Heat:
    """Colours for these surfaces together: up to the 99th percentile of their distances, rounded up."""
    every = np.concatenate([one.distances_mm for one in measured])
    most = float(every.max())
    if limit_mm is None:
        limit_mm = rounded_up(float(np.percentile(every, 99))) if most > 1e-6 else 1.0
    return Heat(limit_mm, bool(most > limit_mm * (1 + 1e-6)))


def rounded_up(value: float) -> float:
    """The smallest of 1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8 times a power of ten that is not below `value`.

    Examples
    --------
    >>> rounded_up(0.31), rounded_up(7.0)
    (0.4, 8.0)
    """
    power = 10.0 ** math.floor(math.log10(max(value, 1e-9)))
    steps = (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10)
    return float(f"{next(step * power for step in steps if step * power >= value * (1 - 1e-9)):.6g}")


def remember_distances(mesh: bpy.types.Mesh, distances_mm: NDArray[np.float64]) -> None:
    """Write a distance on every vertex of a mesh, which the heat map shows."""
    attribute = mesh.attributes.get(HEAT) or mesh.attributes.new(HEAT, "FLOAT", "POINT")
    attribute.data.foreach_set("value", distances_mm.astype(np.float32))


def linear(colour: str) -> tuple[float, float, float, float]:
    """The linear RGBA of an sRGB colour such as 'fde725' (IEC 61966-2-1)."""
    parts = [int(colour[at : at + 2], 16) / 255 for at in (0, 2, 4)]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return red, green, blue, 1.0


def heat_material(heat: Heat, glow: float) -> bpy.types.Material:
    """The colours over the attribute `HEAT`; `glow` is the share that does not depend on light."""
    material = bpy.data.materials.new("CTMC Distance")
    use_nodes(material)
    tree = material.node_tree
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    distance = tree.nodes.new("ShaderNodeAttribute")
    distance.attribute_name = HEAT
    share = tree.nodes.new("ShaderNodeMath")
    share.operation, share.use_clamp = "DIVIDE", True
    share.inputs[1].default_value = heat.limit_mm
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    stops = ramp.color_ramp.elements
    while len(stops) < len(COLOURS):
        stops.new(1.0)
    for at, colour in enumerate(COLOURS):
        stops[at].position = at / (len(COLOURS) - 1)
        stops[at].color = linear(colour)
    light = tree.nodes.new("ShaderNodeEmission")
    mix = tree.nodes.new("ShaderNodeMixShader")
    mix.inputs[0].default_value = glow
    shader.inputs["Roughness"].default_value = 0.9
    shader.inputs["Specular IOR Level"].default_value = 0.0
    tree.links.new(distance.outputs["Fac"], share.inputs[0])
    tree.links.new(share.outputs[0], ramp.inputs[0])
    tree.links.new(ramp.outputs["Color"], shader.inputs["Base Color"])
    tree.links.new(ramp.outputs["Color"], light.inputs["Color"])
    tree.links.new(shader.outputs[0], mix.inputs[1])
    tree.links.new(light.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    return material


def colour_bar(board: Board, heat: Heat, box: Box) -> list[bpy.types.ID]:
    """A bar of the colours in a box of the page, its title above and its distances below; returns its material."""
    left, bottom, right, _ = box
    font = board.font_mm
    inset = board.width_of(end_of(heat)) / 2
    left, right = left + inset, right - inset
    base = bottom + CAP * font + GAP_MM
    steps = 64
    across = np.repeat(np.linspace(0.0, right - left, steps + 1), 2)
    tall = np.tile([0.0, font], steps + 1)
    corners = np.column_stack([across, tall, np.zeros_like(across)]).astype(np.float32)
    at = 2 * np.arange(steps, dtype=np.int32)
    faces = np.concatenate([np.stack([at, at + 2, at + 3], axis=1), np.stack([at, at + 3, at + 1], axis=1)])
    bar = meshes.new_mesh("CTMC Colours", corners, faces)
    remember_distances(bar, np.repeat(np.linspace(0.0, heat.limit_mm, steps + 1), 2))
    material = heat_material(heat, glow=1.0)
    board.put("CTMC Colours", bar, left, base, material)
    for share in (0.0, 0.5, 1.0):
        x = left + share * (right - left)
        board.rectangle((x - 0.06, base - 0.5, x + 0.06, base), INK)
        label = end_of(heat) if share == 1.0 else f"{share * heat.limit_mm:g}"
        board.text(label, x, bottom, "CENTER")
    board.text(heat.title, (left + right) / 2, base + font + 0.8, "CENTER")
    return [material]


def end_of(heat: Heat) -> str:
    """The last distance on the bar."""
    return f"{'≥ ' if heat.beyond else ''}{heat.limit_mm:g}"
