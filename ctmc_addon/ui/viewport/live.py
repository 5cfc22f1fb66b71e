"""What follows the settings while nobody has pressed a button: the preview, the price, the surface's own alpha.

A property's update only marks. A timer of `bpy.app.timers`, there only while there is something to do, first follows
with a coarse surface, then, when the hand rests, counts the price and refines, a few tens of milliseconds at a time.
Nothing is written to the file but the alpha of the active surface, which is what its slider is for.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import bpy

from ...blender import refresh_normals
from ...blender.materials import BONE, colour_of
from ...blender.surface import set_alpha
from ...blender.viewport import PreviewSurface, forget_shader
from ...core import (
    CALIBRATION,
    CostEstimate,
    CtmcError,
    FieldCache,
    Preview,
    PreviewResult,
    Reconstruction,
    ReconstructionSettings,
    Steps,
    cost_estimate_steps,
)
from .. import jobs
from ..properties.preferences import machine
from ..state import change_events as marks
from ..state import session, surfaces, volumes

REST = 0.25  # seconds without a change after which the hand rests
TICK = 0.03  # seconds of work between two looks at the events
SOON = 0.01  # seconds to the next tick
SILENT = {"simplifier", "reduction", "target_faces", "max_error_mm"}
"""Changes that leave the preview's surface as it is."""


@dataclass
class Live:
    """What is under way for the scene in sight.

    Parameters
    ----------
    changed : float or None
        When a setting last changed; None once everything has followed.
    stale : bool
        Whether the coarse surface is behind the settings.
    """

    scene: int = 0
    preview: Preview | None = None
    prepared: FieldCache | None = None
    shown: PreviewSurface | None = None
    stride: tuple[int, int, int] = (1, 1, 1)
    colour: tuple[float, float, float] = BONE
    changed: float | None = None
    stale: bool = False
    alpha_moved: bool = False
    work: list[Steps[Any]] = field(default_factory=list)

    def stop_work(self) -> None:
        """Drop what was being refined or counted."""
        for steps in self.work:
            steps.close()
        self.work.clear()


live = Live()


def mark(properties: Any, name: str) -> None:
    """A setting has changed: cheap, for it runs within the slider's own event."""
    scene = properties.id_data
    live.scene = scene.session_uid
    live.changed = time.perf_counter()
    live.stale = live.stale or (name not in SILENT and name != "alpha")
    live.stop_work()
    session.of(scene).price = None
    if name == "alpha":
        live.alpha_moved = True
        move_alpha(scene, properties.alpha)
    if name == "preview" and not properties.preview:
        hide()
    if not bpy.app.background and not bpy.app.timers.is_registered(tick):
        bpy.app.timers.register(tick, first_interval=0.0)


def move_alpha(scene: bpy.types.Scene, alpha: float) -> None:
    """Move the selected surfaces of the scene, through their shape keys, and the preview."""
    context = bpy.context
    if context.scene == scene:
        for thing in surfaces.chosen_surfaces(context):
            if thing.library is None and thing.override_library is None:
                set_alpha(thing, alpha)
    if live.shown is not None:
        live.shown.move(alpha)
        session.redraw_viewports()


def tick() -> float | None:
    """Do a little; None ends the timer."""
    scene = session.scene_of(live.scene)
    if scene is None or live.changed is None:
        live.changed = None
        return None
    if jobs.running() is not None:
        return REST
    if volumes.loaded(scene) is None:
        hide()
        live.changed = None
        return None
    try:
        follow_volume(scene)
        if live.stale:
            live.stale = False
            show(scene, follow(scene))
            return SOON
        if time.perf_counter() - live.changed < REST:
            return REST
        if live.alpha_moved:
            rest_alpha(scene)
        return advance(scene)
    except CtmcError as error:
        session.of(scene).price = error
        live.stop_work()
        session.redraw_panels()
        live.changed = None
        return None


def advance(scene: bpy.types.Scene) -> float | None:
    """Count, then refine, a few steps at a time."""
    if not live.work:
        live.work = [price_work(scene), refine_work(scene)]
    stop = time.perf_counter() + TICK
    while live.work:
        try:
            next(live.work[0])
        except StopIteration:
            live.work.pop(0)
            session.redraw_panels()
        if time.perf_counter() > stop:
            return SOON
    live.changed = None  # everything has followed: no timer is left
    return None


def follow_volume(scene: bpy.types.Scene) -> None:
    """Prepare for another volume, if the scene has one."""
    loaded = volumes.loaded(scene)
    assert loaded is not None, "the caller has looked"
    if live.preview is not None and live.preview.volume is loaded.volume:
        return
    limits = machine()
    live.shown = None
    live.preview = Preview(loaded.volume, limits.preview_seconds, limits.threads, limits.memory_limit)
    live.prepared = FieldCache(loaded.volume, limits.threads, limits.memory_limit)


def follow(scene: bpy.types.Scene) -> PreviewResult | None:
    """A coarse surface for the settings as they are now; None where the preview is off or there is none."""
    settings = wanted(scene)
    if settings is None or live.preview is None:
        return None
    live.preview.budget = machine().preview_seconds
    return live.preview.interactive(settings)


