# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar by mouse and keys: folds, one progress bar, file dialogs, numbers, and German."""

from __future__ import annotations

import pytest
from window.scenes import IDLE, QUIET, begin, choose_file, load

from ctmc_addon.core.files.mesh_files import SURFACE_SUFFIXES

pytestmark = pytest.mark.window

CT = "volume-0.nii.gz"
MAKE = "bpy.ops.ctmc.reconstruct()"
CANCEL = "bpy.ops.ctmc.cancel()"
COUNTED = "ours('ui.state.session').of(bpy.context.scene).cost is not None"
HEADING = 19  # pixels at Blender's usual size, from the middle of a fold's heading to the top of its first row
BROWSED = (
    "next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == 'FILE_BROWSER').spaces.active"
)
NAMED = f"answer = {BROWSED}.params.filename"
# Every step of a job, which is where the window may answer.
WATCH = """
seen = bpy.app.driver_namespace["seen"] = []
def noted(steps):
    while True:
        try:
            step = next(steps)
        except StopIteration as done:
            return done.value
        seen.append(step.message)
        yield step
jobs = ours("ui.jobs")
start = bpy.app.driver_namespace["start"] = jobs.start
def start_noted(job, context):
    job.steps = noted(job.steps)
    start(job, context)
jobs.start = start_noted
"""


@pytest.fixture(scope="module", autouse=True)
def loaded(desk):
    """The phantom, its bone chosen."""
    begin(desk, "figure", "rotation")
    load(desk, f"{desk.inside}/{CT}")
    desk.ask("s = bpy.context.scene.ctmc; s.threshold = 200; s.stride = (4, 4, 1); s.preview = False")
    desk.wait(f"{QUIET} and {COUNTED}")
    return desk


def rows(desk, at):
    """What the sidebar has under the mouse at this share of its width, row by row."""
    left, top, width, height = desk.sidebar()
    return desk.ask(f"answer = rows({left + round(at * width)}, {[*range(top + 10, top + height, 14)]})")


def test_a_click_on_a_heading_closes_its_fold_alone(desk):
    other = desk.find("ctmc_figure.kind")
    x, y = desk.find("ctmc.rotation_kind")
    while desk.under(x, y - 1) == "ctmc.rotation_kind":
        y -= 1
    scale = desk.ask("answer = bpy.context.preferences.system.ui_scale")
    for expected in (False, True):
        desk.click(x, y - round(HEADING * scale))
        desk.look(f"layout-00-fold-{expected}")
        assert (desk.under(x, y) == "ctmc.rotation_kind") is expected
        assert desk.under(*other) == "ctmc_figure.kind"


def test_a_ratio_is_typed_as_decimate_has_it(desk):
    desk.ask("s = bpy.context.scene.ctmc; s.use_reduction = True; s.simplifier = 'builtin'")
    desk.find("ctmc.ratio")
    desk.hand("click", "--repeat", "2", "--delay", "50", "1")
    desk.key("ctrl+a")
    desk.write("0.25")
    desk.key("Return")
    desk.look("layout-01-ratio")
    assert desk.ask("answer = bpy.context.scene.ctmc.to_settings().reduction") == 0.75
    desk.ask("s = bpy.context.scene.ctmc; s.use_reduction = False")


def test_the_window_may_answer_between_the_parts_of_adding_a_surface(desk):
    desk.ask(WATCH)
    desk.press(MAKE, "reconstruct")
    desk.wait(f"{IDLE} and len(bpy.data.meshes) == 1")
    desk.ask("ours('ui.jobs').start = bpy.app.driver_namespace.pop('start')")
    assert desk.ask("answer = bpy.app.driver_namespace.pop('seen')").count("Adding the surface") >= 3


