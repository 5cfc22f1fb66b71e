# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the parts of one structure, or of several that touch: thicken, hollow, drain, cut, least wall, base.

Structures that become hollow are thickened first, so that walls are measured from the new surface. Everything else is
one extraction from all fields at once. Thin walls and feet are placed by extractions without them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..errors import MeshError
from ..machine.budget import Budget
from ..measures.reconstruction import Reconstruction, Stage
from ..mesh.labels.label_complex import ComplexMesh
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import PAUSE, Stages, Steps
from .body import Body
from .cells.extract import extract_parts_steps
from .cells.recipe import Recipe
from .cost import RATIOS, require_memory
from .fields.depth import depth_below
from .fields.lattice import Lattice
from .fields.lattice_fields import ShapeField
from .fields.shapes import Bar, HalfSpace, Shape, Union
from .finish import finished_parts_steps, flats_of, part_names
from .placing.drains import notes_at_cuts
from .placing.foot import STEPS_UNDER_CENTER
from .placing.joints import Joined, cut_pegs_steps
from .placing.least_wall import Thickening, thin_walls_steps
from .placing.pegs import bosses_steps
from .placing.standing import Feet, feet_steps, stood_steps
from .request import Pegs, SolidRequest, numbers_text
from .rule import PartRule
from .slots import StructureSlots
from .structure import (
    MAKING,
    SolidStructure,
    body_steps,
    bulged_steps,
    drain_steps,
    hollow_steps,
    lattice_of,
    refined_around,
    sides_of,
    tried_steps,
)

WALL_TRIES = 6  # Thicken walls that are still too thin at most this often.


