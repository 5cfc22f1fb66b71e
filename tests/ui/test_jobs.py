# SPDX-License-Identifier: GPL-3.0-or-later
"""The modal driver, driven by hand: timer, Esc, cancel, another file, a window that closes, defects."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.core import Step
from ctmc_addon.core.errors import ReadError
from ctmc_addon.ui import jobs
from ctmc_addon.ui.state import session

TIMER = SimpleNamespace(type="TIMER", value="NOTHING")
ESC = SimpleNamespace(type="ESC", value="PRESS")
MOUSE = SimpleNamespace(type="MOUSEMOVE", value="NOTHING")


class Operator(jobs.LongOperator):
    """What Blender would make of an operator with this work."""

    bl_idname = "ctmc.reconstruct"
    bl_label = "Reconstruct Surface"

    def __init__(self, steps):
        self.steps, self.reports = steps, []
        self.bl_idname = "CTMC_OT_reconstruct"  # as Blender says on an instance

    def plan(self, _context):
        return self.steps

    def report(self, kind, sentence):
        self.reports.append((kind, sentence))


class Context:
    """The context with a clock in place of a window's timer."""

    def __init__(self):
        self.timers, self.handlers = [], []
        self.scene, self.workspace, self.window = bpy.context.scene, bpy.context.workspace, object()
        self.window_manager = self

    def event_timer_add(self, seconds, window):
        assert window is self.window
        self.timers.append(seconds)
        return seconds

    def event_timer_remove(self, timer):
        self.timers.remove(timer)

    def modal_handler_add(self, operator):
        self.handlers.append(operator)


class Work:
    """Steps that write down how they end, and a conclusion that writes to the scene."""

    def __init__(self, steps=3, error=None):
        self.closed, self.done, self.count, self.error = False, False, steps, error

    def steps(self):
        try:
            for number in range(self.count):
                yield Step(number / self.count, "Finding active voxels")
            if self.error:
                raise self.error
            return self.conclude
        finally:
            self.closed = True

    def conclude(self):
        self.done = True
        return "done"


@pytest.fixture
def context(scene, monkeypatch):
    """A context in which a job believes itself in a window."""
    found = Context()
    monkeypatch.setattr(
        jobs,
        "bpy",
        SimpleNamespace(app=SimpleNamespace(background=False), context=found, data=bpy.data, types=bpy.types),
    )
    monkeypatch.setattr(jobs, "TICK", 0.0)  # every step its own tick
    monkeypatch.setattr(session, "redraw_panels", lambda: None)
    monkeypatch.setattr(session, "redraw_viewports", lambda: None)
    yield found
    assert jobs.running() is None
    assert not found.timers


def begun(context, work):
    operator = Operator(work.steps())
    assert operator.invoke(context, MOUSE) == {"RUNNING_MODAL"}
    assert context.handlers == [operator]
    assert jobs.running("ctmc.load", "ctmc.reconstruct") is jobs.running() is not None
    assert jobs.running("ctmc.load") is None
    return operator


def driven(operator, context, most=50):
    for _ in range(most):
        result = operator.modal(context, TIMER)
        if result != {"PASS_THROUGH"}:
            return result
    raise AssertionError("never ended")


def test_a_job_ends_with_its_conclusion_and_leaves_nothing(context):
    work = Work()
    operator = begun(context, work)
    assert operator.modal(context, MOUSE) == {"PASS_THROUGH"}
    assert not work.done
    assert driven(operator, context) == {"FINISHED"}
    assert work.done
    assert work.closed
    assert operator.reports == [({"INFO"}, "done")]