def test_progress_is_shown_once_where_its_button_was(desk):
    desk.ask("s = bpy.context.scene.ctmc; s.rotation_rounds = 1; s.rotation_step = 180")
    desk.press("bpy.ops.ctmc.rotation_test()", "rotation_test")
    desk.ask("ours('ui.jobs').running().advance = lambda: None")
    desk.look("layout-02-progress")
    shown = [row for row in rows(desk, 0.84) if row]
    desk.key("Escape")
    desk.wait(IDLE)
    assert len([row for number, row in enumerate(shown) if row == CANCEL and shown[number - 1] != CANCEL]) == 1


def test_export_writes_what_the_list_of_formats_says(desk):
    desk.press("bpy.ops.ctmc.export()", "export", 0.3)
    regions = desk.wait("browser()")
    left, top, width, height = regions["TOOL_PROPS"]
    for y in range(top + 10, top + height, 12):  # Ctrl and the wheel change a list under the mouse
        desk.move(left + round(0.7 * width), y)
        desk.hand("keydown", "ctrl", "click", "5", "keyup", "ctrl")
        if desk.ask(f"answer = {BROWSED}.active_operator.kind") != ".stl":
            break
    desk.look("layout-03-export")
    names = []
    for _ in SURFACE_SUFFIXES[1:]:
        names.append(desk.ask(NAMED))
        desk.hand("keydown", "ctrl", "click", "5", "keyup", "ctrl")
    assert names == [f"Bone 200 HU{suffix}" for suffix in SURFACE_SUFFIXES[1:]]
    for _ in SURFACE_SUFFIXES:
        if (name := desk.ask(NAMED)) == "Bone 200 HU.ply":
            break
        desk.hand("keydown", "ctrl", "click", "4", "keyup", "ctrl")
    assert name == "Bone 200 HU.ply"
    choose_file(desk, f"{desk.inside}/")
    desk.wait("browser() is None")
    assert (desk.folder / name).read_bytes()[:3] == b"ply"


def test_load_opens_where_the_last_ct_lies_with_flips_to_click(desk):
    desk.press("bpy.ops.ctmc.load()", "load", 0.3)
    regions = desk.wait("browser()")
    desk.look("layout-04-load")
    where = desk.ask(f"answer = {BROWSED}.params.directory.decode()")
    assert where.rstrip("/") == desk.inside
    left, top, width, height = regions["TOOL_PROPS"]
    flips = f"answer = list({BROWSED}.active_operator.flip_axes)"
    for y in range(top + 40, top + height, 12):
        desk.click(left + round(0.85 * width), y)
        if any(desk.ask(flips)):
            break
    desk.look("layout-05-flip")
    assert desk.ask(flips) == [False, False, True]
    desk.key("Escape")
    desk.wait("browser() is None")


@pytest.mark.parametrize("scale", [1.1, pytest.param(2.0, marks=pytest.mark.once)])
def test_in_german_nothing_jumps_at_the_usual_and_twice_the_size(desk, scale):
    desk.ask(f"bpy.context.preferences.view.language = 'de_DE'; bpy.context.preferences.view.ui_scale = {scale}")
    desk.ask("redraw()")
    desk.places.clear()
    x, before = desk.find(MAKE, 0.4)
    desk.look(f"layout-07-{scale}-counted")
    desk.ask("ours('ui.state.session').of(bpy.context.scene).cost = None; redraw()")
    assert desk.under(x, before) == MAKE
    desk.ask("bpy.context.scene.ctmc.threshold = 5000")
    desk.wait(COUNTED)
    assert desk.find(MAKE, 0.4)[1] == before
    desk.look(f"layout-08-{scale}-refused")
    desk.ask("bpy.context.scene.ctmc.threshold = 200")
    desk.wait(COUNTED)


def test_the_usual_language_and_size_come_back(desk):
    desk.ask("bpy.context.preferences.view.language = 'en_US'; bpy.context.preferences.view.ui_scale = 1.1")
    log = desk.printed()
    for word in ("Traceback", "rna_uiItem", "Error:"):
        assert word not in log
