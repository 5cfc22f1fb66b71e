# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the parts of a solid: surfaces of structures, what is done to their fields, and the parts' own surfaces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..arrays import Flags
from ..errors import MeshError, SettingsError
from ..machine.budget import Budget
from ..maps.make import MAPPING, mapped_steps
from ..maps.quantity import Quantity
from ..maps.request import MapRequest
from ..mesh.labels.label_complex import ComplexMesh
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import Stages, Steps, equal_part, finish
from ..reconstruction import Reconstruction
from ..settings import SIMPLIFICATION, ReconstructionSettings
from ..structures import structure_names
from ..surfaces.make import make_surfaces_steps
from ..surfaces.request import MadeSurface, Scope, SurfaceRequest, scope_of
from ..volume.volume import Volume
from .body import Body
from .depth import Depth, depth_below
from .drains import drains_steps
from .extract import Recipe, extract_parts_steps
from .fields import Field, ShapeField
from .finish import finished_parts_steps
from .hollows import deepest_steps
from .lattice import lattice_around
from .pegs import placed_pegs_steps, require_met
from .request import SolidRequest
from .shapes import HalfSpace

SURFACES, SOLIDS = "Surfaces", "Making the solid"
FLATTEST = 2.0  # A step is at most this many times as long as the shortest.
PER_HOLE = 4  # Steps across a drain or a peg, at least.


def solid_parts(
    volume: Volume,
    settings: ReconstructionSettings,
    solid: SolidRequest,
    labels: Sequence[int] = (),
    budget: Budget | None = None,
    maps: Sequence[Quantity] | MapRequest = (),
) -> list[Reconstruction]:
    """Make the parts of a solid.

    Parameters
    ----------
    volume : Volume
    settings : ReconstructionSettings
        Of the surfaces that the solid is made from, which are closed at the border; simplification is that of the
        parts.
    solid : SolidRequest
    labels : sequence of int
        Labels to make it of; by default the surface of the settings.
    budget : Budget, optional
    maps : sequence of Quantity or MapRequest
        Maps to make on the parts.

    Returns
    -------
    list of Reconstruction
        Parts, structure by structure; `label_name` is the name of the part, such as "hip a".

    Raises
    ------
    CtmcError
        With one sentence for the user.
    """
    chosen = [replace(settings, threshold=None, label=label) for label in labels] or [settings]
    requests = [SurfaceRequest(each) for each in chosen]
    return finish(solid_parts_steps(volume, requests, solid, budget, maps=MapRequest.of(maps)))


def solid_parts_steps(
    volume: Volume,
    requests: Sequence[SurfaceRequest],
    solid: SolidRequest,
    budget: Budget | None = None,
    *,
    labels: Volume | None = None,
    maps: MapRequest | None = None,
) -> Steps[list[Reconstruction]]:
    """`solid_parts` as steps; closing the generator cancels. Sinks of the requests are ignored: all parts are held."""
    budget = budget or Budget()
    stages = Stages({SURFACES: 2, SOLIDS: 3} | ({MAPPING: 1} if maps else {}))
    plain = [
        SurfaceRequest(replace(request.settings.without(SIMPLIFICATION), close_border=True)) for request in requests
    ]
    making = make_surfaces_steps(volume, plain, budget, labels=labels, all_needed=True)
    made = yield from stages.run(SURFACES, making)
    results = [each.result for each in made if isinstance(each, MadeSurface)]
    named = [
        replace(result, label_name=name, settings=request.settings)
        for result, name, request in zip(results, _names(volume, results), requests, strict=True)
    ]
    parts = yield from stages.run(SOLIDS, _parts_steps(volume, labels or volume, named, solid, budget))
    if not maps:
        return parts

    def surface_steps(settings: ReconstructionSettings) -> Steps[TriangleMesh]:
        source = volume if settings.label is None else labels or volume
        [other] = yield from make_surfaces_steps(source, [SurfaceRequest(settings)], budget, all_needed=True)
        assert isinstance(other, MadeSurface), "an error is raised"
        return other.result.mesh

    return (yield from stages.run(MAPPING, mapped_steps(volume, parts, maps, budget, surface_steps)))


