# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panels draw, onto a layout that writes down what it is asked for."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

from ui.drawing import Layout, drawn

import ctmc_addon
from ctmc_addon.core.settings import SETTINGS
from ctmc_addon.ui.panels import layout as panel_layout, main as panels
from ctmc_addon.ui.panels.render import rotation
from ctmc_addon.ui.panels.surface import settings
from ctmc_addon.ui.properties.page import PAGES

KNOWN = "//ct.nii.gz"
"""A CT that is not in memory, which all pages know nevertheless."""
SHOWN_AS = {
    **{"threshold": "threshold_value", "region_unit": "region_in", "simplifier": "method"},
    **{"reduction": "ratio", "keep_parts": "keep_largest"},
}
"""Settings that the panel shows by a choice or a number of its own."""


def test_every_setting_is_shown(scene):
    scene.ctmc.volume_path = KNOWN
    shown = set()
    for use_label in (False, True):
        scene.ctmc.use_label = use_label
        scene.ctmc.use_upper = not use_label
        for goal in ("none", "reduction", "target_faces", "max_error_mm"):
            scene.ctmc.goal = goal
            shown |= set(drawn(*panels.STEPS).shown)
    assert {SHOWN_AS.get(name, name) for name in SETTINGS} <= shown
    assert {"threshold_from", "use_upper"} <= shown


def test_the_goal_comes_first_and_the_method_follows_where_it_can(scene):
    settings = scene.ctmc
    settings.volume_path = KNOWN
    assert (settings.goal, settings.to_settings().simplifies) == ("none", False)
    settings.goal = "reduction"
    settings.ratio = 0.1
    assert settings.to_settings().reduction == 0.9
    assert "Keep 10 % of triangles" in drawn(*panels.STEPS).texts
    settings.method = "decimate"
    settings.goal = "max_error_mm"
    assert (settings.method, settings.use_reduction, settings.to_settings().max_error_mm) == ("builtin", False, 0.5)
    settings.simplifier = "none"
    assert settings.goal == "none"
    settings.goal = "target_faces"
    assert (settings.simplifier, settings.to_settings().target_faces) == ("builtin", 10_000)
    settings.goal = "none"
    assert not settings.to_settings().simplifies


@pytest.mark.parametrize(("target", "said"), [(250, "Keep 25 % of triangles"), (2000, "Keep 100 % of triangles")])
def test_a_number_of_triangles_is_shown_as_a_share_of_those_predicted(scene, ball_file, target, said):
    from ctmc_addon.ui.state import session

    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    scene.ctmc.goal, scene.ctmc.target_faces = "target_faces", target
    session.of(scene).cost = SimpleNamespace(error="", refusal="", voxels=8, faces=1000, memory=1024, seconds=1.0)
    assert said in drawn(*panels.STEPS).texts


def test_the_panel_has_as_many_lines_before_and_after_a_count(scene, ball_file):
    from ctmc_addon.ui.state import session

    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    for scene.ctmc.goal in ("none", "reduction", "target_faces", "max_error_mm"):
        session.of(scene).cost = None
        before = len(drawn(*panels.STEPS).texts)
        session.of(scene).cost = SimpleNamespace(error="", refusal="", voxels=8, faces=2, memory=1024, seconds=1.0)
        assert len(drawn(*panels.STEPS).texts) == before
    scene.ctmc.use_threshold = True
    assert len(drawn(*panels.STEPS).texts) == before


def test_a_method_is_offered_only_where_something_is_simplified_by_a_count(scene):
    scene.ctmc.volume_path = KNOWN
    offered = {}
    for goal in ("none", "reduction", "target_faces", "max_error_mm"):
        scene.ctmc.goal = goal
        offered[goal] = "method" in drawn(panels.CTMC_PT_surface).shown
    assert offered == {"none": False, "reduction": True, "target_faces": True, "max_error_mm": False}


def test_the_buttons_are_there_and_exist(scene):
    scene.ctmc.volume_path = KNOWN
    buttons = drawn(*panels.STEPS).buttons
    assert buttons[0] == "ctmc.load"
    assert "ctmc.reconstruct Reconstruct Surface" in buttons
    for button in buttons:
        assert getattr(bpy.ops.ctmc, button.split()[0].partition(".")[2]).get_rna_type()


def test_the_panel_says_when_alpha_does_nothing_and_when_settings_contradict(scene):
    says = "Alpha has no effect on a label that is not smoothed"
    scene.ctmc.volume_path = KNOWN
    scene.ctmc.label = 2
    scene.ctmc.smoothing = "none"
    assert says in " ".join(drawn(*panels.STEPS).texts)
    scene.ctmc.smoothing = "constrained"
    assert says not in " ".join(drawn(*panels.STEPS).texts)
    scene.ctmc.simplifier, scene.ctmc.max_error_mm = "decimate", 0.5
    assert "max_error_mm is not possible with simplifier decimate" in " ".join(drawn(*panels.STEPS).texts)


def test_the_panel_says_what_was_loaded(scene, ball_file):
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    layout = drawn(*panels.STEPS)
    assert "ctmc.choose_ct ball" in layout.buttons
    texts = layout.texts
    for fact in ("24 x 24 x 12, 1 x 1 x 2 mm", "Values -36 to 147 (no HU), LPS", "Orientation: left, back, head"):
        assert fact in texts
    assert "taken as axial" in " ".join(texts)


