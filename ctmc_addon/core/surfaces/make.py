# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the surfaces of requests: the only place that decides what is made together.

A threshold's surface is made by itself. Labels that share their interfaces are made together, layer by layer: labels
that overlap lie in different layers. Other labels are made several at a time, each by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..errors import CtmcError, LabelError, MemoryLimitError
from ..machine.budget import Budget
from ..maps.quantity import Quantity
from ..maps.request import MapRequest
from ..measures.reconstruction import Reconstruction
from ..mesh.triangle_mesh import TriangleMesh
from ..planning.plan import advised_steps
from ..progress import Stages, Steps, equal_part, finish
from ..settings import SIMPLIFICATION, ReconstructionSettings
from ..sinks import HOLD
from ..volume.labels.extents import label_extents_steps, labels_by_layer_steps
from ..volume.volume import Volume
from .each_label import NoSurfaceError, each_label_steps, without_traceback
from .extract import reconstruct_steps, result_and_full_steps
from .finish import remade_steps
from .request import MadeSurface, Scope, SurfaceRequest, scope_of_labels, share_walls

Outcome = MadeSurface | CtmcError
LARGEST = (1 << 31) - 1  # Interfaces store their two labels as int32.


def reconstruct(
    volume: Volume,
    settings: ReconstructionSettings,
    budget: Budget | None = None,
    maps: Sequence[Quantity] | MapRequest = (),
) -> Reconstruction:
    """Make a surface from a volume.

    Parameters
    ----------
    volume : Volume
        Volume in memory, or in a file that is read a slab at a time. The surface has the same bytes.
    settings : ReconstructionSettings
    budget : Budget, optional
        Threads and memory; by default what the machine has. The result does not depend on them.
    maps : sequence of Quantity or MapRequest
        Maps to make on the surface, such as `[Thickness(), DistanceTo("portal vein")]`.

    Raises
    ------
    CtmcError
        With one sentence for the user: no surface at these settings, NaN voxels, too little memory.

    Examples
    --------
    >>> import numpy as np
    >>> distance = np.sqrt(((np.indices((24, 24, 24)) - 11.5) ** 2).sum(axis=0))
    >>> result = reconstruct(Volume(-distance, np.eye(4)), ReconstructionSettings(threshold=-9))
    >>> result.mesh.closed, round(result.mesh.volume / (4 / 3 * np.pi * 9**3), 2)
    (True, 0.99)
    """
    if not maps:
        return finish(reconstruct_steps(volume, settings, budget))
    making = make_surfaces_steps(volume, [SurfaceRequest(settings)], budget, all_needed=True, maps=MapRequest.of(maps))
    [outcome] = finish(making)
    assert isinstance(outcome, MadeSurface), "an error is raised"
    return outcome.result


def make_surfaces_steps(
    volume: Volume | None,
    requests: Sequence[SurfaceRequest],
    budget: Budget | None = None,
    *,
    labels: Volume | None = None,
    all_needed: bool = False,
    maps: MapRequest | None = None,
) -> Steps[list[Outcome]]:
    """Make surfaces.

    Parameters
    ----------
    volume : Volume or None
        None if every request brings its full surface.
    requests : sequence of SurfaceRequest
        A number of triangles is for all labels of a layer that share interfaces; shared triangles count once.
    budget : Budget, optional
        Threads and memory; by default what the machine has. No surface depends on it.
    labels : Volume, optional
        Volume of the labels; by default `volume`.
    all_needed : bool
        Whether to raise the first error; otherwise it is returned instead of its surface.
    maps : MapRequest, optional
        Maps to make on every surface; all are held.

    Returns
    -------
    list of MadeSurface or CtmcError
        Outcomes in the order of the requests.

    Raises
    ------
    MemoryLimitError
        If a surface does not fit, even by itself.
    CtmcError
        As `reconstruct`.
    """
    budget = budget or Budget()
    if maps is not None and maps.quantities:
        return (yield from _with_maps_steps(volume, requests, budget, labels, all_needed, maps))
    outcomes: dict[int, Outcome] = {}
    groups = _groups(requests)
    for number, group in enumerate(groups):
        members = [requests[at] for at in group]
        source = volume if members[0].settings.label is None else labels or volume
        results = yield from equal_part(_group_steps(source, members, budget, all_needed), number, len(groups))
        outcomes.update(zip(group, results, strict=True))
        errors = [result for result in results if isinstance(result, CtmcError)]
        if errors and all_needed:
            raise errors[0]
    return [outcomes[at] for at in range(len(requests))]


