# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the parts of a solid: surfaces of structures, what is done to their fields, and the parts' own surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..machine.budget import Budget
from ..maps.make import MAPPING, mapped_steps
from ..maps.quantity import Quantity
from ..maps.request import MapRequest
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import Stages, Steps, equal_part, finish
from ..reconstruction import Reconstruction
from ..settings import SIMPLIFICATION, ReconstructionSettings
from ..structures import structure_names
from ..surfaces.make import make_surfaces_steps
from ..surfaces.request import MadeSurface, SurfaceRequest, share_walls
from ..volume.volume import Volume
from .combine import combined_steps, named_by
from .parts import MAKING, PartsMaking
from .printing.printed import PRINTING, printed_steps
from .request import SolidRequest, require_different_cuts
from .structure import Structure, check_cuts, share_drains_steps

SURFACES = "Surfaces"
MOST_TOGETHER = 4
"""Structures with common walls that are made together, at most."""


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
    require_different_cuts(solid.cuts)
    budget = budget or Budget()
    stages = Stages({SURFACES: 2, MAKING: 3, PRINTING: 1} | ({MAPPING: 1} if maps else {}))
    plain = [
        SurfaceRequest(replace(request.settings.without(SIMPLIFICATION), close_border=True)) for request in requests
    ]
    making = make_surfaces_steps(volume, plain, budget, labels=labels, all_needed=True)
    made = yield from stages.run(SURFACES, making)
    results = [each.result for each in made if isinstance(each, MadeSurface)]
    structures = [
        Structure(
            name,
            replace(result, label_name=name, settings=request.settings, solid=solid),
            volume if request.settings.label is None else labels or volume,
        )
        for name, result, request in zip(_names(volume, results), results, requests, strict=True)
    ]
    parts = yield from stages.run(MAKING, _parts_steps(structures, solid, budget))
    parts = yield from stages.run(PRINTING, printed_steps(parts, solid, budget))
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


def _parts_steps(structures: list[Structure], solid: SolidRequest, budget: Budget) -> Steps[list[Reconstruction]]:
    """Return the parts of all structures: by themselves, or together where they share walls or may overlap."""
    for structure in structures:
        structure.note_cap()
    yield from share_drains_steps(structures, solid)
    if solid.combinations:
        named = named_by(structures, solid)
        combined = yield from combined_steps(named, solid, budget)
        structures = [each for each in structures if each not in named] + combined
    check_cuts(structures, solid)
    plain = [each for each in structures if not each.is_shaped]
    groups = [[structure] for structure in plain]
    if share_walls([structure.result.settings for structure in plain]):
        groups = _touching(plain, solid)
    groups += [[each] for each in structures if each.is_shaped]
    parts: list[Reconstruction] = []
    for number, group in enumerate(groups):
        making = PartsMaking(group, solid, budget).parts_steps()
        parts += yield from equal_part(making, number, len(groups))
    return parts


def _touching(structures: Sequence[Structure], solid: SolidRequest) -> list[list[Structure]]:
    """Return groups of structures that share walls or may grow into each other.

    Where too many do, each is made by itself, with a note.
    """
    grown = max(solid.thicken, 0.0) + solid.base + solid.least_wall / 2
    boxes = {
        each.name: (each.mesh.vertices.min(axis=0) - grown, each.mesh.vertices.max(axis=0) + grown)
        for each in structures
    }

    def meets(first: Structure, second: Structure) -> bool:
        if second.result.settings.label in {neighbor.label for neighbor in first.result.neighbors}:
            return True
        (low, high), (other_low, other_high) = boxes[first.name], boxes[second.name]
        return bool(grown and (low <= other_high).all() and (other_low <= high).all())

    groups: list[list[Structure]] = []
    for structure in structures:
        met = [group for group in groups if any(meets(structure, each) for each in group)]
        groups = [group for group in groups if group not in met]
        groups.append([each for group in met for each in group] + [structure])
    order = {structure.name: at for at, structure in enumerate(structures)}
    groups = [sorted(group, key=lambda each: order[each.name]) for group in groups]
    out: list[list[Structure]] = []
    for group in sorted(groups, key=lambda each: order[each[0].name]):
        if len(group) <= MOST_TOGETHER:
            out.append(group)
            continue
        overlap = f", and may overlap by up to {2 * grown:g} mm" if grown else ""
        for each in group:
            each.notes.append(
                f"{len(group)} structures touch, more than {MOST_TOGETHER}: their parts share no walls{overlap}."
            )
            out.append([each])
    return out
