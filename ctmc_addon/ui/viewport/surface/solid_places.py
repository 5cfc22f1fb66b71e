# SPDX-License-Identifier: GPL-3.0-or-later
"""Place the pegs and drains of the panel's solid a few milliseconds at a time, and cache the results by settings.

`core.solid` places them as in the finished solid, but on surfaces as coarse as those of the preview.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import bpy

from ....core import SIMPLIFICATION, CtmcError, Preview, ReconstructionSettings, Steps
from ....core.mesh import SignedSurface
from ....core.solid import PlacedBars, SolidRequest, placed_cuts_pegs_steps, placed_drains_steps
from ...properties.preferences import machine
from ...state import session
from ...state.ct import volumes
from ...state.surface import solids, structures
from . import preview

BUDGETS = 4.0  # Surfaces may take this many times as long as the preview while a slider moves.
MOST_KEPT = 16
Work = tuple[str, Preview, ReconstructionSettings]


@dataclass(frozen=True)
class PlacingKey:
    """Everything that decides where pegs and drains are.

    Parameters
    ----------
    fingerprint : str
        Fingerprint of the CT.
    runs : tuple of ReconstructionSettings
        Settings of the closed surfaces.
    solid : SolidRequest
    """

    fingerprint: str
    runs: tuple[ReconstructionSettings, ...]
    solid: SolidRequest


@dataclass(frozen=True)
class SolidPlaces:
    """Placed pegs and drains; `pegs` is None until they are placed.

    `coarse` is true if their surfaces are coarser than those of the finished solid.
    """

    drains: PlacedBars
    pegs: PlacedBars | None
    coarse: bool

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences for the user about pegs and drains that do not fit."""
        return self.drains.notes + (() if self.pegs is None else self.pegs.notes)


@dataclass
class _Cache:
    """Surfaces and results of earlier placings.

    Parameters
    ----------
    latest : PlacingKey or None
        Key of the latest placing.
    surfaces_of : tuple or None
        CT and settings of the surfaces.
    surfaces : dict of str to SignedSurface
        Surfaces by the name that combinations use for the structure.
    coarse : bool
        Whether the surfaces are coarser than those of the finished solid.
    places : dict of PlacingKey to SolidPlaces
        In the order of placing.
    """

    latest: PlacingKey | None = None
    surfaces_of: Any = None
    surfaces: dict[str, SignedSurface] = field(default_factory=dict)
    coarse: bool = False
    places: dict[PlacingKey, SolidPlaces] = field(default_factory=dict)


_cache = _Cache()


def _key_of(scene: bpy.types.Scene) -> PlacingKey | None:
    """Return the key of a scene's solid; None if there is nothing to place."""
    stored, ct = scene.ctmc_solid, volumes.loaded(scene)
    if ct is None or not (len(stored.drains) or (stored.use_pegs and len(stored.cuts))):
        return None
    try:
        solid = solids.solid_of(scene)
        runs = [_closed(run) for run in solids.runs_of(scene, solid)]
    except CtmcError:  # The panel shows it.
        return None
    return PlacingKey(scene.ctmc.volume_fingerprint, tuple(runs), replace(solid, base=0.0, least_wall=0.0, bed=None))


@lru_cache(maxsize=256)  # Every redraw of the viewport calls it.
def _closed(run: ReconstructionSettings) -> ReconstructionSettings:
    """Return the settings of the closed surface with all triangles."""
    return replace(run.without(SIMPLIFICATION), close_border=True)


def places_of(scene: bpy.types.Scene) -> SolidPlaces | None:
    """Return the placed pegs and drains of a scene; None if there are none yet."""
    key = _key_of(scene)
    return None if key is None else _cache.places.get(key)


def ask(scene: bpy.types.Scene) -> bool:
    """Return whether a placing must begin, and remember it as the latest."""
    key = _key_of(scene)
    if key is None or key == _cache.latest:
        return False
    _cache.latest = key
    return not _is_complete(key)


def is_looking(scene: bpy.types.Scene) -> bool:
    """Return whether pegs or drains of a scene are not placed yet."""
    key = _key_of(scene)
    return key is not None and not _is_complete(key)


def _is_complete(key: PlacingKey) -> bool:
    places = _cache.places.get(key)
    return places is not None and places.pegs is not None


def placing_steps(scene_uid: int) -> Steps[None]:
    """Place pegs and drains of a scene unless that is done; the steps hold no data-block."""
    scene = session.scene_of(scene_uid)
    key = _cache.latest = None if scene is None else _key_of(scene)
    if scene is None or key is None or _is_complete(key):
        return
    works, threads = _works(scene, key.runs), machine().budget.thread_count
    try:
        yield from _surfaces_steps(key, works)
        drains = yield from _drains_steps(key, threads)
        _keep(key, SolidPlaces(drains, None, _cache.coarse))
        pegs = yield from placed_cuts_pegs_steps(_cache.surfaces, key.solid, drains.bars, threads)
        _keep(key, SolidPlaces(drains, pegs, _cache.coarse))
    except CtmcError as error:
        _keep(key, SolidPlaces(PlacedBars(), PlacedBars((), (str(error),)), False))


def _keep(key: PlacingKey, places: SolidPlaces) -> None:
    """Store places, and show them."""
    _cache.places.pop(key, None)
    _cache.places[key] = places
    while len(_cache.places) > MOST_KEPT:
        del _cache.places[next(iter(_cache.places))]
    session.redraw_viewports()


def _works(scene: bpy.types.Scene, runs: Sequence[ReconstructionSettings]) -> list[Work]:
    """Return the name of each structure, as combinations use it, with the preview that makes its surface."""
    ct, limits = volumes.require_loaded(scene), machine()
    makers = [] if preview.state.maker is None else [preview.state.maker]
    works = []
    for run in runs:
        volume = structures.shown_volume_of(scene, run) or ct.volume
        maker = next((maker for maker in makers if maker.volume is volume), None)
        if maker is None:
            maker = Preview(volume, limits.preview_seconds, limits.budget)
            makers.append(maker)
        works.append((str(run.label), maker, ct.for_copy(run)))
    return works


def _surfaces_steps(key: PlacingKey, works: Sequence[Work]) -> Steps[None]:
    """Make the surfaces to place on, unless they exist."""
    surfaces_key = key.fingerprint, key.runs
    if _cache.surfaces_of == surfaces_key:
        return
    surfaces, coarse = {}, False
    for (name, maker, settings), run in zip(works, key.runs, strict=True):
        result = yield from maker.refine_steps(settings, BUDGETS * machine().preview_seconds / len(works))
        if result is None:
            continue
        surfaces[name] = SignedSurface()
        yield from surfaces[name].prepare_steps(result.surface.at(settings.alpha_number))
        coarse = coarse or result.stride != run.stride
    _cache.surfaces_of, _cache.surfaces, _cache.coarse = surfaces_key, surfaces, coarse


def _drains_steps(key: PlacingKey, threads: int) -> Steps[PlacedBars]:
    """Place the drains, unless they were placed with different cuts or pegs."""
    only = _without_cuts(key)
    for earlier, places in _cache.places.items():
        if _without_cuts(earlier) == only and places.drains != PlacedBars():
            return places.drains
    return (yield from placed_drains_steps(_cache.surfaces, key.solid, threads))


def _without_cuts(key: PlacingKey) -> PlacingKey:
    return replace(key, solid=replace(key.solid, cuts=(), pegs=None))


def clear() -> None:
    """Forget all places, because structures were drawn or a new file is loaded."""
    global _cache
    _cache = _Cache()
