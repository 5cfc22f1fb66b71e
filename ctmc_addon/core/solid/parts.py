# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of structures that are made together, or of one: thicken, hollow, drain, cut, least wall, base.

Structures are thickened first if they are hollow, so that walls are measured from the new surface. All else is one
extraction from all fields at once; thin walls and feet are found on extractions without them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from ..errors import MeshError, SettingsError
from ..machine.budget import Budget
from ..mesh.labels.label_complex import ComplexMesh
from ..progress import Stages, Steps
from ..reconstruction import Reconstruction, Stage
from .body import Body, OnEdges, edges_of
from .cells.extract import Recipe, extract_parts_steps
from .fields.depth import depth_below
from .fields.lattice_fields import Field, HeldField, ShapeField
from .fields.shapes import Bar, HalfSpace, Shape, Union
from .finish import finished_parts_steps, part_names
from .placing.drains import notes_at_cuts
from .placing.least_wall import Thickening, thin_walls_steps
from .placing.pegs import bosses_steps, heights_of, placed_pegs_steps
from .placing.standing import Feet, feet_steps, stood_steps
from .request import Pegs, SolidRequest
from .rule import PartRule
from .structure import Structure, body_steps, drain_steps, hollow_steps, lattice_of

WALL_TRIES = 6  # Thicken what is still too thin this often.
MAKING = "Making the solid"
"""The stage in which a solid is made of surfaces."""