def shown_pages():
    return [page.page for page in panels.STEPS if page.poll(bpy.context)]


def test_one_of_five_pages_is_shown_and_scripts_choose_it(scene):
    assert shown_pages() == ["CT"]
    assert [page.page for page in panels.STEPS] == list(PAGES)
    for name in PAGES:
        bpy.context.window_manager.ctmc_page = name
        assert shown_pages() == [name]
    assert "ctmc_page" in drawn(panels.CTMC_PT_main).shown


def test_the_page_is_neither_undone_nor_saved_and_goes_with_the_extension(scene, tmp_path):
    manager = bpy.context.window_manager
    bpy.ops.ed.undo_push(message="before")
    manager.ctmc_page = "RENDER"
    scene.ctmc.alpha = 0.25
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()
    assert bpy.context.window_manager.ctmc_page == "RENDER"
    assert "ctmc_page" not in set(bpy.context.window_manager.keys())
    ctmc_addon.unregister()
    assert not hasattr(bpy.types.WindowManager, "ctmc_page")
    ctmc_addon.register()
    assert bpy.context.window_manager.ctmc_page == "CT"


def test_without_a_ct_every_page_but_the_first_says_in_one_line_what_is_missing(scene):
    first, *others = panels.STEPS
    assert drawn(first).buttons == ["ctmc.load"]
    for page in others:
        drawing = drawn(page)
        assert (len(drawing.texts), drawing.buttons, drawing.shown) == (1, [], []), page.page


def test_everything_that_opens_in_place_begins_closed(scene, ball_file):
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    scene.ctmc.threshold = 100.0
    bpy.ops.ctmc.reconstruct()
    folds = drawn(*panels.STEPS).folds
    assert len(folds) >= 7
    assert all(folds.values())
    assert not panel_layout.OPEN


def test_the_panel_says_which_of_several_labels_the_preview_shows(scene):
    says = "Preview: first ticked structure"
    scene.ctmc.volume_path = KNOWN
    scene.ctmc.show_labels([(1, "", (1, 0, 0)), (2, "", (0, 1, 0))])
    scene.ctmc.labels[0].chosen = True
    assert says not in " ".join(drawn(*panels.STEPS).texts)
    scene.ctmc.labels[1].chosen = True
    assert says in " ".join(drawn(*panels.STEPS).texts)
    scene.ctmc.preview = False
    assert says not in " ".join(drawn(*panels.STEPS).texts)


class Nested(Layout):
    """Each part of its own, gray with the one it stands in."""

    def __init__(self, above=None):
        super().__init__()
        self.above, self.enabled = above, True
        self.pressed = {} if above is None else above.pressed

    def row(self, **_):
        return Nested(self)

    box = column = split = grid_flow = row

    def alive(self):
        return self.enabled and (self.above is None or self.above.alive())

    def operator(self, name, text=None, **_):
        self.pressed[name] = self.alive()
        return super().operator(name, text)


def test_cancel_can_be_pressed_while_a_rotation_test_locks_the_file(scene, monkeypatch):
    from ctmc_addon.ui import jobs
    from ctmc_addon.ui.operators.render import rotation as rotation_test
    from ctmc_addon.ui.state import session

    operator = rotation_test.CTMC_OT_rotation_test
    job = jobs.Job(operator.bl_idname, operator.bl_label, iter(()), scene.session_uid, locks=operator.locks)
    monkeypatch.setattr(jobs, "_running", [job])
    assert jobs.locked()
    table = type("Table", (), {"rows": staticmethod(lambda *_: [["Round"]])})()
    monkeypatch.setattr(session.of(scene), "rotation", table)
    holder = type("Panel", (), {"layout": Nested()})()
    rotation.draw_rotation(holder.layout, bpy.context)
    assert holder.layout.pressed == {"ctmc.cancel": True, "ctmc.rotation_copy": False, "ctmc.rotation_save": False}


def test_every_page_shows_a_running_job_once(scene, monkeypatch):
    from ctmc_addon.ui import jobs

    job = jobs.Job("ctmc.measure_all", "Measure", iter(()), scene.session_uid, locks=False)
    monkeypatch.setattr(jobs, "_running", [job])
    for page in panels.STEPS:
        assert drawn(page).buttons.count("ctmc.cancel") == 1, page


def drawn_settings():
    return drawn(settings.draw_components)


def test_millimeters_are_shown_as_such_and_zero_components_as_all(scene):
    for name in ("smoothing_mm", "max_error_mm"):
        assert scene.ctmc.bl_rna.properties[name].unit == "CAMERA"  # which Blender shows in mm at any scene scale
    layout = drawn_settings()
    assert "All" in layout.texts
    assert "keep_parts" not in layout.shown, "its 0 would stand beside the word"
    scene.ctmc.keep_largest = True
    assert scene.ctmc.keep_parts == 1
    scene.ctmc.keep_parts = 2
    scene.ctmc.keep_largest = True
    assert scene.ctmc.keep_parts == 2
    layout = drawn_settings()
    assert "All" not in layout.texts
    assert "keep_parts" in layout.shown
    scene.ctmc.keep_largest = False
    assert scene.ctmc.keep_parts == 0
