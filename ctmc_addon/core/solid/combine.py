# SPDX-License-Identifier: GPL-3.0-or-later
"""Make one structure of several, after each has been thickened and hollowed by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..arrays import Floats
from ..errors import MeshError, SettingsError
from ..machine.budget import Budget
from ..progress import Steps
from .body import Body, edges_of
from .cells.extract import Recipe, extract_parts_steps
from .fields.lattice import Lattice
from .fields.lattice_fields import HeldField
from .request import Combination, Combining, SolidRequest
from .rule import PartRule
from .structure import Structure, body_of_steps, body_steps, drain_steps, extracted_steps, hollow_steps, lattice_of


def named_by(structures: Sequence[Structure], solid: SolidRequest) -> list[Structure]:
    """Return the structures that combinations name; raise a `SettingsError` for a name that none has."""
    known = {each.name for each in structures} | {str(each.result.settings.label) for each in structures}
    for combination in solid.combinations:
        for name in combination.of:
            if name not in known:
                there = ", ".join(each.name for each in structures)
                asked = f"--{combination.how.value} {combination.name}"
                raise SettingsError(f"{asked} needs {name}; the structures are {there}")
        known.add(combination.name)
    names = {name for combination in solid.combinations for name in combination.of}
    return [each for each in structures if each.name in names or str(each.result.settings.label) in names]


def combined_steps(structures: Sequence[Structure], solid: SolidRequest, budget: Budget) -> Steps[list[Structure]]:
    """Return what is left of structures after all combinations: new ones stand behind."""
    lattice = lattice_of(structures, solid)
    bodies: list[tuple[Structure, Body]] = []
    for structure in structures:
        body = yield from body_of_steps(structure, lattice, solid.thicken, budget)
        if solid.thicken:
            fields = [(yield from body.field_steps(-solid.thicken))]
            body = yield from extracted_steps(fields, PartRule(1), None, body, structure.name, "--thicken")
        yield from drain_steps(structure, body, solid.hollow, 0.0)
        if solid.hollow:
            outer = yield from body.field_steps(0.0)
            hollow = yield from hollow_steps(structure, body, solid.hollow, 0.0)
            rule = PartRule(1, hollows=[1])
            body = yield from extracted_steps([outer, hollow], rule, body.on_edges, body, structure.name, "--hollow")
        bodies.append((structure, body))
    for combination in solid.combinations:
        members = [_named(name, bodies, combination) for name in combination.of]
        joined = yield from _joined_steps(combination, members, lattice, budget)
        bodies = [each for each in bodies if each not in members] + [joined]
    for structure, body in bodies:
        structure.result = replace(structure.result, mesh=body.mesh)
        structure.is_shaped = True
    return [structure for structure, _ in bodies]


def _joined_steps(
    combination: Combination, members: Sequence[tuple[Structure, Body]], lattice: Lattice, budget: Budget
) -> Steps[tuple[Structure, Body]]:
    """Make one structure of several."""
    values: Floats | None = None
    for _, body in members:
        own = yield from body.distances_steps(0.0)
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
        raise MeshError(f"nothing is left of {combination.name}, as {why}; choose other structures")
    first = members[0][0]
    notes = [note for structure, _ in members for note in structure.notes]
    joined = Structure(
        combination.name,
        replace(first.result, label_name=combination.name, mesh=mesh, label_color=None),
        first.volume,
        list(dict.fromkeys(notes)),
        holes=[hole for structure, _ in members for hole in structure.holes],
    )
    return joined, (yield from body_steps(mesh, lattice, budget))


def _named(name: str, bodies: Sequence[tuple[Structure, Body]], combination: Combination) -> tuple[Structure, Body]:
    """Return a structure by its name, or by its label."""
    for each in bodies:
        if name == each[0].name or name == str(each[0].result.settings.label):
            return each
    there = ", ".join(structure.name for structure, _ in bodies)
    raise SettingsError(f"--{combination.how.value} {combination.name} needs {name}; the structures are {there}")