def _names(volume: Volume, results: Sequence[Reconstruction]) -> list[str]:
    """Return the name of every structure: its label's, or the volume's."""
    if len(results) == 1 and results[0].settings.label is None:
        return [volume.name]
    return list(structure_names(results))


def _parts_steps(
    volume: Volume, labels: Volume, results: Sequence[Reconstruction], solid: SolidRequest, budget: Budget
) -> Steps[list[Reconstruction]]:
    """Return the parts of all structures, one structure after the other."""
    parts: list[Reconstruction] = []
    for number, result in enumerate(results):
        source = volume if result.settings.label is None else labels
        making = _Making(source, result, solid, budget).parts_steps()
        parts += yield from equal_part(making, number, len(results))
    return parts


class _Making:
    """Make the parts of one structure."""

    def __init__(self, volume: Volume, result: Reconstruction, solid: SolidRequest, budget: Budget) -> None:
        self.volume, self.result, self.solid, self.budget = volume, result, solid, budget
        self.notes: list[str] = []
        settings = result.settings
        if not settings.close_border and (
            result.mesh.vertices.size
            and _at_border(volume, scope_of(volume, replace(settings, close_border=True)), result)
        ):
            self.notes.append("The surface is closed at the border of the volume, as a solid needs that.")

    def parts_steps(self) -> Steps[list[Reconstruction]]:
        """Return the parts."""
        solid = self.solid
        body = self._body(self.result.mesh)
        yield from body.prepare_steps()
        for cut in solid.cuts:
            require_met(cut, body.mesh.vertices, max(0.0, solid.thicken))
        if solid.thicken and solid.hollow:
            body = yield from self._offset_steps(body, solid.thicken)
            thicken = 0.0
        else:
            thicken = solid.thicken
        mesh = yield from self._extracted_steps(body, thicken)
        return (yield from finished_parts_steps(self.result, mesh, self.notes, solid, self.budget))

    def _body(self, mesh: TriangleMesh) -> Body:
        """Return the structure on a lattice that is fine enough for what is done to it."""
        solid, settings, volume = self.solid, self.result.settings, self.volume
        scope = scope_of(volume, replace(settings, close_border=True))
        margin = max(solid.thicken, 0.0) + solid.base + solid.least_wall / 2
        sides = [
            spacing * stride / (self.result.slice_steps if axis == 2 else 1)
            for axis, (spacing, stride) in enumerate(zip(volume.spacing, settings.stride, strict=True))
        ]
        widths = [drain.diameter / PER_HOLE for drain in solid.drains]
        if solid.pegs is not None:
            widths.append(solid.pegs.diameter / PER_HOLE)
        if solid.hollow:
            widths.append(solid.hollow)
        longest = min([FLATTEST * min(sides), *widths])
        lattice = lattice_around(
            volume, settings.stride, self.result.slice_steps, scope.region, mesh.vertices, margin, longest
        )
        return Body(mesh, lattice, self.budget)

    def _offset_steps(self, body: Body, thicken: float) -> Steps[Body]:
        """Return a structure with its surface moved outward."""
        fields = yield from body.fields_steps([-thicken])
        return (yield from self._again_steps(body, fields))

    def _again_steps(self, body: Body, fields: Sequence[Field]) -> Steps[Body]:
        """Return the structure that one field says, on the same lattice."""
        recipe = Recipe(body.lattice, fields, lambda above: above[0].astype(np.uint8), {})
        mesh = (yield from extract_parts_steps(recipe, self.budget)).of_label(1)
        if not len(mesh.faces):
            raise MeshError(f"nothing is left of {self.result.label_name} after --thicken {self.solid.thicken:g}")
        body = Body(mesh, body.lattice, self.budget)
        yield from body.prepare_steps()
        return body

    def _extracted_steps(self, body: Body, thicken: float) -> Steps[ComplexMesh]:
        """Return the parts' surfaces, numbered from 1 on: part a is above all cuts."""
        solid, lattice = self.solid, body.lattice
        levels = [-thicken] + ([solid.hollow] if solid.hollow else [])
        structure = yield from body.fields_steps(levels)
        fields: list[Field] = [*structure]
        if solid.hollow and not any(field_any(structure[1], layer) for layer in range(lattice.shape[0])):
            raise SettingsError((yield from self._too_thick_steps(body)))
        depth: Depth | None = None
        if solid.drains or solid.pegs:
            signed = yield from body.signed_steps()
            depth = depth_below(signed, thicken, solid.hollow, self.budget.threads)
        drains = None
        avoid = []
        if solid.drains:
            below = depth_below(signed, thicken, 0.0, self.budget.threads)
            placed = yield from drains_steps(solid.drains, signed, below, solid.hollow, thicken)
            self.notes += placed.notes
            avoid.append(placed.shape)
            drains = len(fields)
            fields.append(ShapeField(placed.shape, lattice))
        planes = [HalfSpace(cut.point, cut.normal) for cut in solid.cuts]
        first_cut = len(fields)
        fields += [ShapeField(plane, lattice) for plane in planes]
        pegs: list[int] = []
        if solid.pegs is not None and depth is not None:
            for number, cut in enumerate(solid.cuts):
                others = planes[:number] + planes[number + 1 :]
                pegged = yield from placed_pegs_steps(
                    cut, solid.pegs, depth, others, body.mesh.vertices, max(0.0, thicken), avoid=avoid
                )
                self.notes += pegged.notes
                avoid.append(pegged.holes)
                pegs.append(len(fields))
                fields += [ShapeField(pegged.pegs, lattice), ShapeField(pegged.holes, lattice)]
        part_of = _part_of(bool(solid.hollow), drains, first_cut, len(planes), pegs)
        on_edges = {0: body.on_edges} if body.on_edges is not None and not thicken else {}
        recipe = Recipe(lattice, fields, part_of, on_edges)
        return (yield from extract_parts_steps(recipe, self.budget))

    def _too_thick_steps(self, body: Body) -> Steps[str]:
        """Return why no hollow is left."""
        signed = yield from body.signed_steps()
        vertices = body.mesh.vertices
        low, high = vertices.min(axis=0).astype(np.float64), vertices.max(axis=0).astype(np.float64)
        _, deepest = yield from deepest_steps(depth_below(signed), low, high)
        return (
            f"a wall of {self.solid.hollow:g} mm leaves no hollow in {self.result.label_name}, which is "
            f"{deepest:.1f} mm deep at most; give a thinner wall, such as --hollow {_rounded_down(deepest / 2)}"
        )


