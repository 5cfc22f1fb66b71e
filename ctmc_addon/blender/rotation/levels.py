# SPDX-License-Identifier: GPL-3.0-or-later
"""Make levels of simplification as objects: each a plain mesh without modifier and key."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import bpy

from ...core import Budget, Steps, TriangleMesh, equal_part, simplify_steps
from ..colors import BONE
from ..datablocks import remove_blocks
from ..materials import surface_material
from ..surface import mesh_data as meshes
from ..surface.placement import SCALE, placed_at_center

NAME = "CTMC Rotation Test"


@dataclass(frozen=True)
class Level:
    """One level of simplification, as an object."""

    percent: float
    mesh: TriangleMesh
    obj: bpy.types.Object


def simplified_steps(
    mesh: TriangleMesh, percents: Sequence[float], budget: Budget | None = None
) -> Steps[list[tuple[float, TriangleMesh]]]:
    """Return the surface without these shares of its triangles, per cent."""
    simplified = []
    for number, percent in enumerate(percents):
        small = mesh
        if percent:
            simplifying = simplify_steps(mesh, reduction=percent / 100, budget=budget or Budget())
            small = yield from equal_part(simplifying, number, len(percents))
        simplified.append((percent, small))
    return simplified


@contextmanager
def levels_in(
    scene: bpy.types.Scene, simplified: Sequence[tuple[float, TriangleMesh]], scale: float = SCALE
) -> Iterator[list[Level]]:
    """Add static objects of these meshes (RAS+ mm) to `scene`, about one origin; remove them after the block."""
    placement = placed_at_center(simplified[0][1].vertices, scale)
    material = surface_material(NAME, BONE)
    levels: list[Level] = []
    try:
        for percent, mesh in simplified:
            name = f"{NAME} {percent:g} %"
            plain = meshes.new_mesh(name, placement.to_local(mesh.vertices), mesh.faces)
            plain.materials.append(material)
            obj = bpy.data.objects.new(name, plain)
            obj.location = placement.origin
            levels.append(Level(percent, mesh, obj))
            scene.collection.objects.link(obj)
        yield levels
    finally:
        remove_blocks(*(level.obj.data for level in levels))  # This removes the objects too.
        remove_blocks(material)


def show_only(levels: Sequence[Level], shown: Level) -> None:
    """Hide every level except one, in renders and viewports."""
    for level in levels:
        level.obj.hide_render = level.obj.hide_viewport = level is not shown
