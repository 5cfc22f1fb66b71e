# SPDX-License-Identifier: GPL-3.0-or-later
"""Combine structures into one, after each has been thickened and hollowed by itself."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..arrays import Floats
from ..errors import MeshError, SettingsError
from ..machine.budget import Budget
from ..progress import Steps
from ..surfaces.each_label import without
from .body import Body, edges_of
from .cells.extract import extract_parts_steps
from .cells.recipe import Recipe
from .fields.lattice import Lattice
from .fields.lattice_fields import HeldField
from .request import Combination, Combining, SolidRequest
from .rule import PartRule
from .structure import (
    SolidStructure,
    body_steps,
    bulged_steps,
    drain_steps,
    extracted_steps,
    hollow_steps,
    lattice_of,
    tried_steps,
)


class Combined(NamedTuple):
    """Structures after all combinations.

    Parameters
    ----------
    structures : list of SolidStructure
        Structures that failed, with their errors, then those that are left, new ones last.
    left_out : list of str
        A sentence for each combination that could not be made.
    """

    structures: list[SolidStructure]
    left_out: list[str]


def named_by(
    structures: Sequence[SolidStructure], solid: SolidRequest, absent: Container[str] = ()
) -> list[SolidStructure]:
    """Return the structures that combinations name.

    Raises
    ------
    SettingsError
        For a name that neither a structure has when its combination is made, nor is `absent`.
    """
    numbers = {str(each.result.settings.label): each.name for each in structures}
    there = dict.fromkeys(each.name for each in structures)
    taken: dict[str, str] = {}
    named = set()
    for number, combination in enumerate(solid.combinations):
        asked = f"--{combination.how.value} {combination.name}"
        later = {each.name: f"--{each.how.value} {each.name}" for each in solid.combinations[number:]}
        for name in combination.of:
            own = name if name in there or name in taken else numbers.get(name, name)
            if own in taken:
                raise SettingsError(f"{asked} needs {name}, which {taken[own]} has taken; combine {', '.join(there)}")
            if own not in there and name in later:
                raise SettingsError(f"{asked} needs {name}, which {later[name]} makes later; give {later[name]} first")
            if own not in there and name not in absent:
                raise SettingsError(f"{asked} needs {name}; the structures are {', '.join(there)}")
            named.add(own)
        for name in named & there.keys():
            taken[name] = asked
            del there[name]
        there[combination.name] = None
        taken.pop(combination.name, None)
    return [each for each in structures if each.name in named]


def combined_steps(
    structures: Sequence[SolidStructure], solid: SolidRequest, budget: Budget, all_needed: bool = False
) -> Steps[Combined]:
    """Make all combinations; with `all_needed` raise the first error, else leave out what cannot be made."""
    bodies: list[tuple[SolidStructure, Body]] = []
    lattice = lattice_of(structures, solid) if structures else None
    for structure in structures:
        assert lattice is not None, "there are structures"
        shaping = _shaped_steps(structure, solid, lattice, budget, bodies)
        yield from tried_steps([structure], shaping, all_needed)
    left_out = []
    for combination in solid.combinations:
        members = [_named(name, bodies) for name in combination.of]
        own = [each for each in members if each is not None]
        bodies = [each for each in bodies if each not in own]
        try:
            if len(own) < len(members):
                missing = combination.of[members.index(None)]
                raise MeshError(f"it needs {missing}, which is left out")
            assert lattice is not None, "there are structures"
            bodies.append((yield from _joined_steps(combination, own, lattice, budget)))
        except MeshError as error:
            if all_needed:
                raise
            left_out.append(without(combination.name, error))
    for structure, body in bodies:
        structure.result = replace(structure.result, mesh=body.mesh)
        structure.is_shaped = True
    failed = [structure for structure in structures if structure.error is not None]
    return Combined([*failed, *(structure for structure, _ in bodies)], left_out)


def _shaped_steps(
    structure: SolidStructure,
    solid: SolidRequest,
    lattice: Lattice,
    budget: Budget,
    bodies: list[tuple[SolidStructure, Body]],
) -> Steps[None]:
    """Thicken and hollow a structure by itself, and add it to `bodies`."""
    body = yield from body_steps(structure.mesh, lattice, budget)
    yield from bulged_steps(structure, body, solid.thicken)
    if solid.thicken:
        fields = [(yield from body.field_steps(-solid.thicken))]
        body = yield from extracted_steps(fields, PartRule(1), None, body, structure.name, "--thicken")
    yield from drain_steps(structure, body, solid.hollow, 0.0)
    if solid.hollow:
        outer = yield from body.field_steps(0.0)
        hollow = yield from hollow_steps(structure, body, solid.hollow, 0.0)
        rule = PartRule(1, hollow=1)
        body = yield from extracted_steps([outer, hollow], rule, body.on_edges, body, structure.name, "--hollow")
    bodies.append((structure, body))


def _joined_steps(
    combination: Combination, members: Sequence[tuple[SolidStructure, Body]], lattice: Lattice, budget: Budget
) -> Steps[tuple[SolidStructure, Body]]:
    """Make the structure of one combination."""
    values: Floats | None = None
    for _, body in members:
        own = yield from body.distances_steps(0.0)
        body.forget_distances(0.0)
        if values is None:
            values = own.copy()
        elif combination.how is Combining.MERGE:
            np.maximum(values, own, out=values)
        elif combination.how is Combining.INTERSECT:
            np.minimum(values, own, out=values)
        else:
            np.minimum(values, -own, out=values)
    assert values is not None, "a combination has two structures at least"
    edges = edges_of([body for _, body in members])
    recipe = Recipe(lattice, [HeldField(lattice, values)], PartRule(1), {0: edges} if edges else {})
    mesh = (yield from extract_parts_steps(recipe, budget)).mesh.of_label(1)
    if not len(mesh.faces):
        names = combination.of
        why = f"{' and '.join(names)} do not overlap"
        if combination.how is Combining.SUBTRACT:
            why = f"{names[0]} lies within {' and '.join(names[1:])}"
        raise MeshError(f"nothing is left of {combination.name}, because {why}; choose other structures")
    first = members[0][0]
    notes = [note for structure, _ in members for note in structure.notes]
    joined = SolidStructure(
        combination.name,
        replace(first.result, label_name=combination.name, mesh=mesh, label_color=None),
        first.volume,
        list(dict.fromkeys(notes)),
        holes=[hole for structure, _ in members for hole in structure.holes],
        is_combined=True,
    )
    return joined, (yield from body_steps(mesh, lattice, budget))


def _named(name: str, bodies: Sequence[tuple[SolidStructure, Body]]) -> tuple[SolidStructure, Body] | None:
    """Return a structure by its name, or by its label; None if it could not be made."""
    for each in bodies:
        structure = each[0]
        if name == structure.name or (not structure.is_combined and name == str(structure.result.settings.label)):
            return each
    return None
