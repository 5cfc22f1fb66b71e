# SPDX-License-Identifier: GPL-3.0-or-later
"""Follow the settings without a button: preview, cost estimate, and alpha of the selected surfaces.

A property's update only marks. A timer of `bpy.app.timers`, there only while there is something to do, first shows a
coarse surface, then, once nothing has changed for a moment, counts the cost and refines, a few tens of milliseconds at
a time. Nothing is written to the file but the alpha of the selected surfaces, which is what its slider is for.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import bpy

from ....blender.viewport import free_shader
from ....core import LEAVE_IT, CtmcError, FieldCache, ReconstructionSettings, SettingsError, Steps
from ... import jobs
from ...properties.described import as_written
from ...properties.preferences import machine
from ...state import change_events, session
from ...state.ct import volumes
from ...state.draw import masks
from ...state.surface import solids, structures
from ...state.surface.cost_estimates import CostEstimates, estimate_steps
from ..draw import drawn
from . import alpha, preview, solid_places

IDLE = 0.25  # Seconds without a change before costs are counted and the preview is refined.
TICK = 0.03  # Seconds of work between two checks for events.
SOON = 0.01  # Seconds to the next tick.


@dataclass
class Live:
    """Work in progress for the scene that changed last.

    Parameters
    ----------
    changed : float or None
        Time of the last change of a setting; None once everything is up to date.
    stale : bool
        Whether the coarse surface is behind the settings.
    uncounted : bool
        Whether costs are to be counted and the preview refined, or nothing but the solid has changed.
    work : list of Steps
        They hold no data-block, which undo would invalidate.
    """

    scene: int = 0
    fields: FieldCache | None = None
    other_fields: FieldCache | None = None
    changed: float | None = None
    stale: bool = False
    uncounted: bool = False
    alpha_moved: bool = False
    work: list[Steps[None]] = field(default_factory=list)

    def stop_work(self) -> None:
        """Drop unfinished refinement and cost counting."""
        for steps in self.work:
            steps.close()
        self.work.clear()


live = Live()


def mark(properties: Any, name: str) -> None:
    """Note that a setting has changed; this is cheap, because it runs within the slider's own event."""
    if name == "window":
        return
    if name == change_events.RELEASED:  # Every scene is told; the preview is of the present one.
        clear()
        if bpy.context.scene is not None:
            start(bpy.context.scene, stale=True)
        return
    scene = properties.id_data
    if name == change_events.COMBINED:
        _follow_combinations(scene)
        return
    if name == change_events.DRAWN:
        solid_places.clear()
    if name in (change_events.NAME, change_events.COLOR):
        preview.recolor(scene)
        return
    start(scene, stale=name not in LEAVE_IT and not (name == change_events.DRAWN and _shows_drawn(scene)))
    if name == "alpha":
        live.alpha_moved = True
        alpha.move(scene, as_written(properties.alpha))
    if name == "preview" and not properties.preview:
        preview.hide()


def follow_solid(scene: bpy.types.Scene) -> None:
    """Look for the places of a solid that has changed."""
    if solid_places.ask(scene):
        start(scene, stale=False, uncounted=False)


def _follow_combinations(scene: bpy.types.Scene) -> None:
    """Count again if combinations name other structures than before."""
    cost: CostEstimates | None = session.of(scene).cost
    try:
        counted = cost is not None and tuple(solids.counted_runs(scene)) == cost.settings
    except SettingsError:
        counted = False
    if not counted:
        start(scene, stale=False)


def _shows_drawn(scene: bpy.types.Scene) -> bool:
    """Return whether the preview is of a drawn structure, which has a preview of its own."""
    settings = preview.settings_of(scene)
    return settings is not None and drawn.shows(scene, settings.label)


def start(scene: bpy.types.Scene, stale: bool, uncounted: bool = True) -> None:
    """Follow the settings of a scene from now on.

    Parameters
    ----------
    scene : bpy.types.Scene
    stale : bool
        Whether the preview's surface is outdated.
    uncounted : bool
        Whether its cost and finer surface are.
    """
    live.stop_work()
    live.scene, live.changed, live.stale = scene.session_uid, time.perf_counter(), live.stale or stale
    live.uncounted = live.uncounted or uncounted
    if uncounted:
        session.of(scene).cost = None
    if not bpy.app.background and not bpy.app.timers.is_registered(tick):
        bpy.app.timers.register(tick, first_interval=0.0)


