# SPDX-License-Identifier: GPL-3.0-or-later
"""One driver for every long operator: modal with a timer in a window, all at once in a script.

A job is a generator of steps that returns a function, its conclusion. Nothing is written to the scene before the
conclusion runs, so a job that is cancelled leaves the scene as it was. Closing a job waits for its threads, which
know NumPy alone, so none is left either.

Esc and the window wait for a step at most, so steps are short: `python -m benchmarks.steps` measures them all. Steps in
a thread of their own would leave the window free for longer, but not Esc: NumPy cannot be stopped in the midst of a
call, so the thread would have to be left running, and Blender's own calls must not be made in one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import bpy

from ..core import CtmcError, Step, Steps, finish
from .needs import Needs
from .state import change_events, session
from .translations import translate, translate_sentence

Conclusion = Callable[[], str]
"""Writes to the scene at the job's last moment and returns the message of success."""

TAB = "CTMC"
"""The tab in the sidebar."""
TICK = 0.04  # Seconds of work between two checks for events.
# While a job keeps objects of its own in the file, only these events get past it: navigation changes nothing there.
NAVIGATION = {"MOUSEMOVE", "INBETWEEN_MOUSEMOVE", "MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "TRACKPADPAN"}
START = Step(0.0, "Starting")
SHOWN = 0.2  # Seconds between two pictures of the progress; drawing may take longer than the work between two checks.
INTERVAL = 0.005  # Seconds between the end of one tick and the next, in which the window draws and responds.
NO_MEMORY = "there is not enough memory for this; use a larger stride, a region, or close other programs"


@dataclass
class Job:
    """Work in progress in a window, identified by the `bl_idname` of its operator."""

    operator: str
    title: str
    steps: Steps[Conclusion]
    scene: int
    timer: Any = None
    step: Step = field(default=START)
    stopped: bool = False
    locks: bool = False
    workspaces: set[str] = field(default_factory=set)
    shown: str = ""
    shown_at: float = -math.inf

    def advance(self, seconds: float | None = None) -> Conclusion | None:
        """Work for about this long, by default `TICK`, and return the conclusion once the work is complete.

        No step begins that would exceed the rest of the time if it took as long as the last one. The next step is shown
        before it begins, because it may take long.
        """
        now, shown = time.perf_counter(), self.step.message
        end = now + (TICK if seconds is None else seconds)
        while True:
            before = now
            try:
                self.step = next(self.steps)
            except StopIteration as done:
                return done.value
            now = time.perf_counter()
            if now + (now - before) >= end or self.step.message != shown:
                return None

    @property
    def text(self) -> str:
        """Return the text for the status bar: 'Reconstruct Surface: Finding active voxels, 43 %'."""
        return f"{translate(self.title)}: {translate(self.step.message)}, {self.step.fraction:.0%}"


_running: list[Job] = []


def running(*operators: str) -> Job | None:
    """Return the job in progress if it is of one of these operators, by default of any."""
    job = _running[0] if _running else None
    return job if job is not None and (not operators or job.operator in operators) else None


def locked() -> bool:
    """Return whether the job in progress keeps objects of its own in the file, which undo and saving must not see."""
    job = running()
    return job is not None and job.locks


def start(job: Job, context: bpy.types.Context) -> None:
    """Give a job its timer and the status bar."""
    _running.append(job)
    job.timer = context.window_manager.event_timer_add(INTERVAL, window=context.window)
    show(job, context)


def show(job: Job, context: bpy.types.Context) -> None:
    """Show the progress of a job in the status bar and the panel, unless its stage was shown a moment ago."""
    now = time.perf_counter()
    if job.step.message == job.shown and now - job.shown_at < SHOWN:
        return
    job.shown, job.shown_at = job.step.message, now
    workspace = context.workspace
    if workspace is not None:
        job.workspaces.add(workspace.name)
        workspace.status_text_set(text=f"{job.text}   ({translate('Esc cancels')})")
    session.redraw_panels()


def stop(job: Job) -> None:
    """End a job, finished or not: its generator, its timer, its text in the status bar."""
    if job.stopped:
        return
    job.stopped = True
    if job in _running:
        _running.remove(job)
    job.steps.close()
    if job.timer is not None:
        bpy.context.window_manager.event_timer_remove(job.timer)
        job.timer = None
    for workspace in bpy.data.workspaces:
        if workspace.name in job.workspaces:
            workspace.status_text_set(text=None)
    session.redraw_panels()


def stop_running(*_: Any) -> None:
    """End the job in progress, because another file is loaded or the extension is disabled."""
    job = running()
    if job is not None:
        stop(job)


def _stop_locked(*_: Any) -> None:
    """End a job that keeps objects in the file, because another window undoes or saves."""
    if locked():
        stop_running()


def harmless(context: bpy.types.Context, event: Any) -> bool:
    """Return whether an event changes nothing in the file: navigation, or a click in the tab, where Cancel is."""
    if event.type.startswith(("TIMER", "WINDOW")):
        return True
    if event.type in NAVIGATION:
        return not (event.ctrl or event.alt)
    if event.type != "LEFTMOUSE":
        return False
    return any(
        region.type == "UI"
        and getattr(region, "active_panel_category", TAB) == TAB
        and 0 <= event.mouse_x - region.x < region.width
        and 0 <= event.mouse_y - region.y < region.height
        for area in context.screen.areas
        if area.type == "VIEW_3D"
        for region in area.regions
    )


def sentence_of(error: Exception) -> str:
    """Return the message of an error for the user; Python's own `MemoryError` has none."""
    return translate(NO_MEMORY) if isinstance(error, MemoryError) else translate_sentence(str(error))


def refuse(operator: Any, scene: int, error: Exception) -> set[str]:
    """Report an error, at the bottom and in the panel, where it stays."""
    sentence = sentence_of(error)
    still_there = session.scene_of(scene)
    if still_there is not None:
        setattr(session.of(still_there), getattr(operator, "message_field", "message"), sentence)
    operator.report({"ERROR"}, sentence)
    session.redraw_panels()
    return {"CANCELLED"}


class LongOperator(Needs):
    """Base of operators with long work, before `bpy.types.Operator`; they give `plan`."""

    windowed = False
    """True if a user started it in a window."""
    locks = False
    """True if it keeps objects of its own in the file between two steps, which nothing else may change meanwhile."""
    message_field = "message"
    """Field of `Session` that keeps its error."""

    def plan(self, context: bpy.types.Context) -> Steps[Conclusion]:
        """Read the context once, and return the work."""
        raise NotImplementedError

    def execute(self: Any, context: bpy.types.Context) -> set[str]:
        """Do the whole work; after a file dialog in a window, begin it."""
        if self.windowed:
            return self.begin(context)
        scene = context.scene.session_uid
        try:
            message = finish(self.plan(context))()
        except (CtmcError, MemoryError) as error:
            return refuse(self, scene, error)
        self.report({"INFO"}, message)
        return {"FINISHED"}

    def invoke(self: Any, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        return self.begin(context)

    def begin(self: Any, context: bpy.types.Context) -> set[str]:
        """Start the job and its timer; without a window, do it all."""
        if bpy.app.background or context.window is None:
            self.windowed = False
            return self.execute(context)
        if running() is not None:
            self.report({"ERROR"}, translate("Another job is running; wait or cancel it"))
            return {"CANCELLED"}
        scene = context.scene.session_uid
        try:
            # On the instance Blender says CTMC_OT_load for ctmc.load.
            self.job = Job(type(self).bl_idname, self.bl_label, self.plan(context), scene, locks=self.locks)
        except (CtmcError, MemoryError) as error:
            return refuse(self, scene, error)
        start(self.job, context)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self: Any, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Advance at each timer event, stop at Esc, and pass everything else through."""
        job = self.job
        if job.stopped:
            return {"CANCELLED"}
        if event.type == "ESC" and event.value == "PRESS":
            stop(job)
            self.report({"INFO"}, translate("Cancelled"))
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"} if not job.locks or harmless(context, event) else {"RUNNING_MODAL"}
        unfinished = False
        try:
            conclusion = job.advance()
            unfinished = conclusion is None
            message = "" if conclusion is None else conclusion()
        except (CtmcError, MemoryError) as error:
            return refuse(self, job.scene, error)
        finally:
            if not unfinished:  # The job has ended, was refused or failed: its timer and status go.
                stop(job)
        if unfinished:
            show(job, context)
            return {"PASS_THROUGH"}
        self.report({"INFO"}, message)
        session.redraw_viewports()
        return {"FINISHED"}

    def cancel(self: Any, _context: bpy.types.Context) -> None:
        """Stop the job when its window is closed or another file is loaded."""
        job = getattr(self, "job", None)
        if job is not None:
            stop(job)


class CTMC_OT_cancel(bpy.types.Operator):
    """Stop the job in progress; the scene stays as it was."""

    bl_idname = "ctmc.cancel"
    bl_label = "Cancel"
    bl_description = "Stop the running job; the scene does not change"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if running() is None:
            cls.poll_message_set("No job is running")
            return False
        return True

    def execute(self, _context: bpy.types.Context) -> set[str]:
        stop_running()
        self.report({"INFO"}, translate("Cancelled"))
        return {"FINISHED"}


def idle(operator: Any, _context: Any) -> bool:
    """Return whether no job is running, with the reason if one is."""
    if running() is not None:
        operator.poll_message_set("Another job is running; wait or cancel it")
        return False
    return True


_register, _unregister = bpy.utils.register_classes_factory((CTMC_OT_cancel,))


_follow, _ignore = change_events.following(
    load_pre=stop_running, undo_pre=_stop_locked, redo_pre=_stop_locked, save_pre=_stop_locked
)


def register() -> None:
    """Register Cancel, and end a job before undo, saving or opening a file."""
    _register()
    _follow()


def unregister() -> None:
    """End the job in progress and unregister everything."""
    stop_running()
    _ignore()
    _unregister()
