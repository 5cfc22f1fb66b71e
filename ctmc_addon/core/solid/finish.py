# SPDX-License-Identifier: GPL-3.0-or-later
"""Simplify the parts of a solid as one complex, and describe each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..machine.budget import Budget
from ..measures.reconstruction import Reconstruction, Stage
from ..mesh.labels.label_complex import ComplexMesh, borders_of
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import Steps
from ..simplification.complexes.flats import Flat
from ..simplification.policy import SOLIDS
from ..sinks import HOLD
from ..surfaces.finish import AVERAGING, LOOKING, SIMPLIFYING, Finish, averaged_steps
from ..surfaces.finish_labels import crossings_of, own_surfaces_steps, simplified_labels_steps
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
    borders = borders_of(mesh.faces, mesh.sides)
    crossing_pairs = crossings_of(mesh, crossings)
    parts = {
        number: replace(
            structures[number],
            mesh=TriangleMesh(mesh.vertices[border.used], border.faces),
            surface=None,
            full_faces=len(border.faces),
            components=None,
            measured=None,
            self_intersections=crossing_pairs.get(number, 0),
        )
        for number, border in borders.items()
    }
    if settings.simplifies_here:
        simplified = yield from simplified_labels_steps(finishing, mesh, SOLIDS, flats)
        parts = yield from own_surfaces_steps(finishing, simplified, parts, len(mesh.faces), averages=True)
    else:
        for number, part in parts.items():
            own = yield from finishing.stages.run(AVERAGING, averaged_steps(part.mesh))
            parts[number] = replace(part, mesh=own)
    parts = {number: replace(part, beyond=None, neighbors=()) for number, part in parts.items()}
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