class PartsMaking:
    """Make the parts of structures that share walls, or of one."""

    def __init__(self, structures: Sequence[Structure], solid: SolidRequest, budget: Budget) -> None:
        self.structures, self.solid, self.budget = list(structures), solid, budget
        shaped = self.structures[0].is_shaped
        self.thicken, self.hollow = (0.0, 0.0) if shaped else (solid.thicken, solid.hollow)
        self.planes = [HalfSpace(cut.point, cut.normal) for cut in solid.cuts]
        self.walls: dict[int, Shape] = {}
        self.pegs: list[tuple[Shape, Shape] | None] = []
        self.bosses: list[Shape] = []
        self.feet: Feet | None = None
        self.standing: dict[int, list[str]] = {}

    def parts_steps(self) -> Steps[list[Reconstruction]]:
        """Return the parts, one structure after the other."""
        stages = Stages({MAKING: 3, "": 1})
        mesh = yield from stages.run(MAKING, self._mesh_steps())
        stage = Stage(MAKING, stages.seconds[MAKING])
        for structure in self.structures:
            structure.result = replace(structure.result, stages=(*structure.result.stages, stage))
        return (yield from stages.run("", self._finished_steps(mesh)))

    def _mesh_steps(self) -> Steps[ComplexMesh]:
        """Return the surfaces of all parts."""
        solid = self.solid
        self.lattice = lattice_of(self.structures, solid)
        self.bodies: list[Body] = []
        for structure in self.structures:
            self.bodies.append((yield from body_steps(structure.mesh, self.lattice, self.budget)))
        if self.thicken and self.hollow:
            yield from self._thicken_steps()
        if not self.structures[0].is_shaped:
            for structure, body in zip(self.structures, self.bodies, strict=True):
                yield from drain_steps(structure, body, self.hollow, self.thicken)
        for structure in self.structures:
            structure.notes += notes_at_cuts(structure.holes, self.planes)
        if solid.least_wall:
            yield from self._walls_steps()
        if solid.pegs is not None:
            yield from self._pegs_steps(solid.pegs)
        if solid.base:
            yield from self._feet_steps()
        mesh = yield from self._extracted_steps(drains=True, cuts=True)
        return mesh if self.feet is None else (yield from self._stood_steps(mesh, self.feet))

    def _thicken_steps(self) -> Steps[None]:
        """Thicken the structures, so that distances are measured from their new surfaces."""
        hollow, self.hollow = self.hollow, 0.0
        mesh = yield from self._extracted_steps()
        bodies = []
        for number, structure in enumerate(self.structures):
            own = mesh.of_label(1 + number)
            if not len(own.faces):
                raise MeshError(f"nothing is left of {structure.name} after --thicken; give a smaller distance")
            bodies.append((yield from body_steps(own, self.lattice, self.budget)))
        self.bodies, self.thicken, self.hollow = bodies, 0.0, hollow

    def _extracted_steps(self, drains: bool = False, cuts: bool = False) -> Steps[ComplexMesh]:
        """Extract all parts, numbered from 1 on: structure by structure, by which cuts they are below as bits."""
        fields, edges = yield from self._structures_steps()
        rule = PartRule(len(self.bodies))

        def added(shape: Shape) -> int:
            fields.append(ShapeField(shape, self.lattice))
            return len(fields) - 1

        if self.hollow:
            for body, structure in zip(self.bodies, self.structures, strict=True):
                rule.hollows.append(len(fields))
                fields.append((yield from hollow_steps(structure, body, self.hollow, self.thicken)))
        rule.added = {number: added(shape) for number, shape in sorted(self.walls.items())}
        holes = [hole for structure in self.structures for hole in structure.holes]
        if drains and holes:
            rule.drains = added(Union(holes))
        if cuts:
            rule.cuts = [added(plane) for plane in self.planes]
            for both in self.pegs:
                if both is None:
                    rule.pegs.append(None)
                    continue
                peg = added(both[0])
                rule.pegs.append((peg, peg if both[0] is both[1] else added(both[1])))
            if self.bosses:
                rule.bosses = added(Union(self.bosses))
            if self.feet is not None:
                rule.feet = {part: added(shape) for part, shape in sorted(self.feet.shapes.items())}
        recipe = Recipe(self.lattice, fields, rule, edges)
        mesh, self.crossings = yield from extract_parts_steps(recipe, self.budget)
        return mesh

    def _structures_steps(self) -> Steps[tuple[list[Field], dict[int, OnEdges]]]:
        """Return the fields that tell the structures from what is around and from each other."""
        known = None if self.thicken else edges_of(self.bodies)
        on_edges = {} if known is None else dict.fromkeys(range(len(self.bodies)), known)
        if len(self.bodies) == 1:
            only = yield from self.bodies[0].field_steps(-self.thicken)
            return [only], on_edges
        samples = self.lattice.shape[0] * self.lattice.shape[1] * self.lattice.shape[2]
        needed = 4 * samples * (3 * len(self.bodies) + 1)
        self.budget.require(needed, f"the fields of {len(self.bodies)} structures", "make fewer at once, or a region")
        distances = []
        for body in self.bodies:
            distances.append((yield from body.distances_steps(-self.thicken)))
        whole = distances[0].copy()
        for each in distances[1:]:
            np.maximum(whole, each, out=whole)
        fields: list[Field] = [HeldField(self.lattice, whole + np.float32(self.thicken))]
        for number, own in enumerate(distances[:-1]):
            others = distances[number + 1].copy()
            for each in distances[number + 2 :]:
                np.maximum(others, each, out=others)
            fields.append(HeldField(self.lattice, own - others))
        return fields, on_edges

    def _walls_steps(self) -> Steps[None]:
        """Find what thickens thin walls, and again while some are thin; the notes say where and by how much."""
        spacing, threads = sum(self.lattice.sides_mm) / 3, self.budget.threads
        shapes: dict[int, list[Thickening]] = {number: [] for number in range(len(self.structures))}
        for again in range(WALL_TRIES):
            mesh = yield from self._extracted_steps()
            for number, before in list(shapes.items()):
                own = mesh.of_label(1 + number)
                found = yield from thin_walls_steps(own, self.solid.least_wall, spacing, threads, before)
                if not again:
                    self.structures[number].notes += found.notes
                if found.shape is None:
                    del shapes[number]
                else:
                    before.append(found.shape)
                    self.walls[number] = Union(tuple(before))
            if not shapes:
                return

    def _pegs_steps(self, pegs: Pegs) -> Steps[None]:
        """Place the pegs of every cut, between each two sides of the others."""
        surfaces = []
        for body in self.bodies:
            surfaces.append((yield from body.signed_steps()))
        avoid: list[Shape] = [hole for structure in self.structures for hole in structure.holes]
        for number, cut in enumerate(self.solid.cuts):
            bars: list[Shape] = []
            holes: list[Shape] = []
            refused: list[SettingsError] = []
            others = [(plane, plane.turned) for plane in self.planes[:number] + self.planes[number + 1 :]]
            for surface, body, structure in zip(surfaces, self.bodies, self.structures, strict=True):
                depth = depth_below(surface, self.thicken, threads=self.budget.threads)
                low, high = heights_of(cut, body.mesh.vertices, self.thicken)
                if not low < 0 < high:
                    continue
                for sides in product(*others):
                    try:
                        around, beyond = body.mesh.vertices, max(0.0, self.thicken)
                        placing = placed_pegs_steps(cut, pegs, depth, sides, around, beyond, avoid, self.hollow > 0)
                        placed = yield from placing
                    except SettingsError as error:
                        refused.append(error)
                        continue
                    structure.notes += placed.notes
                    if self.hollow:
                        self.bosses.append((yield from bosses_steps(placed, pegs, self.hollow, surface)))
                    bars.append(placed.pegs)
                    holes.append(placed.holes)
            if refused and not bars:
                raise refused[0]
            if refused:
                where = " ".join(f"{at:g}" for at in cut.point)
                self.structures[0].notes.append(f"Some joints at the cut at {where} have no peg.")
            avoid += holes
            if not bars:
                self.pegs.append(None)
                continue
            union = Union(bars)
            # Where a peg fills its hole both are one field: of two that are 0 at the same places no part is certain.
            self.pegs.append((union, Union(holes) if pegs.clearance else union))

    def _feet_steps(self) -> Steps[None]:
        """Make the feet of parts, as they stand without pegs."""
        pegs, self.pegs = self.pegs, []
        mesh = yield from self._extracted_steps(drains=True, cuts=True)
        self.pegs = pegs

        def sides(part: int) -> list[tuple[HalfSpace, float]]:
            return [(plane, -1.0 if (part - 1) >> bit & 1 else 1.0) for bit, plane in enumerate(self.planes)]

        def holes(part: int) -> list[Bar]:
            return self._owner(part).holes

        alone = len(self.structures) == 1
        self.feet = yield from feet_steps(mesh, self.solid.base, self.lattice, sides, holes, alone)

    def _stood_steps(self, mesh: ComplexMesh, feet: Feet) -> Steps[ComplexMesh]:
        """Return the parts without what others cut off from their feet; say how they stand."""
        stood, kept, self.standing = yield from stood_steps(mesh, feet, self._names(mesh))
        left = np.isin(self.crossings, kept).all(axis=1)
        self.crossings = np.searchsorted(kept, self.crossings[left])
        return stood

    def _owner(self, part: int) -> Structure:
        """Return the structure of a part."""
        return self.structures[(part - 1) // (1 << len(self.planes))]

    def _names(self, mesh: ComplexMesh) -> dict[int, str]:
        """Return the names of all parts."""
        names: dict[int, str] = {}
        for structure in self.structures:
            names |= part_names(structure.name, [part for part in mesh.labels if self._owner(part) is structure])
        return names

    def _finished_steps(self, mesh: ComplexMesh) -> Steps[list[Reconstruction]]:
        """Simplify all parts together, and describe them."""
        owners, names = {part: self._owner(part) for part in mesh.labels}, self._names(mesh)
        for structure in self.structures:
            if structure not in owners.values():
                raise MeshError(f"nothing is left of {structure.name}; give smaller lengths or drains")
        described = {}
        for part, owner in owners.items():
            notes = (*owner.result.notes, *owner.notes, *self.standing.get(part, ()))
            described[part] = replace(owner.result, label_name=names[part], notes=notes)
        return (yield from finished_parts_steps(described, mesh, self.crossings, self.budget))
