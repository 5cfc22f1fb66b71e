# SPDX-License-Identifier: GPL-3.0-or-later
"""Finish the parts of a solid: simplify them together, and describe each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..errors import MeshError
from ..machine.budget import Budget
from ..mesh.intersections import self_intersections_steps
from ..mesh.labels.label_complex import ComplexMesh, borders_of, neighbors_of
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import Steps
from ..reconstruction import Reconstruction
from ..simplification.complexes.simplify import simplify_complex_steps
from ..simplification.engine.component_removal import CollapsedComponents
from ..simplification.whole import Simplification
from ..sinks import HOLD
from ..surfaces.finish import AVERAGING, LOOKING, SIMPLIFYING, Finish, averaged_steps, goal_of
from .request import SolidRequest

WEIGHTS = {SIMPLIFYING: 30, AVERAGING: 5, LOOKING: 15}


def finished_parts_steps(
    result: Reconstruction, mesh: ComplexMesh, notes: Sequence[str], solid: SolidRequest, budget: Budget
) -> Steps[list[Reconstruction]]:
    """Return the parts of a structure, from the surfaces of all of them; names are those of the structure.

    Parameters
    ----------
    result : Reconstruction
        The structure.
    mesh : ComplexMesh
        Sides are the parts' numbers.
    notes : sequence of str
        On all parts.
    solid : SolidRequest
    budget : Budget

    Raises
    ------
    MeshError
        If there is no part.
    """
    settings = result.settings
    finishing = Finish(settings, budget, HOLD, WEIGHTS)
    stages = finishing.stages
    if not len(mesh.faces):
        raise MeshError(f"nothing is left of {result.label_name}; move its surface inward by less")
    full_borders = borders_of(mesh.faces, mesh.sides)
    simplified = None
    if settings.simplifies_here:
        simplifying = simplify_complex_steps(mesh, budget=budget, **goal_of(settings))
        simplified = yield from stages.run(SIMPLIFYING, simplifying)
    final = mesh if simplified is None else simplified.mesh
    pairs = yield from stages.run(LOOKING, self_intersections_steps(final.vertices, final.faces))
    borders = borders_of(final.faces, final.sides)
    names = part_names(result.label_name, sorted(full_borders))
    parts = []
    for number, border in borders.items():
        own = TriangleMesh(final.vertices[border.used], border.faces)
        if settings.normals == "mesh" or simplified is None:
            own = yield from stages.run(AVERAGING, averaged_steps(own))
        full_faces = len(full_borders[number].faces)
        part = replace(
            result,
            mesh=own,
            surface=None,
            label_name=names[number],
            full_faces=full_faces,
            notes=(*result.notes, *notes),
            beyond=border.beyond,
            components=None,
            measured=None,
            neighbors=neighbors_of(number, final.interfaces),
            self_intersections=int((final.sides[pairs] == number).any(axis=(1, 2)).sum()),
        )
        if simplified is not None:
            collapsed = simplified.collapsed_of.get(number, CollapsedComponents())
            simple = Simplification(own, collapsed, simplified.handles_cut, part.self_intersections)
            part = finishing.simplified(part, simple, (len(mesh.faces), len(final.faces)))
        parts.append(replace(part, beyond=border.beyond))
    return [replace(part, stages=(*part.stages, *finishing.ran)) for part in parts]


def part_names(name: str, numbers: Sequence[int]) -> dict[int, str]:
    """Return the name of every part: the structure's, and a letter where there are several.

    Examples
    --------
    >>> part_names("hip", [1, 2]), part_names("hip", [1])
    ({1: 'hip a', 2: 'hip b'}, {1: 'hip'})
    """
    if len(numbers) == 1:
        return {numbers[0]: name}
    return {number: f"{name} {_letters(at)}" for at, number in enumerate(numbers)}


def _letters(number: int) -> str:
    """Return a, b, ... z, aa, ab and on."""
    rest, last = divmod(number, 26)
    return (_letters(rest - 1) if rest else "") + "abcdefghijklmnopqrstuvwxyz"[last]