def tick() -> float | None:
    """Work for a few milliseconds; return the seconds to the next call, or None to end the timer."""
    scene = session.scene_of(live.scene)
    if scene is None or live.changed is None:
        live.changed = None
        return None
    if jobs.running() is not None or masks.stroke_under_way():
        return IDLE
    loaded = volumes.loaded(scene)
    if loaded is None:
        preview.hide()
        live.changed = None
        return None
    try:
        return advance(scene, loaded)
    except (CtmcError, MemoryError) as error:
        session.of(scene).cost = CostEstimates((), error=jobs.sentence_of(error))
        live.stop_work()
        session.redraw_panels()
        live.changed = None
        return None


def advance(scene: bpy.types.Scene, loaded: volumes.Loaded) -> float | None:
    """Update the preview; once nothing changes, count the cost, then refine, a few steps at a time."""
    budget = machine().budget
    preview_settings = preview.settings_of(scene)
    volume = (
        None if preview_settings is None else structures.shown_volume_of(scene, preview_settings)
    ) or loaded.volume
    if live.fields is None or live.fields.volume is not volume or live.fields.budget != budget:
        preview.prepare(volume)
        live.fields, live.other_fields = FieldCache(volume, budget), None
    if live.stale:
        live.stale = False
        preview.follow(scene)
        return SOON
    if live.changed is not None and time.perf_counter() - live.changed < IDLE:
        return IDLE
    if live.alpha_moved:
        live.alpha_moved = False
        alpha.settle(scene)
    if not live.work:
        live.work = [solid_places.placing_steps(live.scene)]
        if live.uncounted:
            settings = tuple(solids.counted_runs(scene))
            works = [(fields_of(scene, run), run) for run in settings]
            counting = [cost_steps(live.scene, works)] if loaded.file is None else []
            live.work = [*counting, preview.refine_steps(live.scene, preview_settings), *live.work]
    stop = time.perf_counter() + TICK
    while live.work:
        try:
            next(live.work[0])
        except StopIteration:
            live.work.pop(0)
            live.uncounted = live.uncounted and len(live.work) > 1
            session.redraw_panels()
        if live.work and time.perf_counter() > stop:
            return SOON
    live.changed = None  # Everything is up to date, so no timer is left.
    return None


def fields_of(scene: bpy.types.Scene, settings: ReconstructionSettings) -> FieldCache:
    """Return the fields in which to count the cost of a surface; labels and gray values have separate ones."""
    volume = structures.shown_volume_of(scene, settings)
    assert live.fields is not None, "advance has made them"
    assert volume is not None, "a CT is loaded"
    if live.fields.volume is volume:
        return live.fields
    if live.other_fields is None or live.other_fields.volume is not volume:
        live.other_fields = FieldCache(volume, live.fields.budget)
    return live.other_fields


def cost_steps(scene_uid: int, works: list[tuple[FieldCache, ReconstructionSettings]]) -> Steps[None]:
    """Count what surfaces would cost, for the panel."""
    cost = yield from estimate_steps(works)
    scene = session.scene_of(scene_uid)
    if scene is not None:
        session.of(scene).cost = cost


def clear(*_: Any) -> None:
    """Drop all work and the preview, because another file is loaded."""
    live.stop_work()
    live.changed = live.fields = live.other_fields = None
    solid_places.clear()
    preview.state.shown = preview.state.maker = None
    preview.state.requested = False


def _before_undo(*_: Any) -> None:
    """Stop counting before undo brings back another state of the file."""
    live.stop_work()


def after_undo(*_: Any) -> None:
    """Follow the settings again after undo, which may have changed any of them, and removed the previewed surface."""
    scene = bpy.context.scene
    if scene is not None and volumes.loaded(scene) is not None:
        start(scene, stale=preview.state.requested or not preview.is_made(bpy.context, hidden=True))


def after_load(*_: Any) -> None:
    """Make preview and cost estimate for an opened file whose CT is still in memory."""
    scene = bpy.context.scene
    if scene is not None and volumes.loaded(scene) is not None:
        start(scene, stale=True)


_follow, _ignore = change_events.following(
    mark,
    load_pre=clear,
    load_post=after_load,
    undo_pre=_before_undo,
    redo_pre=_before_undo,
    undo_post=after_undo,
    redo_post=after_undo,
)
_drawing: list[Any] = []


def register() -> None:
    """Subscribe to changes, and draw if there is a window."""
    _follow()
    if not bpy.app.background:
        _drawing.append(bpy.types.SpaceView3D.draw_handler_add(preview.draw, (), "WINDOW", "POST_VIEW"))


def unregister() -> None:
    """Remove timer, handlers and pictures."""
    _ignore()
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
    clear()
    while _drawing:
        bpy.types.SpaceView3D.draw_handler_remove(_drawing.pop(), "WINDOW")
    free_shader()