def _with_maps_steps(
    volume: Volume | None,
    requests: Sequence[SurfaceRequest],
    budget: Budget,
    labels: Volume | None,
    all_needed: bool,
    maps: MapRequest,
) -> Steps[list[Outcome]]:
    """Make surfaces, then the maps on those that could be made."""
    from ..maps.make import MAPPING, mapped_steps

    stages = Stages({"Surfaces": 2, MAPPING: 1})
    needs_full = any(quantity.needs_full for quantity in maps.quantities)
    fuller = [replace(each, needs_full=each.needs_full or needs_full, sink=HOLD) for each in requests]
    making = make_surfaces_steps(volume, fuller, budget, labels=labels, all_needed=all_needed)
    outcomes = yield from stages.run("Surfaces", making)
    surfaces = {at: outcome for at, outcome in enumerate(outcomes) if isinstance(outcome, MadeSurface)}
    results = [surface.result for surface in surfaces.values()]
    fulls = [surface.full for surface in surfaces.values() if surface.full is not None]
    held = [(result.settings, result.mesh) for result in results]
    held += [(full.settings.without(SIMPLIFICATION), full.mesh) for full in fulls]

    def surface_steps(settings: ReconstructionSettings) -> Steps[TriangleMesh]:
        for own, mesh in held:
            if own == settings:
                return mesh
        source = volume if settings.label is None else labels or volume
        [outcome] = yield from make_surfaces_steps(source, [SurfaceRequest(settings)], budget, all_needed=True)
        assert isinstance(outcome, MadeSurface), "an error is raised"
        held.append((settings, outcome.result.mesh))
        return outcome.result.mesh

    source = volume if labels is None or requests[0].settings.label is None else labels
    assert source is not None, "maps are made with the volume"
    mapped = yield from stages.run(MAPPING, mapped_steps(source, results, maps, budget, surface_steps))
    for at, result in zip(surfaces, mapped, strict=True):
        outcomes[at] = MadeSurface(result, surfaces[at].full if requests[at].needs_full else None)
    return outcomes


def one_of_labels_steps(
    volume: Volume, settings: ReconstructionSettings, sharing_labels: Sequence[int], budget: Budget
) -> Steps[Reconstruction]:
    """Make one surface again as it is beside the labels that are made at once with it.

    Parameters
    ----------
    volume : Volume
    settings : ReconstructionSettings
        Settings of the surface.
    sharing_labels : sequence of int
        As `Reconstruction.sharing_labels`; a label that is not among them is made by itself.
    budget : Budget

    Raises
    ------
    CtmcError
        If this surface cannot be made; others that cannot are left out.
    """
    labels: list[int | None] = list(sharing_labels) if settings.label in sharing_labels else [settings.label]
    requests = [SurfaceRequest(replace(settings, label=label)) for label in labels]
    outcomes = yield from make_surfaces_steps(volume, requests, budget)
    outcome = outcomes[labels.index(settings.label)]
    if isinstance(outcome, CtmcError):
        raise outcome
    return outcome.result


def _groups(requests: Sequence[SurfaceRequest]) -> list[list[int]]:
    """Return the numbers of requests made at once: labels with the same settings; each other one by itself."""
    groups: dict[object, list[int]] = {}
    for at, request in enumerate(requests):
        is_own = request.settings.label is None or request.full is not None
        groups.setdefault(at if is_own else replace(request.settings, threshold=None, label=None), []).append(at)
    return list(groups.values())


def _group_steps(
    volume: Volume | None, requests: Sequence[SurfaceRequest], budget: Budget, all_needed: bool
) -> Steps[list[Outcome]]:
    if len(requests) == 1:
        return [(yield from _single_steps(volume, requests[0], budget, all_needed))]
    assert volume is not None, "labels are extracted"
    scope = scope_of_labels(volume, requests[0].settings)
    extents = yield from label_extents_steps(volume, scope.region, budget.threads)
    present = [at for at, request in enumerate(requests) if request.settings.label in extents]
    absent = [at for at in range(len(requests)) if at not in present]
    several = present if len(present) > 1 else []
    outcomes: dict[int, Outcome] = {}
    for at in absent if several else absent + present:  # The error of an absent label names those present.
        outcomes[at] = yield from _single_steps(volume, requests[at], budget, all_needed)
    members = [requests[at] for at in several]
    results: list[Outcome] = []
    if share_walls([request.settings for request in members]):
        results = yield from _sharing_steps(volume, scope, members, budget, all_needed)
    elif members:
        results = yield from _each_steps(volume, scope, members, budget)
    outcomes.update(zip(several, results, strict=True))
    return [outcomes[at] for at in range(len(requests))]