class PartsMaking:
    """Make the parts of structures that share walls, or of one."""

    def __init__(
        self, structures: Sequence[SolidStructure], solid: SolidRequest, budget: Budget, all_needed: bool = True
    ) -> None:
        self.structures, self.solid, self.budget, self.all_needed = list(structures), solid, budget, all_needed
        shaped = self.structures[0].is_shaped
        self.thicken, self.hollow = (0.0, 0.0) if shaped else (solid.thicken, solid.hollow)
        self.planes = [HalfSpace(cut.point, cut.normal) for cut in solid.cuts]
        self.bodies: list[Body] = []
        self.walls: dict[SolidStructure, Shape] = {}
        self.pegs: list[tuple[Shape, Shape] | None] = []
        self.bosses: list[Shape] = []
        self.bars: list[Bar] = []
        self.feet: Feet | None = None
        self.standing: dict[int, list[str]] = {}

    def parts_steps(self) -> Steps[None]:
        """Make the parts of every structure; unless all are needed, structures that cannot be made keep the error."""
        yield from tried_steps(self.structures, self._made_steps(), self.all_needed)

    def _made_steps(self) -> Steps[None]:
        stages = Stages({MAKING: 3, "": 1})
        mesh = yield from stages.run(MAKING, self._mesh_steps())
        stage = Stage(MAKING, stages.seconds[MAKING])
        for structure in self.structures:
            structure.result = replace(structure.result, stages=(*structure.result.stages, stage))
        yield from stages.run("", self._finished_steps(mesh))

    def _each_steps(self, work_steps: Callable[[SolidStructure, Body], Steps[None]]) -> Steps[None]:
        """Run the work for every structure, and drop structures that fail."""
        for structure, body in zip(self.structures, self.bodies, strict=True):
            yield from tried_steps([structure], work_steps(structure, body), self.all_needed)
        self._leave_out()

    def _leave_out(self) -> None:
        """Drop structures with an error; raise the error of the first if none is left."""
        pairs = zip(self.structures, self.bodies, strict=True)
        kept = [(structure, body) for structure, body in pairs if structure.error is None]
        if not kept:
            error = self.structures[0].error
            assert error is not None, "all were left out"
            raise error
        if len(kept) < len(self.structures):
            self._keep([structure for structure, _ in kept], [body for _, body in kept])

    def _keep(self, structures: Sequence[SolidStructure], bodies: Sequence[Body]) -> None:
        """Keep only these structures, with these bodies."""
        self.structures, self.bodies = list(structures), list(bodies)
        self.walls = {structure: shape for structure, shape in self.walls.items() if structure in self.structures}
        base = self.solid.base and self.solid.base + STEPS_UNDER_CENTER * max(self.lattice.sides_mm)
        growth = max(self.thicken, 0.0) + base + self.solid.least_wall
        self.slots = StructureSlots(self.bodies, self.lattice, growth, self.budget, has_feet=base > 0)
        self.slots.require_fields(len(self.planes) + bool(self.hollow))
        self.slots.require_memory()

    def _mesh_steps(self) -> Steps[ComplexMesh]:
        """Return the surfaces of all parts."""
        solid = self.solid
        self.lattice = lattice_of(self.structures, solid)
        faces = sum(len(structure.mesh.faces) for structure in self.structures)
        slots = min(len(self.structures), RATIOS.slots)
        require_memory(self.budget, solid, sides_of(self.structures), self.lattice.samples, slots, faces)
        bodies = []
        for structure in self.structures:
            body = yield from self._body_steps(structure.mesh)
            yield from bulged_steps(structure, body, self.thicken)
            bodies.append(body)
        self._keep(self.structures, bodies)
        if self.thicken and self.hollow:
            yield from self._thicken_steps()
        if not self.structures[0].is_shaped:
            yield from self._each_steps(self._open_steps)
        for structure in self.structures:
            structure.notes += notes_at_cuts(structure.holes, self.planes)
        if solid.least_wall:
            yield from self._walls_steps()
        if solid.pegs is not None:
            yield from self._pegs_steps(solid.pegs)
        yield from self._refine_steps()
        if solid.base:
            yield from self._feet_steps()
        mesh = yield from self._extracted_steps(drains=True, cuts=True)
        return mesh if self.feet is None else (yield from self._stood_steps(mesh, self.feet))

    def _body_steps(self, mesh: TriangleMesh) -> Steps[Body]:
        """Return the body of a mesh, on a part of the lattice if there are several, which saves time and memory."""
        if len(self.structures) == 1:
            return (yield from body_steps(mesh, self.lattice, self.budget))
        return (yield from body_steps(mesh, self._lattice_around(mesh), self.budget, self.lattice))

    def _lattice_around(self, mesh: TriangleMesh) -> Lattice:
        """Return the part of the lattice that a structure needs."""
        return self.lattice.around(mesh.vertices, max(self.thicken, 0.0))

    def _refine_steps(self) -> Steps[None]:
        """Divide the steps of the lattice around drains and pegs."""
        bars = [bar for structure in self.structures for bar in structure.holes] + self.bars
        lattice = refined_around(self.lattice, bars)
        if lattice is self.lattice:
            return
        self.lattice = lattice
        bodies = []
        for body in self.bodies:
            if len(self.bodies) == 1:
                bodies.append((yield from body.on_steps(lattice)))
            else:
                bodies.append((yield from body.on_steps(self._lattice_around(body.mesh), lattice)))
        self._keep(self.structures, bodies)

    def _open_steps(self, structure: SolidStructure, body: Body) -> Steps[None]:
        """Place the drains of a structure, and raise an error if it has no hollow."""
        yield from drain_steps(structure, body, self.hollow, self.thicken)
        if self.hollow:
            yield from hollow_steps(structure, body, self.hollow, self.thicken)

    def _thicken_steps(self) -> Steps[None]:
        """Thicken the structures, so that distances are measured from their new surfaces."""
        hollow, self.hollow = self.hollow, 0.0
        mesh = yield from self._extracted_steps()
        meshes = {structure: mesh.of_label(1 + number) for number, structure in enumerate(self.structures)}
        thickened: list[Body] = []

        def remade_steps(structure: SolidStructure, _: Body) -> Steps[None]:
            own = meshes.pop(structure)
            if not len(own.faces):
                raise MeshError(f"nothing is left of {structure.name} after --thicken; give a distance closer to 0")
            thickened.append((yield from self._body_steps(own)))

        yield from self._each_steps(remade_steps)
        self.thicken, self.hollow = 0.0, hollow
        self._keep(self.structures, thickened)

    def _extracted_steps(self, drains: bool = False, cuts: bool = False) -> Steps[ComplexMesh]:
        """Extract all parts, numbered from 1 on by structure, then by the cuts above them as bits."""
        slots = self.slots
        fields, edges = yield from slots.fields_steps(self.thicken)
        rule = PartRule(slots.count)

        def added(shape: Shape) -> int:
            fields.append(ShapeField(shape, self.lattice))
            return len(fields) - 1

        def added_by_slot(shapes: Mapping[tuple[int, int], Shape]) -> dict[tuple[int, int], int]:
            """Add shapes, by structure and a second number, as one shape for each slot and second number."""
            of_slots: dict[tuple[int, int], list[Shape]] = {}
            for (number, second), shape in sorted(shapes.items(), key=lambda each: each[0]):
                of_slots.setdefault((slots.slots[number], second), []).append(shape)
            return {key: added(own[0] if len(own) == 1 else Union(own)) for key, own in sorted(of_slots.items())}

        if self.hollow:
            rule.hollow = len(fields)
            fields.append((yield from slots.hollow_steps(self.hollow - self.thicken)))
        walls = {(self.structures.index(structure), 0): shape for structure, shape in self.walls.items()}
        rule.added = {slot: number for (slot, _), number in added_by_slot(walls).items()}
        holes = [hole for structure in self.structures for hole in structure.holes]
        if drains and holes:
            rule.drains = added(Union(holes))
        sides = 1
        if cuts:
            rule.cuts = [added(plane) for plane in self.planes]
            sides = rule.parts
            for both in self.pegs:
                if both is None:
                    rule.pegs.append(None)
                    continue
                peg = added(both[0])
                rule.pegs.append((peg, peg if both[0] is both[1] else added(both[1])))
            if self.bosses:
                rule.bosses = added(Union(self.bosses))
            if self.feet is not None:
                feet = {divmod(part - 1, sides): shape for part, shape in self.feet.shapes.items()}
                rule.feet = {1 + slot * sides + side: number for (slot, side), number in added_by_slot(feet).items()}
        slots.require_fields(len(fields) - slots.count)
        recipe = Recipe(self.lattice, fields, rule, edges)
        mesh, self.crossings, recipe_used = yield from extract_parts_steps(recipe, self.budget)
        self.flats = flats_of(recipe_used, [*rule.cuts, *rule.feet.values()])
        return slots.with_owners(mesh, sides)

    def _walls_steps(self) -> Steps[None]:
        """Find the shapes that thicken thin walls, repeat while some are thin, and note where and by how much."""
        spacing, threads = sum(self.lattice.sides_mm) / 3, self.budget.threads
        shapes: dict[int, list[Thickening]] = {number: [] for number in range(len(self.structures))}
        for again in range(WALL_TRIES):
            mesh = yield from self._extracted_steps()
            for number, before in list(shapes.items()):
                own = mesh.of_label(1 + number)
                thin_walls = yield from thin_walls_steps(own, self.solid.least_wall, spacing, threads, before)
                if not again:
                    self.structures[number].notes += thin_walls.notes
                if thin_walls.shape is None:
                    del shapes[number]
                else:
                    before.append(thin_walls.shape)
                    self.walls[self.structures[number]] = Union(tuple(before))
            if not shapes:
                return

    def _pegs_steps(self, pegs: Pegs) -> Steps[None]:
        """Place the pegs of every cut; start again without structures in which none fit."""
        is_settled = False
        while not is_settled:
            before = self.structures
            self.pegs, self.bosses, self.bars = [], [], []
            notes = yield from self._placed_steps(pegs)
            self._leave_out()
            is_settled = len(self.structures) == len(before)
        for structure, sentences in notes:
            structure.notes += sentences

    def _placed_steps(self, pegs: Pegs) -> Steps[list[tuple[SolidStructure, Sequence[str]]]]:
        """Place the pegs of every cut; return notes on structures."""
        surfaces, solids = [], []
        notes: list[tuple[SolidStructure, Sequence[str]]] = []
        for body in self.bodies:
            surface = yield from body.signed_steps()
            depth = depth_below(surface, self.thicken, threads=self.budget.threads)
            surfaces.append(surface)
            solids.append(Joined(depth, body.mesh.vertices, self.thicken, self.hollow > 0))
        avoid: list[Shape] = [hole for structure in self.structures for hole in structure.holes]
        for number, cut in enumerate(self.solid.cuts):
            cut_pegs = yield from cut_pegs_steps(self.solid, number, solids, avoid)
            for at, placed in cut_pegs.placed:
                notes.append((self.structures[at], placed.notes))
                if self.hollow:
                    self.bosses.append((yield from bosses_steps(placed, pegs, self.hollow, surfaces[at])))
                self.bars += placed.bars
            if cut_pegs.refused and not cut_pegs.placed:
                for at, why in cut_pegs.refused:
                    yield from tried_steps([self.structures[at]], _raising_steps(why), self.all_needed)
            where = numbers_text(cut.point)
            partly = f"Some joints at the cut at {where} have no peg; thinner pegs may fit."
            of_placed = {at for at, _ in cut_pegs.placed}
            refused = {at: partly if at in of_placed else str(why) for at, why in cut_pegs.refused if of_placed}
            notes += [(self.structures[at], [note]) for at, note in refused.items()]
            holes: list[Shape] = [placed.holes for _, placed in cut_pegs.placed]
            avoid += holes
            if not holes:
                self.pegs.append(None)
                continue
            union = Union([placed.pegs for _, placed in cut_pegs.placed])
            # A peg that fills its hole is the same field: two fields with the same zeros leave the part undecided.
            self.pegs.append((union, Union(holes) if pegs.clearance else union))
        return notes

    def _feet_steps(self) -> Steps[None]:
        """Make the feet on which the parts stand without pegs."""
        pegs, self.pegs = self.pegs, []
        mesh = yield from self._extracted_steps(drains=True, cuts=True)
        self.pegs = pegs

        def sides(part: int) -> list[tuple[HalfSpace, float]]:
            return [(plane, -1.0 if (part - 1) >> bit & 1 else 1.0) for bit, plane in enumerate(self.planes)]

        def holes(part: int) -> list[Bar]:
            return self._owner(part).holes

        is_single = len(self.structures) == 1
        self.feet = yield from feet_steps(mesh, self.solid.base, self.lattice, sides, holes, is_single)

    def _stood_steps(self, mesh: ComplexMesh, feet: Feet) -> Steps[ComplexMesh]:
        """Remove pieces that were cut off from feet; keep the notes on how the parts stand."""
        stood, kept, self.standing = yield from stood_steps(mesh, feet)
        left = np.isin(self.crossings, kept).all(axis=1)
        self.crossings = np.searchsorted(kept, self.crossings[left])
        return stood

    def _owner(self, part: int) -> SolidStructure:
        """Return the structure to which a part belongs."""
        return self.structures[(part - 1) >> len(self.planes)]

    def _finished_steps(self, mesh: ComplexMesh) -> Steps[None]:
        """Simplify all parts as one complex, and describe them."""
        described: dict[int, Reconstruction] = {}
        for structure in self.structures:
            own = [part for part in mesh.labels if self._owner(part) is structure]
            if not own:
                error = MeshError(
                    f"nothing is left of {structure.name}; move the surface inward by less, or give smaller drains"
                )
                yield from tried_steps([structure], _raising_steps(error), self.all_needed)
                continue
            notes = (*structure.result.notes, *structure.notes)
            for number, (part, name) in enumerate(part_names(structure.name, own).items()):
                about = (*notes, *self.standing.get(part, ()))
                described[part] = replace(structure.result, label_name=name, part_number=number, notes=about)
        if not described:
            return
        finished = yield from finished_parts_steps(described, mesh, self.crossings, self.flats, self.budget)
        for part, result in finished.items():
            self._owner(part).parts.append(result)


def _raising_steps(error: Exception) -> Steps[None]:
    """Raise an error when the steps run."""
    yield PAUSE
    raise error