def test_no_step_begins_that_would_make_the_window_wait(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr(jobs.time, "perf_counter", lambda: clock[0])

    def work(*seconds):
        for one in seconds:
            clock[0] += one
            yield Step(0.0, "Starting")
        return lambda: ""

    def ticks(*seconds):
        job, ends = jobs.Job("ctmc.load", "", work(*seconds), 0), []
        while job.advance(0.04) is None:
            ends.append(round(clock[0], 3))
        clock[0] = 0.0
        return ends

    assert ticks(*[0.011] * 8) == [0.033, 0.066]  # a fourth would end at 0.044
    assert ticks(0.03, 0.03, 0.5, 0.001) == [0.03, 0.06, 0.56]


def test_the_panel_is_drawn_again_for_a_new_stage_and_else_five_times_a_second(context, monkeypatch):
    drawn, clock = [], SimpleNamespace(now=100.0)
    monkeypatch.setattr(jobs.time, "perf_counter", lambda: clock.now)
    monkeypatch.setattr(session, "redraw_panels", lambda: drawn.append(clock.now))
    job = jobs.Job("CTMC_OT_reconstruct", "Reconstruct Surface", iter(()), 0)
    for seconds, message in (
        (0, "Measuring"),
        (0.1, "Measuring"),
        (0.15, "Simplifying"),
        (0.3, "Simplifying"),
        (0.36, "Simplifying"),
    ):
        clock.now, job.step = 100.0 + seconds, Step(0.5, message)
        jobs.show(job, context)
    assert drawn == [100.0, 100.15, 100.36]
    context.workspace.status_text_set(text=None)


def test_esc_stops_at_once_and_nothing_is_concluded(context):
    work = Work()
    operator = begun(context, work)
    operator.modal(context, TIMER)
    assert operator.modal(context, ESC) == {"CANCELLED"}
    assert work.closed
    assert not work.done
    assert operator.modal(context, TIMER) == {"CANCELLED"}


def test_the_cancel_button_stops_it(context):
    work = Work()
    operator = begun(context, work)
    operator.modal(context, TIMER)
    assert bpy.ops.ctmc.cancel() == {"FINISHED"}
    assert work.closed
    assert operator.modal(context, TIMER) == {"CANCELLED"}
    with pytest.raises(RuntimeError, match="No job is running"):
        bpy.ops.ctmc.cancel()


def test_another_file_or_a_closed_window_stops_it(context):
    work = Work()
    operator = begun(context, work)
    operator.modal(context, TIMER)
    operator.cancel(context)
    assert work.closed
    work = Work()
    context.handlers.clear()
    begun(context, work).modal(context, TIMER)
    bpy.ops.wm.read_homefile(use_empty=True)
    assert work.closed
    assert not work.done


def test_what_was_refused_is_said_and_stays_in_the_panel(context):
    operator = begun(context, Work(error=ReadError("slice 3 is broken; remove it")))
    assert driven(operator, context) == {"CANCELLED"}
    assert operator.reports == [({"ERROR"}, "slice 3 is broken; remove it")]
    assert session.of(context.scene).message == "slice 3 is broken; remove it"


def test_too_little_memory_is_a_sentence(context):
    operator = begun(context, Work(error=MemoryError()))
    assert driven(operator, context) == {"CANCELLED"}
    assert "not enough memory" in session.of(context.scene).message


def test_a_defect_stays_a_traceback_and_leaves_no_timer(context):
    operator = begun(context, Work(error=ZeroDivisionError()))
    with pytest.raises(ZeroDivisionError):
        driven(operator, context)
    assert jobs.running() is None


def test_two_jobs_do_not_run_at_once(context):
    first = begun(context, Work())
    second = Operator(Work().steps())
    assert second.invoke(context, MOUSE) == {"CANCELLED"}
    assert second.reports[0][0] == {"ERROR"}
    first.modal(context, ESC)


def test_a_job_ends_when_the_extension_goes(context):
    work = Work()
    begun(context, work).modal(context, TIMER)
    jobs.stop_running()
    assert work.closed


def test_without_a_window_it_is_all_done_at_once(scene):
    work = Work()
    operator = Operator(work.steps())
    assert operator.invoke(bpy.context, MOUSE) == {"FINISHED"}
    assert work.done
    assert operator.reports == [({"INFO"}, "done")]


def test_a_locking_job_lets_only_looking_round_and_its_own_tab_through(context):
    tab = SimpleNamespace(type="UI", active_panel_category="CTMC", x=1000, y=20, width=200, height=500)
    view = SimpleNamespace(type="WINDOW", x=0, y=20, width=1000, height=500)
    context.screen = SimpleNamespace(areas=[SimpleNamespace(type="VIEW_3D", regions=[view, tab])])
    operator = Operator(Work(9).steps())
    operator.locks = True
    assert operator.invoke(context, MOUSE) == {"RUNNING_MODAL"}
    assert jobs.locked()

    def event(kind, x=0, y=0, ctrl=False):
        return SimpleNamespace(type=kind, value="PRESS", mouse_x=x, mouse_y=y, ctrl=ctrl, alt=False)

    past = {"PASS_THROUGH"}
    assert operator.modal(context, event("WHEELUPMOUSE")) == past
    assert operator.modal(context, event("LEFTMOUSE", 1100, 300)) == past
    for kept in (event("Z", ctrl=True), event("LEFTMOUSE", 500, 300), event("WHEELUPMOUSE", ctrl=True), event("S")):
        assert operator.modal(context, kept) == {"RUNNING_MODAL"}
    tab.active_panel_category = "Item"
    assert operator.modal(context, event("LEFTMOUSE", 1100, 300)) == {"RUNNING_MODAL"}
    assert operator.modal(context, ESC) == {"CANCELLED"}
    assert not jobs.locked()


def test_saving_ends_a_job_that_keeps_things_in_the_file_and_no_other(context, tmp_path):
    for locks in (True, False):
        work = Work(9)
        operator = Operator(work.steps())
        operator.locks = locks
        operator.invoke(context, MOUSE)
        operator.modal(context, TIMER)
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "day.blend"))
        assert work.closed == locks
        assert operator.modal(context, ESC) == {"CANCELLED"}


def test_a_file_saved_during_a_rotation_test_has_none_of_its_levels(context, ball_file, tmp_path):
    from ctmc_addon.ui.operators.render import rotation as rotation_test

    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    context.scene.ctmc.threshold = 100.0
    bpy.ops.ctmc.reconstruct()
    thing = bpy.context.view_layer.objects.active

    class Window:
        """Draws nothing."""

        __enter__ = show = draw = lambda self, *_: self

        def __exit__(self, *_):
            pass

    mesh = rotation_test.full_mesh(context.scene, thing)
    options = {"rounds": 1, "step_degrees": 90.0}
    steps = rotation_test.test_steps(context.scene, thing, mesh, (0.0, 50.0), "rotate", options, Window(), None)
    operator = Operator(steps)
    operator.locks = rotation_test.CTMC_OT_rotation_test.locks
    operator.invoke(context, MOUSE)
    before = len(bpy.data.objects)
    while len(bpy.data.objects) == before:
        assert operator.modal(context, TIMER) == {"PASS_THROUGH"}
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "day.blend"), copy=True)
    with bpy.data.libraries.load(str(tmp_path / "day.blend")) as (there, _):
        assert (list(there.objects), list(there.meshes)) == ([thing.name, "ball"], [thing.data.name])
    assert not thing.hide_viewport
    assert operator.modal(context, TIMER) == {"CANCELLED"}
