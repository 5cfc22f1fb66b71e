# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the parts of a solid: extract surfaces, apply the operations to their fields, and extract the parts."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace
from typing import NamedTuple

from ..errors import LabelError, MeshError, ThresholdError
from ..machine.budget import Budget
from ..maps.make import MAPPING, mapped_steps
from ..maps.quantity import Quantity
from ..maps.request import MapRequest
from ..measures.reconstruction import Reconstruction
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import Stages, Steps, equal_part, finish
from ..settings import SIMPLIFICATION, ReconstructionSettings
from ..structures import structure_names
from ..surfaces.each_label import left_out, no_surface, without
from ..surfaces.make import make_surfaces_steps
from ..surfaces.request import MadeSurface, SurfaceRequest, share_walls
from ..volume.volume import Volume
from .combine import Combined, combined_steps, named_by
from .parts import PartsMaking
from .printing.printed import PRINTING, printed_steps
from .request import SolidRequest, require_different_cuts
from .structure import MAKING, SolidStructure, check_cuts, share_drains_steps

SURFACES = "Surfaces"


class MadeParts(NamedTuple):
    """Parts of a solid, and the reasons why structures were left out.

    Parameters
    ----------
    parts : list of Reconstruction
        In the order of structures; `label_name` is the name of the part, such as "hip a".
    left_out : list of str
        A sentence for each structure that could not be made; empty if all are needed.
    """

    parts: list[Reconstruction]
    left_out: list[str]


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
        Settings of the surfaces that the solid is made from; these are closed at the border, and only the parts are
        simplified.
    solid : SolidRequest
    labels : sequence of int
        Labels to make the solid from; by default the surface of the settings.
    budget : Budget, optional
    maps : sequence of Quantity or MapRequest
        Maps to make on the parts.

    Returns
    -------
    list of Reconstruction
        Parts, in the order of structures; `label_name` is the name of the part, such as "hip a".

    Raises
    ------
    CtmcError
        If a structure cannot be made; the first one is reported.
    """
    numbers = [replace(settings, threshold=None, label=label) for label in labels] or [settings]
    requests = [SurfaceRequest(each) for each in numbers]
    making = solid_parts_steps(volume, requests, solid, budget, maps=MapRequest.of(maps), all_needed=True)
    return finish(making).parts


def solid_parts_steps(
    volume: Volume,
    requests: Sequence[SurfaceRequest],
    solid: SolidRequest,
    budget: Budget | None = None,
    *,
    labels: Volume | None = None,
    maps: MapRequest | None = None,
    all_needed: bool = False,
) -> Steps[MadeParts]:
    """Make the parts as `solid_parts` does, in steps; closing the generator cancels.

    All parts are held in memory: the sinks of the requests are ignored. Unless `all_needed`, structures that cannot be
    made are left out.
    """
    require_different_cuts(solid.cuts)
    budget = budget or Budget()
    stages = Stages({SURFACES: 2, MAKING: 3, PRINTING: 1} | ({MAPPING: 1} if maps else {}))
    plain = [
        SurfaceRequest(replace(request.settings.without(SIMPLIFICATION), close_border=True)) for request in requests
    ]
    all_needed = all_needed or len(requests) == 1
    making = make_surfaces_steps(volume, plain, budget, labels=labels, all_needed=all_needed)
    outcomes = yield from stages.run(SURFACES, making)
    surfaces, errors = [], {}
    for request, outcome in zip(requests, outcomes, strict=True):
        if isinstance(outcome, MadeSurface):
            surfaces.append((request.settings, outcome.result))
        elif isinstance(outcome, (LabelError, MeshError, ThresholdError)) and request.settings.label is not None:
            errors[request.settings.label] = outcome
        else:
            raise outcome
    if not surfaces:
        raise no_surface(labels or volume, errors)
    structures = [
        SolidStructure(
            name,
            replace(result, label_name=name, settings=settings, solid=solid),
            volume if settings.label is None else labels or volume,
        )
        for name, (settings, result) in zip(_names(volume, [result for _, result in surfaces]), surfaces, strict=True)
    ]
    sentences = [left_out(labels or volume, label, error) for label, error in errors.items()]
    absent = {name for label in errors for name in (str(label), (labels or volume).label_names.get(label, ""))}
    shaping = _structures_steps(structures, solid, budget, all_needed, absent)
    structures, of_combinations = yield from stages.run(MAKING, shaping)
    parts = [part for structure in structures for part in structure.parts]
    sentences += [_left_out(structure) for structure in structures if structure.error is not None]
    sentences += of_combinations
    if not parts:
        raise MeshError(f"no structure of {(labels or volume).name} can be made; {sentences[0]}")
    parts = yield from stages.run(PRINTING, printed_steps(parts, solid, budget))
    if not maps:
        return MadeParts(parts, sentences)

    def surface_steps(settings: ReconstructionSettings) -> Steps[TriangleMesh]:
        source = volume if settings.label is None else labels or volume
        [outcome] = yield from make_surfaces_steps(source, [SurfaceRequest(settings)], budget, all_needed=True)
        assert isinstance(outcome, MadeSurface), "an error is raised"
        return outcome.result.mesh

    mapped = yield from stages.run(MAPPING, mapped_steps(volume, parts, maps, budget, surface_steps))
    return MadeParts(mapped, sentences)


def _left_out(structure: SolidStructure) -> str:
    """Return the sentence that says why a structure was left out."""
    label = structure.result.settings.label
    assert structure.error is not None
    if label is None or structure.is_combined:
        return without(structure.name, structure.error)
    return left_out(structure.volume, label, structure.error)


def _names(volume: Volume, results: Sequence[Reconstruction]) -> list[str]:
    """Return the name of every structure: that of its label, or of the volume."""
    if len(results) == 1 and results[0].settings.label is None:
        return [volume.name]
    return list(structure_names(results))


def _structures_steps(
    structures: list[SolidStructure], solid: SolidRequest, budget: Budget, all_needed: bool, absent: Container[str]
) -> Steps[Combined]:
    """Make the parts of all structures, each by itself unless some share walls or may overlap.

    `absent` holds the names and numbers of labels without a surface.
    """
    left_out: list[str] = []
    for structure in structures:
        structure.note_cap()
    yield from share_drains_steps(structures, solid)
    if solid.combinations:
        named = named_by(structures, solid, absent)
        combined, left_out = yield from combined_steps(named, solid, budget, all_needed)
        structures = [each for each in structures if each not in named] + combined
    left = [each for each in structures if each.error is None]
    check_cuts(left, solid)
    plain = [each for each in left if not each.is_shaped]
    groups = [[structure] for structure in plain]
    if share_walls([structure.result.settings for structure in plain]):
        groups = _touching(plain, solid)
    groups += [[each] for each in left if each.is_shaped]
    for number, group in enumerate(groups):
        making = PartsMaking(group, solid, budget, all_needed).parts_steps()
        yield from equal_part(making, number, len(groups))
    return Combined(structures, left_out)


def _touching(structures: Sequence[SolidStructure], solid: SolidRequest) -> list[list[SolidStructure]]:
    """Return groups of structures that share walls or may grow into each other."""
    grown = max(solid.thicken, 0.0) + solid.base + solid.least_wall / 2
    boxes = {
        each.name: (each.mesh.vertices.min(axis=0) - grown, each.mesh.vertices.max(axis=0) + grown)
        for each in structures
    }

    def meets(first: SolidStructure, second: SolidStructure) -> bool:
        if second.result.settings.label in {neighbor.label for neighbor in first.result.neighbors}:
            return True
        (low, high), (other_low, other_high) = boxes[first.name], boxes[second.name]
        return bool(grown and (low <= other_high).all() and (other_low <= high).all())

    groups: list[list[SolidStructure]] = []
    for structure in structures:
        met = [group for group in groups if any(meets(structure, each) for each in group)]
        groups = [group for group in groups if group not in met]
        groups.append([each for group in met for each in group] + [structure])
    order = {structure.name: at for at, structure in enumerate(structures)}
    groups = [sorted(group, key=lambda each: order[each.name]) for group in groups]
    return sorted(groups, key=lambda group: order[group[0].name])
