# SPDX-License-Identifier: GPL-3.0-or-later
"""Find where pegs and drains of the panel's solid will be, a few milliseconds at a time, and keep it by settings.

They are placed as core does in the making, on surfaces as coarse as the preview's while a slider moves.
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

BUDGETS = 4.0  # Surfaces may take this many times what the preview may while a slider moves.
MOST_KEPT = 16
Work = tuple[str, Preview, ReconstructionSettings]


@dataclass(frozen=True)
class Wanted:
    """What the places depend on.

    Parameters
    ----------
    fingerprint : str
        Of the CT.
    runs : tuple of ReconstructionSettings
        Of the closed surfaces.
    solid : SolidRequest
    """

    fingerprint: str
    runs: tuple[ReconstructionSettings, ...]
    solid: SolidRequest


@dataclass(frozen=True)
class Places:
    """Pegs and drains; `pegs` is None while they are looked for.

    `coarse` if the surfaces they were placed on are coarser than those of the making.
    """

    drains: PlacedBars
    pegs: PlacedBars | None
    coarse: bool

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences for the user about what does not fit."""
        return self.drains.notes + (() if self.pegs is None else self.pegs.notes)


@dataclass
class _Found:
    """What was found.

    Parameters
    ----------
    asked : Wanted or None
        Places that are looked for, or were last.
    surfaces_of : tuple or None
        CT and settings of the surfaces.
    surfaces : dict of str to SignedSurface
        By the name of their structure, as combinations call it.
    coarse : bool
        Whether they are coarser than those of the making.
    places : dict of Wanted to Places
        The last ones last.
    """

    asked: Wanted | None = None
    surfaces_of: Any = None
    surfaces: dict[str, SignedSurface] = field(default_factory=dict)
    coarse: bool = False
    places: dict[Wanted, Places] = field(default_factory=dict)


_found = _Found()


def wanted(scene: bpy.types.Scene) -> Wanted | None:
    """Return what the places of a scene's solid depend on; None if there is nothing to place."""
    stored, ct = scene.ctmc_solid, volumes.loaded(scene)
    if ct is None or not (len(stored.drains) or (stored.use_pegs and len(stored.cuts))):
        return None
    try:
        solid = solids.solid_of(scene)
        runs = [_closed(run) for run in solids.runs_of(scene, solid)]
    except CtmcError:  # Said in the panel.
        return None
    return Wanted(scene.ctmc.volume_fingerprint, tuple(runs), replace(solid, base=0.0, least_wall=0.0, bed=None))


@lru_cache(maxsize=256)  # The viewport asks at every redraw.
def _closed(run: ReconstructionSettings) -> ReconstructionSettings:
    """Return the settings of the closed surface with all triangles."""
    return replace(run.without(SIMPLIFICATION), close_border=True)


def places_of(scene: bpy.types.Scene) -> Places | None:
    """Return the places in a scene; None if they are not known yet, or there are none."""
    asked = wanted(scene)
    return None if asked is None else _found.places.get(asked)


def ask(scene: bpy.types.Scene) -> bool:
    """Return whether there are places to look for that were not asked for before."""
    asked = wanted(scene)
    if asked is None or asked == _found.asked:
        return False
    _found.asked = asked
    return not _is_complete(asked)


def is_looking(scene: bpy.types.Scene) -> bool:
    """Return whether the places of a scene are not known yet."""
    asked = wanted(scene)
    return asked is not None and not _is_complete(asked)


def _is_complete(asked: Wanted) -> bool:
    places = _found.places.get(asked)
    return places is not None and places.pegs is not None


def placing_steps(scene_uid: int) -> Steps[None]:
    """Find the places in a scene, unless they are known; the steps hold no data-block."""
    scene = session.scene_of(scene_uid)
    asked = _found.asked = None if scene is None else wanted(scene)
    if scene is None or asked is None or _is_complete(asked):
        return
    works, threads = _works(scene, asked.runs), machine().budget.thread_count
    try:
        yield from _surfaces_steps(asked, works)
        drains = yield from _drains_steps(asked, threads)
        _keep(asked, Places(drains, None, _found.coarse))
        pegs = yield from placed_cuts_pegs_steps(_found.surfaces, asked.solid, drains.bars, threads)
        _keep(asked, Places(drains, pegs, _found.coarse))
    except CtmcError as error:
        _keep(asked, Places(PlacedBars(), PlacedBars((), (str(error),)), False))


def _keep(asked: Wanted, places: Places) -> None:
    """Keep places, and show them."""
    _found.places.pop(asked, None)
    _found.places[asked] = places
    while len(_found.places) > MOST_KEPT:
        del _found.places[next(iter(_found.places))]
    session.redraw_viewports()


def _works(scene: bpy.types.Scene, runs: Sequence[ReconstructionSettings]) -> list[Work]:
    """Return the name of each structure, as combinations call it, with the preview that makes its surface."""
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


def _surfaces_steps(asked: Wanted, works: Sequence[Work]) -> Steps[None]:
    """Make the surfaces to place on, unless they are there."""
    key = asked.fingerprint, asked.runs
    if _found.surfaces_of == key:
        return
    made, coarse = {}, False
    for (name, maker, settings), run in zip(works, asked.runs, strict=True):
        result = yield from maker.refine_steps(settings, BUDGETS * machine().preview_seconds / len(works))
        if result is None:
            continue
        made[name] = SignedSurface()
        yield from made[name].prepare_steps(result.surface.at(settings.alpha_number))
        coarse = coarse or result.stride != run.stride
    _found.surfaces_of, _found.surfaces, _found.coarse = key, made, coarse


def _drains_steps(asked: Wanted, threads: int) -> Steps[PlacedBars]:
    """Place the drains, unless they were placed with other cuts or pegs."""
    only = _without_cuts(asked)
    for known, places in _found.places.items():
        if _without_cuts(known) == only and places.drains != PlacedBars():
            return places.drains
    return (yield from placed_drains_steps(_found.surfaces, asked.solid, threads))


def _without_cuts(asked: Wanted) -> Wanted:
    return replace(asked, solid=replace(asked.solid, cuts=(), pegs=None))


def clear() -> None:
    """Forget all places, because structures were drawn or another file is loaded."""
    global _found
    _found = _Found()
