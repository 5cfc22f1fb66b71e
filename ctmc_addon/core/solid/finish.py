# SPDX-License-Identifier: GPL-3.0-or-later
"""Simplify the parts of a solid as one complex, and describe each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..machine.budget import Budget
from ..measures.reconstruction import Reconstruction, Stage
from ..mesh.intersections import self_intersections_steps
from ..mesh.labels.label_complex import ComplexMesh, borders_of
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import Steps
from ..simplification.complexes.flats import Flat
from ..simplification.complexes.simplify import simplify_complex_steps
from ..simplification.engine.component_removal import CollapsedComponents
from ..simplification.policy import SOLIDS
from ..simplification.whole import Simplification
from ..sinks import HOLD
from ..surfaces.finish import AVERAGING, LOOKING, SIMPLIFYING, Finish, averaged_steps, goal_of
from .cells.recipe import Recipe
from .fields.lattice_fields import LEAST, ShapeField

WEIGHTS = {SIMPLIFYING: 30, AVERAGING: 5, LOOKING: 15}


def finished_parts_steps(
    structures: Mapping[int, Reconstruction],
    mesh: ComplexMesh,
    crossings: NDArray[np.int64],
    flats: Sequence[Flat],
    budget: Budget,
) -> Steps[dict[int, Reconstruction]]:
    """Return the parts by their numbers, simplified as one complex if their settings ask for that.

    Parameters
    ----------
    structures : mapping of int to Reconstruction
        By the number of a part: its structure, with the name of the part and all notes.
    mesh : ComplexMesh
        The sides of triangles are numbers of parts.
    crossings : (n, 2) int64
        Pairs of triangles that cross.
    flats : sequence of Flat
        Planes that stay flat.
    budget : Budget
    """
    settings = next(iter(structures.values())).settings
    finishing = Finish(settings, budget, HOLD, WEIGHTS)
    stages = finishing.stages
    full_borders = borders_of(mesh.faces, mesh.sides)
    simplified = None
    if settings.simplifies_here:
        goal = goal_of(settings)
        simplifying = simplify_complex_steps(mesh, budget=budget, policy=SOLIDS, flats=flats, **goal)
        simplified = yield from stages.run(SIMPLIFYING, simplifying)
    final = mesh if simplified is None else simplified.mesh
    pairs = crossings if simplified is None else crossings[:0]
    if simplified is not None and simplified.self_intersections != 0:
        pairs = yield from stages.run(LOOKING, self_intersections_steps(final.vertices, final.faces))
    parts: dict[int, Reconstruction] = {}
    for number, border in (full_borders if simplified is None else borders_of(final.faces, final.sides)).items():
        mesh_of_part = TriangleMesh(final.vertices[border.used], border.faces)
        own = yield from stages.run(AVERAGING, averaged_steps(mesh_of_part))
        own_crossings = int((final.sides[pairs] == number).any(axis=(1, 2)).sum())
        part = replace(
            structures[number],
            mesh=own,
            surface=None,
            full_faces=len(full_borders[number].faces),
            beyond=None,
            components=None,
            measured=None,
            neighbors=(),
            self_intersections=own_crossings,
        )
        if simplified is not None:
            collapsed = simplified.collapsed_of.get(number, CollapsedComponents())
            simple = Simplification(own, collapsed, simplified.handles_cut, own_crossings)
            part = finishing.simplified(part, simple, (len(mesh.faces), len(final.faces)))
        parts[number] = part
    return {number: replace(part, stages=_summed((*part.stages, *finishing.ran))) for number, part in parts.items()}


def flats_of(recipe: Recipe, numbers: Sequence[int]) -> list[Flat]:
    """Return the planes of a recipe's shapes, given by their fields; planes that coincide are one flat."""
    heights: dict[tuple[float, float, float], list[float]] = {}
    for number in numbers:
        field = recipe.fields[number]
        assert isinstance(field, ShapeField)
        for normal, height in field.shape.planes:
            heights.setdefault(normal, []).append(height + field.shift)
    near = 2 * LEAST * recipe.lattice.shortest_mm  # Vertices lie at most this far from a shape.
    return [Flat(np.array(normal), np.array(each), near) for normal, each in heights.items()]


def _summed(stages: Sequence[Stage]) -> tuple[Stage, ...]:
    """Return each stage once, with the sum of its seconds."""
    seconds: dict[str, float] = {}
    for name, each in stages:
        seconds[name] = seconds.get(name, 0.0) + each
    return tuple(Stage(name, each) for name, each in seconds.items())


def part_names(name: str, numbers: Sequence[int]) -> dict[int, str]:
    """Return the name of every part: that of the structure, with a letter if there are several parts.

    Examples
    --------
    >>> part_names("hip", [1, 2]), part_names("hip", [1])
    ({1: 'hip a', 2: 'hip b'}, {1: 'hip'})
    """
    if len(numbers) == 1:
        return {numbers[0]: name}
    return {number: f"{name} {_letters(at)}" for at, number in enumerate(numbers)}


def _letters(number: int) -> str:
    """Return a to z, then aa, ab and so on."""
    rest, last = divmod(number, 26)
    return (_letters(rest - 1) if rest else "") + "abcdefghijklmnopqrstuvwxyz"[last]