def _single_steps(volume: Volume | None, request: SurfaceRequest, budget: Budget, all_needed: bool) -> Steps[Outcome]:
    """Make one surface with all threads; if it does not fit, advise settings that do."""
    settings, sink = request.settings, request.sink
    if request.full is not None:
        making = remade_steps(request.full, settings, budget)
    else:
        assert volume is not None, "a surface is extracted or remade"
        making = advised_steps(
            _one_steps(volume, request, budget), volume, settings, budget, sink, request.written_bytes
        )
    return (yield from _outcome_steps(making, all_needed))


def _outcome_steps(making: Steps[MadeSurface], all_needed: bool) -> Steps[Outcome]:
    """Return the surface, or its error unless all are needed; a lack of memory is always raised."""
    try:
        return (yield from making)
    except CtmcError as error:
        if all_needed or isinstance(error, MemoryLimitError):
            raise
        return without_traceback(error)


def _one_steps(
    volume: Volume, request: SurfaceRequest, budget: Budget, scope: Scope | None = None
) -> Steps[MadeSurface]:
    """Make one surface, and its full surface if requested."""
    if request.needs_full:
        return (yield from result_and_full_steps(volume, request.settings, budget, scope))
    return MadeSurface((yield from reconstruct_steps(volume, request.settings, budget, request.sink, scope)))


def _each_steps(
    volume: Volume, scope: Scope, requests: Sequence[SurfaceRequest], budget: Budget
) -> Steps[list[Outcome]]:
    """Make labels by themselves, several at a time."""

    def work_steps(at: int, own: Budget) -> Steps[MadeSurface]:
        return (yield from _one_steps(volume, requests[at], own, scope))

    runs = [request.settings for request in requests]
    return (yield from each_label_steps(volume, scope.region, runs, work_steps, budget, requests[0].sink))


def _sharing_steps(
    volume: Volume, scope: Scope, requests: Sequence[SurfaceRequest], budget: Budget, all_needed: bool
) -> Steps[list[Outcome]]:
    """Make labels that share their interfaces, layer by layer, then hand each to its sink."""
    from .shared import TouchingLabels

    settings = requests[0].settings
    labels = [request.settings.label for request in requests if request.settings.label is not None]
    layers = yield from labels_by_layer_steps(volume, labels, scope.region, budget.threads)
    stages = Stages({str(at): len(own) for at, (_, own) in enumerate(layers)})
    outcomes: dict[int, Outcome] = {}
    for at, (layer, own) in enumerate(layers):
        if len(own) == 1:
            held = replace(requests[labels.index(own[0])], sink=HOLD)
            lone = _outcome_steps(_one_steps(layer, held, budget, scope), all_needed)
            outcomes[own[0]] = yield from stages.run(str(at), lone)
            continue
        _require_shareable(own)
        try:
            making = TouchingLabels(layer, scope, settings, own, budget, all_needed).result_steps()
            outcomes |= yield from stages.run(str(at), making)
        except NoSurfaceError as error:
            if all_needed:
                raise
            outcomes |= error.errors
    results: list[Outcome] = []
    for label, request in zip(labels, requests, strict=True):
        outcome = outcomes[label]
        if isinstance(outcome, MadeSurface):
            outcome = yield from _taken_steps(_beside(outcome, labels), request)
        results.append(outcome)
    return results


def _beside(surface: MadeSurface, labels: Sequence[int]) -> MadeSurface:
    """Note on a surface and its full one which labels were made with it."""
    result, full = replace(surface.result, sharing_labels=tuple(labels)), surface.full
    return MadeSurface(result, None if full is None else replace(full, sharing_labels=tuple(labels)))


def _require_shareable(labels: Sequence[int]) -> None:
    """Raise `LabelError` if a label is not a positive int32, as shared triangles store it."""
    outside = next((label for label in labels if not 0 < label <= LARGEST), None)
    if outside is not None:
        raise LabelError(
            f"label {outside} cannot share its interfaces, as that takes labels from 1 to {LARGEST}; "
            "set interfaces to separate, or make it alone"
        )


def _taken_steps(surface: MadeSurface, request: SurfaceRequest) -> Steps[MadeSurface]:
    """Hand a held surface to the sink of its request."""
    result = surface.result
    if not request.sink.holds:
        taken = yield from request.sink.mesh_steps(result.mesh)
        result = replace(result, mesh=taken.mesh, surface=None, measured=taken.measured, beyond=None)
    return MadeSurface(result, surface.full if request.needs_full else None)
