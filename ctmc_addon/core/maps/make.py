# SPDX-License-Identifier: GPL-3.0-or-later
"""Make maps on finished surfaces; no other module does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..errors import MeshError
from ..machine.budget import Budget
from ..measures.reconstruction import Reconstruction, Stage
from ..measures.units import length_text
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import Stages, Steps
from ..settings import ReconstructionSettings
from ..volume.volume import Volume
from .quantity import MappedSurface, Quantity
from .request import MapRequest
from .surface_map import NO_LIMITS, SurfaceMap, range_of, statistics_of, vertex_areas

MAPPING = "Making maps"
"""The stage in which the maps of a surface are made."""


def mapped_steps(
    volume: Volume,
    results: Sequence[Reconstruction],
    request: MapRequest,
    budget: Budget,
    surface_steps: Callable[[ReconstructionSettings], Steps[TriangleMesh]],
) -> Steps[list[Reconstruction]]:
    """Return surfaces with maps; the colors of a map have the same range on all surfaces.

    Parameters
    ----------
    volume : Volume
    results : sequence of Reconstruction
        Held in memory, in RAS+ mm.
    request : MapRequest
    budget : Budget
    surface_steps : callable
        Makes a surface of the volume from settings.

    Raises
    ------
    CtmcError
        If a quantity cannot be calculated.
    """
    stages = Stages({f"{at}": 1 for at in range(len(results))})
    mapped = []
    for at, result in enumerate(results):
        if result.measured is not None:
            raise MeshError("the surface is already written, and maps need it in memory; make it again with the maps")
        working = _maps_steps(volume, result, request, budget, surface_steps)
        maps = yield from stages.run(f"{at}", working)
        mapped.append((maps, Stage(MAPPING, stages.seconds[f"{at}"])))
    ranged = _with_ranges([maps for maps, _ in mapped], request)
    return [
        replace(result, maps=maps, stages=(*result.stages, stage), notes=_notes_of(result, maps))
        for result, (_, stage), maps in zip(results, mapped, ranged, strict=True)
    ]


def _notes_of(result: Reconstruction, maps: Sequence[SurfaceMap]) -> tuple[str, ...]:
    nearest = [
        f"{each.name}: the nearest points are {length_text(each.nearest_distance)} apart"
        for each in maps
        if each.nearest_distance is not None
    ]
    return (*result.notes, *(f"{each.name}: {note}" for each in maps for note in each.notes), *nearest)


def _maps_steps(
    volume: Volume,
    result: Reconstruction,
    request: MapRequest,
    budget: Budget,
    surface_steps: Callable[[ReconstructionSettings], Steps[TriangleMesh]],
) -> Steps[list[SurfaceMap]]:
    """Return the maps of one surface, without ranges."""
    surface = MappedSurface(result.mesh, result.settings, volume, budget, surface_steps)
    areas = vertex_areas(result.mesh)
    stages = Stages({quantity.name: 1 for quantity in request.quantities})
    maps = []
    for quantity in request.quantities:
        values, nearest, notes = yield from stages.run(quantity.name, quantity.values_steps(surface))
        values = np.where(np.isfinite(values), values, np.float32(np.nan))
        limits = request.limits.get(quantity.name, NO_LIMITS)
        maps.append(
            SurfaceMap(
                name=quantity.name,
                unit=quantity.unit,
                values=values,
                range=(0.0, 1.0),
                ramp=_ramp_of(quantity, request),
                statistics=statistics_of(values, areas, limits),
                limits=limits,
                nearest=nearest,
                notes=notes,
            )
        )
    return maps


def _ramp_of(quantity: Quantity, request: MapRequest) -> str:
    ramp = request.ramp if quantity.name == request.shown else None
    return ramp or quantity.ramp


def _with_ranges(all_maps: Sequence[Sequence[SurfaceMap]], request: MapRequest) -> list[tuple[SurfaceMap, ...]]:
    """Return the maps of every surface; maps with the same name share a range."""
    ranges = {}
    for at, first in enumerate(all_maps[0] if all_maps else ()):
        if request.range is not None and first.name == request.shown:
            ranges[first.name] = request.range
        else:
            ranges[first.name] = range_of(np.concatenate([maps[at].values for maps in all_maps]), first.ramp)
    return [tuple(replace(each, range=ranges[each.name]) for each in maps) for maps in all_maps]
