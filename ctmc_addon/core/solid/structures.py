# SPDX-License-Identifier: GPL-3.0-or-later
"""What is done to structures, in order: thicken, hollow, drain, cut, combine, base, least wall.

What changes the distances that a later step asks for is extracted first, and the later step measures from that surface.
Everything else is one extraction from all fields at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..arrays import Floats
from ..errors import MeshError, SettingsError
from ..machine.budget import Budget
from ..mesh.labels.label_complex import ComplexMesh
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import Stages, Steps
from ..reconstruction import Reconstruction, Stage
from ..surfaces.request import scope_of
from ..volume.affine import to_index
from ..volume.volume import Volume
from .body import Body, OnEdges
from .cells.extract import Recipe, extract_parts_steps
from .fields.depth import Depth, depth_below
from .fields.lattice import Lattice, lattice_around
from .fields.lattice_fields import Field, HeldField, ShapeField
from .fields.shapes import HalfSpace, Shape, Union, require_apart
from .finish import finished_parts_steps, part_names
from .placing.cubes import deepest_steps
from .placing.drains import drains_steps
from .placing.foot import foot_steps
from .placing.least_wall import thin_walls_steps
from .placing.pegs import placed_pegs_steps, require_met, require_wall
from .request import Combination, Combining, SolidRequest
from .rule import PartRule

MAKING = "Making the solid"
"""The stage in which a solid is made of surfaces."""
FLATTEST = 2.0  # A step is at most this many times as long as the shortest.
PER_HOLE = 4  # Steps across a drain or a peg, at least.
BLOCK = 1 << 18


@dataclass(eq=False)
class Structure:
    """A structure that parts are made of.

    Parameters
    ----------
    name : str
    result : Reconstruction
        Its closed surface with all triangles; settings are those of the parts.
    volume : Volume
    notes : list of str
        On its parts.
    """

    name: str
    result: Reconstruction
    volume: Volume
    notes: list[str] = field(default_factory=list)


class PartsMaking:
    """Make the parts of structures that are combined or share walls, or of one."""

    def __init__(self, structures: Sequence[Structure], solid: SolidRequest, budget: Budget) -> None:
        self.structures, self.solid, self.budget = list(structures), solid, budget
        self.thicken, self.hollow = solid.thicken, solid.hollow
        self.planes = [HalfSpace(cut.point, cut.normal) for cut in solid.cuts]

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
        if solid.hollow and solid.pegs is not None:
            require_wall(solid.pegs, solid.hollow)
        require_apart(self.planes)
        for structure in self.structures:
            if _is_capped(structure):
                structure.notes.append("The surface is closed at the border of the volume, as a solid needs that.")
            self._require_met(structure)
        self.lattice = self._lattice()
        meshes = [structure.result.mesh for structure in self.structures]
        self.bodies = yield from self._bodies_steps(meshes)
        if self.thicken and (self.hollow or solid.combinations):
            self.hollow = 0.0
            yield from self._again_steps("--thicken")
            self.thicken, self.hollow = 0.0, solid.hollow
        if solid.combinations:
            if self.hollow:
                yield from self._again_steps("--hollow")
                self.hollow = 0.0
            for combination in solid.combinations:
                yield from self._combine_steps(combination)
        added: dict[int, list[Shape]] = {}
        if solid.least_wall:
            added = yield from self._walls_steps()
        if solid.base:
            added = yield from self._feet_steps(added)
        return (yield from self._extracted_steps(added, everything=True))

    def _require_met(self, structure: Structure) -> None:
        """Raise the error of a cut that misses a structure, if it is the only one."""
        if len(self.structures) == 1:
            for cut in self.solid.cuts:
                require_met(cut, structure.result.mesh.vertices, max(0.0, self.thicken))

    def _lattice(self) -> Lattice:
        """Return a lattice around all structures that is fine enough for what is done to them."""
        solid, first = self.solid, self.structures[0]
        settings, volume = first.result.settings, first.volume
        scope = scope_of(volume, replace(settings, close_border=True))
        steps = max(structure.result.slice_steps for structure in self.structures)
        margin = max(solid.thicken, 0.0) + solid.base + solid.least_wall
        sides = [
            spacing * stride / (steps if axis == 2 else 1)
            for axis, (spacing, stride) in enumerate(zip(volume.spacing, settings.stride, strict=True))
        ]
        widths = [drain.diameter / PER_HOLE for drain in solid.drains]
        if solid.pegs is not None:
            widths.append(solid.pegs.diameter / PER_HOLE)
        if solid.hollow:
            widths.append(solid.hollow)
        longest = min([FLATTEST * min(sides), *widths])
        points = np.concatenate([structure.result.mesh.vertices for structure in self.structures])
        return lattice_around(volume, settings.stride, steps, scope.region, points, margin, longest)

    def _bodies_steps(self, meshes: Sequence[TriangleMesh]) -> Steps[list[Body]]:
        bodies = [Body(mesh, self.lattice, self.budget) for mesh in meshes]
        for body in bodies:
            yield from body.prepare_steps()
        return bodies

    def _again_steps(self, flag: str) -> Steps[None]:
        """Extract the structures as they are by now, so that distances are measured from that."""
        mesh = yield from self._extracted_steps({}, everything=False)
        meshes = []
        for number, structure in enumerate(self.structures):
            own = mesh.of_label(1 + number)
            if not len(own.faces):
                raise MeshError(f"nothing is left of {structure.name} after {flag}; give a smaller distance")
            meshes.append(own)
        self.bodies = yield from self._bodies_steps(meshes)

    def _combine_steps(self, combination: Combination) -> Steps[None]:
        """Make one structure of several."""
        numbers = [self._number_of(name, combination) for name in combination.of]
        first = self.structures[numbers[0]]
        values: Floats | None = None
        for at, number in enumerate(numbers):
            own = yield from self.bodies[number].distances_steps(0.0)
            if values is None:
                values = own.copy()
            elif combination.how is Combining.MERGE:
                np.maximum(values, own, out=values)
            elif combination.how is Combining.INTERSECT:
                np.minimum(values, own, out=values)
            else:
                np.minimum(values, -own, out=values)
            del own, at
        assert values is not None, "a combination has two structures at least"
        edges = _edges_of([self.bodies[number] for number in numbers])
        recipe = Recipe(self.lattice, [HeldField(self.lattice, values)], PartRule(1), {0: edges} if edges else {})
        mesh = (yield from extract_parts_steps(recipe, self.budget)).of_label(1)
        if not len(mesh.faces):
            raise MeshError(f"nothing is left of {combination.name}; {' and '.join(combination.of)} do not overlap")
        notes = [note for number in numbers for note in self.structures[number].notes]
        result = replace(first.result, label_name=combination.name, mesh=mesh, label_color=None)
        joined = Structure(combination.name, result, first.volume, list(dict.fromkeys(notes)))
        [body] = yield from self._bodies_steps([mesh])
        kept = [at for at in range(len(self.structures)) if at not in numbers]
        self.structures = [*(self.structures[at] for at in kept), joined]
        self.bodies = [*(self.bodies[at] for at in kept), body]

    def _number_of(self, name: str, combination: Combination) -> int:
        """Return the number of a structure by its name, or by its label."""
        for number, structure in enumerate(self.structures):
            if name == structure.name or name == str(structure.result.settings.label):
                return number
        there = ", ".join(structure.name for structure in self.structures)
        raise SettingsError(f"--{combination.how.value} {combination.name} needs {name}; the structures are {there}")

    def _extracted_steps(self, added: dict[int, list[Shape]], everything: bool) -> Steps[ComplexMesh]:
        """Extract all parts: number 1 + structure * parts of each + which cuts it is below, as bits.

        `added` are shapes that belong to structures too, within their sides of the cuts; without `everything` nothing
        is drained or cut.
        """
        fields, edges = yield from self._structures_steps()
        rule = PartRule(len(self.bodies))
        if self.hollow:
            for body, structure in zip(self.bodies, self.structures, strict=True):
                hollow = yield from body.field_steps(self.hollow - self.thicken)
                if not any(hollow.above(layer, layer + 1).any() for layer in range(self.lattice.shape[0])):
                    raise SettingsError((yield from self._too_thick_steps(body, structure)))
                rule.hollows.append(len(fields))
                fields.append(hollow)
        for number, shapes in sorted(added.items()):
            rule.added[number] = len(fields)
            fields.append(ShapeField(Union(shapes), self.lattice))
        if everything:
            yield from self._holes_steps(fields, rule)
        return (yield from extract_parts_steps(Recipe(self.lattice, fields, rule, edges), self.budget))

    def _structures_steps(self) -> Steps[tuple[list[Field], dict[int, OnEdges]]]:
        """Return the fields that tell the structures from what is around and from each other."""
        edges = {} if self.thicken else dict.fromkeys(range(len(self.bodies)), _edges_of(self.bodies))
        on_edges = {number: each for number, each in edges.items() if each is not None}
        if len(self.bodies) == 1:
            only = yield from self.bodies[0].field_steps(-self.thicken)
            return [only], on_edges
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

    def _holes_steps(self, fields: list[Field], rule: PartRule) -> Steps[None]:
        """Add the fields of drains, cuts and pegs."""
        solid, avoid = self.solid, []
        depths: list[Depth] = []
        if solid.drains or solid.pegs:
            for body in self.bodies:
                signed = yield from body.signed_steps()
                depths.append(depth_below(signed, self.thicken, self.hollow, self.budget.threads))
        if solid.drains:
            shapes: list[Shape] = []
            for body, structure in zip(self.bodies, self.structures, strict=True):
                signed = yield from body.signed_steps()
                below = depth_below(signed, self.thicken, 0.0, self.budget.threads)
                placed = yield from drains_steps(solid.drains, signed, below, self.hollow, self.thicken)
                structure.notes += placed.notes
                shapes.append(placed.shape)
            avoid += shapes
            rule.drains = len(fields)
            fields.append(ShapeField(Union(shapes), self.lattice))
        for plane in self.planes:
            rule.cuts.append(len(fields))
            fields.append(ShapeField(plane, self.lattice))
        if solid.pegs is None:
            return
        for number, cut in enumerate(solid.cuts):
            others = self.planes[:number] + self.planes[number + 1 :]
            pegs: list[Shape] = []
            holes: list[Shape] = []
            for body, depth, structure in zip(self.bodies, depths, self.structures, strict=True):
                placed_pegs = yield from placed_pegs_steps(
                    cut, solid.pegs, depth, others, body.mesh.vertices, max(0.0, self.thicken), avoid=avoid
                )
                structure.notes += placed_pegs.notes
                pegs.append(placed_pegs.pegs)
                holes.append(placed_pegs.holes)
            avoid += holes
            # Where a peg fills its hole, both are one field: of two that are 0 at the same places no part is certain.
            shapes_of_cut = [pegs, holes] if solid.pegs.clearance else [pegs]
            rule.pegs.append((len(fields), len(fields) + len(shapes_of_cut) - 1))
            fields += [ShapeField(Union(each), self.lattice) for each in shapes_of_cut]

    def _too_thick_steps(self, body: Body, structure: Structure) -> Steps[str]:
        """Return why no hollow is left."""
        signed = yield from body.signed_steps()
        vertices = body.mesh.vertices
        low, high = vertices.min(axis=0).astype(np.float64), vertices.max(axis=0).astype(np.float64)
        _, deepest = yield from deepest_steps(depth_below(signed), low, high)
        return (
            f"a wall of {self.hollow:g} mm leaves no hollow in {structure.name}, which is {deepest:.1f} mm deep at "
            f"most; give a thinner wall, such as --hollow {_rounded_down(deepest / 2)}"
        )

    def _walls_steps(self) -> Steps[dict[int, list[Shape]]]:
        """Return what thickens thin walls, by the structure's number; the notes say where and by how much."""
        mesh = yield from self._extracted_steps({}, everything=False)
        walls: dict[int, list[Shape]] = {}
        for number, structure in enumerate(self.structures):
            own = mesh.of_label(1 + number)
            spacing = sum(self.lattice.sides_mm) / 3
            found = yield from thin_walls_steps(own, self.solid.least_wall, spacing, self.budget.threads)
            structure.notes += found.notes
            if found.shape is not None:
                walls[number] = [found.shape]
        return walls

    def _feet_steps(self, added: dict[int, list[Shape]]) -> Steps[dict[int, list[Shape]]]:
        """Return `added` with a foot for every part, by the structure's number."""
        mesh = yield from self._extracted_steps(added, everything=True)
        feet = {number: list(shapes) for number, shapes in added.items()}
        for part in mesh.labels:
            own = Body(mesh.of_label(part), self.lattice, self.budget)
            signed = yield from own.signed_steps()
            vertices = own.mesh.vertices.astype(np.float64)
            depth = depth_below(signed, threads=self.budget.threads)
            foot = yield from foot_steps(depth, vertices.min(axis=0), vertices.max(axis=0), self.solid.base)
            feet.setdefault((part - 1) // self._per_structure, []).append(foot)
        return feet

    @property
    def _per_structure(self) -> int:
        """Numbers of parts that a structure has."""
        return 1 << len(self.planes)

    def _finished_steps(self, mesh: ComplexMesh) -> Steps[list[Reconstruction]]:
        """Simplify all parts together, and describe them."""
        each = self._per_structure
        owners = {part: self.structures[(part - 1) // each] for part in mesh.labels}
        names: dict[int, str] = {}
        for structure in self.structures:
            names |= part_names(structure.name, [part for part, owner in owners.items() if owner is structure])
        for structure in self.structures:
            if structure not in owners.values():
                raise MeshError(f"nothing is left of {structure.name}; give a smaller distance")
        described = {
            part: replace(owner.result, label_name=names[part], notes=(*owner.result.notes, *owner.notes))
            for part, owner in owners.items()
        }
        return (yield from finished_parts_steps(described, mesh, self.budget))


def _edges_of(bodies: Sequence[Body]) -> OnEdges | None:
    """Return the vertices of all bodies that lie on edges of the lattice, one for each edge."""
    known = [body.on_edges for body in bodies if body.on_edges is not None]
    if len(known) < len(bodies):
        return None
    if len(known) == 1:
        return known[0]
    keys = np.concatenate([each for each, _ in known])
    unique, first = np.unique(keys, return_index=True)
    return unique, np.concatenate([positions for _, positions in known])[first]


def _rounded_down(value: float) -> str:
    scale = 10.0 if value >= 0.2 else 100.0
    return f"{int(value * scale) / scale:g}"


def _is_capped(structure: Structure) -> bool:
    """Return whether a surface was open, and is now closed beyond the samples of its region."""
    result, volume = structure.result, structure.volume
    if result.settings.close_border:
        return False
    scope = scope_of(volume, replace(result.settings, close_border=True))
    for start in range(0, len(result.mesh.vertices), BLOCK):
        index = to_index(volume.affine, result.mesh.vertices[start : start + BLOCK].astype(np.float64))
        for axis, (low, high) in enumerate(scope.region):
            if (index[:, axis] < low - 1e-3).any() or (index[:, axis] > high - 1 + 1e-3).any():
                return True
    return False