def field_any(field: Field, layer: int) -> bool:
    """Return whether a layer has a sample above 0."""
    return bool(field.above(layer, layer + 1).any())


def _rounded_down(value: float) -> str:
    digits = 1 if value >= 0.2 else 2
    scale = 10.0**digits
    return f"{int(value * scale) / scale:g}"


def _part_of(
    is_hollow: bool, drains: int | None, first_cut: int, cuts: int, pegs: Sequence[int]
) -> Callable[[list[Flags]], NDArray[np.integer]]:
    """Return the rule that says which part a point belongs to, by the signs of the fields."""

    def part(above: list[Flags]) -> NDArray[np.integer]:
        solid = above[0] & ~above[1] if is_hollow else above[0].copy()
        if drains is not None:
            solid &= ~above[drains]
        number = np.ones(solid.shape, np.int64)
        for cut in range(cuts):
            is_above = above[first_cut + cut]
            if pegs:
                peg, hole = above[pegs[cut]], above[pegs[cut] + 1]
                solid = solid & (is_above | peg | ~hole)
                is_above = is_above | peg
            number = number + (~is_above).astype(np.int64) * (1 << cut)
        return np.where(solid, number, 0)

    return part


def _at_border(volume: Volume, scope: Scope, result: Reconstruction) -> bool:
    """Return whether a closed surface reaches beyond the samples of its region."""
    from ..volume.affine import to_index

    for start in range(0, len(result.mesh.vertices), 1 << 18):
        index = to_index(volume.affine, result.mesh.vertices[start : start + (1 << 18)].astype(np.float64))
        for axis, (low, high) in enumerate(scope.region):
            if (index[:, axis] < low - 1e-3).any() or (index[:, axis] > high - 1 + 1e-3).any():
                return True
    return False