def wanted(scene: bpy.types.Scene) -> ReconstructionSettings | None:
    """The settings to preview, or None."""
    try:
        return scene.ctmc.all_settings()[0] if scene.ctmc.preview else None
    except CtmcError:
        return None


def show(scene: bpy.types.Scene, found: PreviewResult | None) -> None:
    """Put a surface on the graphics card when Blender draws next."""
    settings = scene.ctmc
    live.shown = None
    if found is not None:
        live.shown = PreviewSurface(found.surface, settings.alpha, machine().scale)
        live.stride = found.stride
        label = settings.label if settings.use_label else None
        live.colour = settings.colour_of(label) or colour_of(label)
    session.redraw_viewports()


def hide() -> None:
    """Show no preview."""
    if live.shown is not None:
        live.shown = None
        session.redraw_viewports()


def refine_work(scene: bpy.types.Scene) -> Steps[None]:
    """A finer surface, now that there is time."""
    settings = wanted(scene)
    if settings is not None and live.preview is not None:
        found = yield from live.preview.refine_steps(settings)
        if found is not None and live.shown is not None:
            show(scene, found)


def price_work(scene: bpy.types.Scene) -> Steps[None]:
    """What the settings would cost, all surfaces together."""
    assert live.prepared is not None, "follow_volume has made it"
    runs = tuple(scene.ctmc.all_settings())
    prices: list[CostEstimate] = []
    for settings in runs:
        prices.append((yield from cost_estimate_steps(live.prepared, settings)))
    session.of(scene).price = Bill(runs, tuple(prices))


@dataclass(frozen=True)
class Bill:
    """The prices of all surfaces wanted, and the settings they hold for."""

    settings: tuple[ReconstructionSettings, ...]
    prices: tuple[CostEstimate, ...]

    @property
    def voxels(self) -> int:
        """To visit, for all of them."""
        return sum(price.voxels for price in self.prices)

    @property
    def faces(self) -> int:
        """Triangles of all of them, before simplification."""
        return sum(price.faces for price in self.prices)

    @property
    def memory(self) -> int:
        """Bytes of the dearest."""
        return max(price.memory for price in self.prices)

    @property
    def seconds(self) -> float:
        """Together."""
        return sum(price.seconds for price in self.prices)

    @property
    def fits(self) -> bool:
        """Whether there is memory enough for each."""
        return all(price.fits for price in self.prices)

    @property
    def sentence(self) -> str:
        """Why not."""
        return next((price.sentence for price in self.prices if not price.fits), "")


def learn(scene: int, made: list[Reconstruction], seconds: float) -> None:
    """Next time's price is measured on what these surfaces have cost, `seconds` together after their last stages.

    Each has its share of these by its triangles: a small one beside a large one would make every triangle look dear.
    """
    where = session.scene_of(scene)
    bill = None if where is None else session.of(where).price
    if not isinstance(bill, Bill):
        return
    prices = dict(zip(bill.settings, bill.prices, strict=True))
    known = [(prices[result.settings], result) for result in made if result.settings in prices]
    faces = max(1, sum(price.faces for price, _ in known))
    for price, result in known:
        CALIBRATION.learn(price, result, seconds * price.faces / faces)


def rest_alpha(scene: bpy.types.Scene) -> None:
    """Alpha has come to rest: before Blender 4.5 shading is set right now."""
    live.alpha_moved = False
    for thing in surfaces.chosen_surfaces(bpy.context) if bpy.context.scene == scene else ():
        if thing.library is None and thing.mode == "OBJECT":
            refresh_normals(thing)


def draw() -> None:
    """Draw the preview in a viewport of its scene, unless a finished surface stands in its place."""
    context = bpy.context
    if live.shown is None or context.scene.session_uid != live.scene or volumes.current(context.scene) is None:
        return
    view = context.region_data
    live.shown.draw(view.perspective_matrix, view.view_matrix, live.colour)


_handlers: list[Any] = []


def forget(*_: Any) -> None:
    """Another file, or undo has changed the settings behind our back: nothing shown counts any more."""
    live.stop_work()
    live.changed = None
    live.shown = None
    live.preview = live.prepared = None


def follow_undo(*_: Any) -> None:
    """Undo may have changed any setting."""
    scene = bpy.context.scene
    if live.shown is not None and scene is not None:
        mark(scene.ctmc, "threshold")


def register() -> None:
    """Listen for changes; draw where there is a window."""
    marks.listen(mark)
    persistent = bpy.app.handlers.persistent
    bpy.app.handlers.load_pre.append(persistent(forget))
    for handlers in (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post):
        handlers.append(persistent(follow_undo))
    if not bpy.app.background:
        _handlers.append(bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", "POST_VIEW"))


def unregister() -> None:
    """Leave no timer, no handler and no picture."""
    marks.forget(mark)
    if bpy.app.timers.is_registered(tick):
        bpy.app.timers.unregister(tick)
    forget()
    bpy.app.handlers.load_pre.remove(forget)
    for handlers in (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post):
        handlers.remove(follow_undo)
    while _handlers:
        bpy.types.SpaceView3D.draw_handler_remove(_handlers.pop(), "WINDOW")
    forget_shader()
