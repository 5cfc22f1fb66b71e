# SPDX-License-Identifier: GPL-3.0-or-later
"""A structure that parts are made from, and the lattice around several of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import CtmcError, MeshError, SettingsError
from ..machine.budget import Budget
from ..measures.reconstruction import Reconstruction
from ..measures.units import mm_text
from ..mesh.distance.signed_distance import SignedSurface
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import Steps
from ..surfaces.each_label import without_traceback
from ..surfaces.request import scope_of
from ..volume.affine import to_index
from ..volume.volume import Volume
from .body import Body, OnEdges
from .cells.extract import extract_parts_steps
from .cells.recipe import Recipe
from .fields.depth import depth_below
from .fields.lattice import Lattice, lattice_around, steps_in, with_box
from .fields.lattice_fields import LatticeField
from .fields.shapes import Bar
from .placing.cubes import deepest_steps
from .placing.drains import drains_steps
from .placing.pegs import heights_of, require_met
from .request import Drain, SolidRequest
from .rule import PartRule

MAKING = "Making the solid"
"""The stage in which a solid is made from surfaces."""
FLATTEST = 2.0  # A step is at most this many times as long as the shortest one.
PER_HOLE = 4  # The lattice has at least this many steps across a drain or a peg.
BLOCK = 1 << 18


@dataclass(eq=False)
class SolidStructure:
    """A structure that parts are made from.

    Parameters
    ----------
    name : str
    result : Reconstruction
        Its closed surface with all triangles, and the settings of the parts.
    volume : Volume
    notes : list of str
        Notes on its parts.
    drains : tuple of Drain
        Drains that open it.
    holes : list of Bar
        Placed drains.
    is_shaped : bool
        Whether its surface has been thickened and made hollow.
    is_combined : bool
        Whether it was combined from several structures.
    parts : list of Reconstruction
        Its finished parts.
    error : CtmcError or None
        Error that left it without parts.
    """

    name: str
    result: Reconstruction
    volume: Volume
    notes: list[str] = field(default_factory=list)
    drains: tuple[Drain, ...] = ()
    holes: list[Bar] = field(default_factory=list)
    is_shaped: bool = False
    is_combined: bool = False
    parts: list[Reconstruction] = field(default_factory=list)
    error: CtmcError | None = None

    @property
    def mesh(self) -> TriangleMesh:
        """Closed surface of the structure."""
        return self.result.mesh

    def note_cap(self) -> None:
        """Add a note if the surface was closed at the border against its settings."""
        result, volume = self.result, self.volume
        if result.settings.close_border:
            return
        scope = scope_of(volume, replace(result.settings, close_border=True))
        for start in range(0, len(self.mesh.vertices), BLOCK):
            index = to_index(volume.affine, self.mesh.vertices[start : start + BLOCK].astype(np.float64))
            for axis, (low, high) in enumerate(scope.region):
                if (index[:, axis] < low - 1e-3).any() or (index[:, axis] > high - 1 + 1e-3).any():
                    where = "volume" if result.settings.region is None else "region"
                    self.notes.append(
                        f"The surface is closed at the border of the {where}, because a solid must be closed."
                    )
                    return


def tried_steps(structures: Sequence[SolidStructure], working: Steps[None], all_needed: bool = False) -> Steps[None]:
    """Run the steps of `working`; store an error of lengths or shapes in the structures unless all are needed."""
    try:
        yield from working
    except (MeshError, SettingsError) as error:
        if all_needed:
            raise
        for structure in structures:
            structure.error = structure.error or without_traceback(error)


def check_cuts(structures: Sequence[SolidStructure], solid: SolidRequest) -> None:
    """Raise an error for a cut that misses all structures; note it on those that it misses otherwise."""
    for cut in solid.cuts:
        beyond = 0.0 if any(each.is_shaped for each in structures) else solid.thicken
        missed = []
        for structure in structures:
            low, high = heights_of(cut, structure.mesh.vertices, beyond)
            if not low < 0 < high:
                missed.append(structure)
        if structures and len(missed) == len(structures):
            require_met(cut, structures[0].mesh.vertices, beyond)
        for structure in missed:
            structure.notes.append(f"The cut at {' '.join(f'{at:g}' for at in cut.point)} misses this structure.")


def share_drains_steps(structures: Sequence[SolidStructure], solid: SolidRequest) -> Steps[None]:
    """Give each drain with a point to the structure that holds the point, and drains without a point to all."""
    if len(structures) == 1:
        structures[0].drains = solid.drains
        return
    surfaces = []
    for structure in structures if any(drain.point is not None for drain in solid.drains) else ():
        surfaces.append(SignedSurface())
        yield from surfaces[-1].prepare_steps(structure.mesh)
    shared = yield from shared_drains_steps(surfaces, solid.drains)
    for structure, own in zip(structures, shared or [solid.drains] * len(structures), strict=True):
        structure.drains = own


def shared_drains_steps(surfaces: Sequence[SignedSurface], drains: Sequence[Drain]) -> Steps[list[tuple[Drain, ...]]]:
    """Return the drains of each surface: drains whose point is nearest to it, then all drains without a point."""
    given = [drain for drain in drains if drain.point is not None]
    nearest = dict.fromkeys(range(len(given)), (np.inf, 0))
    for number, surface in enumerate(surfaces if given else ()):
        distances, _ = yield from surface.distances_steps(np.array([drain.point for drain in given], np.float64))
        for at, distance in enumerate(distances.tolist()):
            if distance < nearest[at][0]:
                nearest[at] = distance, number
    automatic = [drain for drain in drains if drain.point is None]
    return [
        (*(drain for at, drain in enumerate(given) if nearest[at][1] == number), *automatic)
        for number in range(len(surfaces))
    ]


def lattice_of(structures: Sequence[SolidStructure], solid: SolidRequest) -> Lattice:
    """Return a lattice around structures, fine enough for walls and surfaces but not yet for holes."""
    first = structures[0]
    settings, volume = first.result.settings, first.volume
    scope = scope_of(volume, replace(settings, close_border=True))
    steps = max(structure.result.slice_steps for structure in structures)
    points = np.concatenate([structure.mesh.vertices for structure in structures])
    if solid.base:  # A foot goes straight down, and from one side to another.
        points = with_box(points)
    longest = _longest_step(sides_of(structures), solid)
    return lattice_around(volume, settings.stride, steps, scope.region, points, margin_of(solid), longest)


def margin_of(solid: SolidRequest) -> float:
    """Return how far the parts of structures may reach beyond these, mm."""
    return max(solid.thicken, 0.0) + solid.base + solid.least_wall


def sides_of(structures: Sequence[SolidStructure]) -> tuple[float, float, float]:
    """Return the steps of the samples that structures were extracted from along x, y and z, mm."""
    first = structures[0]
    x, y, z = (
        spacing * stride for spacing, stride in zip(first.volume.spacing, first.result.settings.stride, strict=True)
    )
    return x, y, z / max(structure.result.slice_steps for structure in structures)


def divisions(sides_mm: Sequence[float], solid: SolidRequest) -> tuple[int, int, int]:
    """Return the number of lattice steps in a voxel with these sides along x, y and z."""
    longest = _longest_step(sides_mm, solid)
    x, y, z = (steps_in(side, longest) for side in sides_mm)
    return x, y, z


def _longest_step(sides_mm: Sequence[float], solid: SolidRequest) -> float:
    """Return the longest step that a solid allows for voxels with these sides, mm."""
    return min(FLATTEST * min(sides_mm), solid.hollow or math.inf)


def refined_around(lattice: Lattice, bars: Sequence[Bar]) -> Lattice:
    """Return the lattice with enough steps across every bar."""
    for bar in bars:
        lattice = lattice.refined(bar.box, 2 * bar.radius / PER_HOLE)
    return lattice


def body_steps(mesh: TriangleMesh, lattice: Lattice, budget: Budget, around: Lattice | None = None) -> Steps[Body]:
    """Return the body of a mesh on a lattice, prepared."""
    body = Body(mesh, lattice, budget, around)
    yield from body.prepare_steps()
    return body


def bulged_steps(structure: SolidStructure, body: Body, thicken: float) -> Steps[None]:
    """Prepare the body of a structure for thickening.

    The surface of a label already encloses the volume of its samples in spite of chords; one of gray values does not.
    """
    if thicken and structure.result.settings.label is None:
        yield from body.bulge_steps()


def extracted_steps(
    fields: Sequence[LatticeField], rule: PartRule, on_edges: OnEdges | None, body: Body, name: str, flag: str
) -> Steps[Body]:
    """Extract a body from fields on the same lattice, so that distances start at its surface.

    `on_edges` are exact positions of the first field's surface; `name` and `flag` are for the error if nothing is left.
    """
    recipe = Recipe(body.lattice, fields, rule, {} if on_edges is None else {0: on_edges})
    extracted = yield from extract_parts_steps(recipe, body.budget)
    mesh = extracted.mesh.of_label(1)
    if not len(mesh.faces):
        raise MeshError(f"nothing is left of {name} after {flag}; give a distance closer to 0")
    return (yield from body_steps(mesh, body.lattice, body.budget))


def hollow_steps(structure: SolidStructure, body: Body, wall: float, thicken: float) -> Steps[LatticeField]:
    """Return the field of a structure's hollow."""
    hollow = yield from body.field_steps(wall - thicken)
    if any(hollow.above(layer, layer + 1).any() for layer in range(body.lattice.shape[0])):
        return hollow
    signed = yield from body.signed_steps()
    low, high = (np.asarray(each, np.float64) for each in (body.mesh.vertices.min(0), body.mesh.vertices.max(0)))
    _, deepest = yield from deepest_steps(depth_below(signed, thicken), low, high)
    thinner = float(f"{deepest / 2.1:.2g}")
    raise SettingsError(
        f"a wall of {mm_text(wall)} leaves no hollow in {structure.name}, which is {mm_text(deepest, 3)} deep at most; "
        f"give a thinner wall, such as --hollow {thinner:g}"
    )


def drain_steps(structure: SolidStructure, body: Body, wall: float, thicken: float) -> Steps[None]:
    """Place the drains of a structure."""
    if not structure.drains:
        return
    signed = yield from body.signed_steps()
    below = depth_below(signed, thicken, 0.0, body.budget.threads)
    placed = yield from drains_steps(structure.drains, signed, below, wall, thicken)
    structure.notes += placed.notes
    structure.holes += placed.bars
