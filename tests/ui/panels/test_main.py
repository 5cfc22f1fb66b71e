# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panels draw, onto a layout that writes down what it is asked for."""

from __future__ import annotations

import pytest

bpy = pytest.importorskip("bpy")

from ui.drawing import Layout, drawn

from ctmc_addon.core.settings import SETTINGS
from ctmc_addon.ui.panels import figure as figure_panel, main as panels, results, rotation, settings
from ctmc_addon.ui.panels.ct import region

PANELS = (
    *panels.STEPS,
    region.CTMC_PT_region,
    settings.CTMC_PT_parts,
    settings.CTMC_PT_normals,
    settings.CTMC_PT_advanced,
    rotation.CTMC_PT_rotation,
    results.CTMC_PT_results,
    figure_panel.CTMC_PT_figure,
)


SHOWN_AS = {"region_unit": "region_in", "simplifier": "method", "reduction": "ratio", "keep_parts": "keep_largest"}
"""Settings that the panel shows by a choice or a number of its own."""


def test_every_setting_is_shown(scene):
    shown = set()
    for use_label in (False, True):
        scene.ctmc.use_label = use_label
        for goal in ("none", "reduction", "target_faces", "max_error_mm"):
            scene.ctmc.goal = goal
            for panel in PANELS:
                shown |= set(drawn(panel).shown)
    assert {SHOWN_AS.get(name, name) for name in SETTINGS} <= shown


def test_the_goal_comes_first_and_the_method_follows_where_it_can(scene):
    settings = scene.ctmc
    assert (settings.goal, settings.to_settings().simplifies) == ("none", False)
    settings.goal = "reduction"
    settings.ratio = 0.1
    assert settings.to_settings().reduction == 0.9
    assert "removes 90 %" in drawn(*panels.STEPS).texts
    settings.method = "decimate"
    settings.goal = "max_error_mm"
    assert (settings.method, settings.use_reduction, settings.to_settings().max_error_mm) == ("builtin", False, 0.5)
    settings.simplifier = "none"
    assert settings.goal == "none"
    settings.goal = "target_faces"
    assert (settings.simplifier, settings.to_settings().target_faces) == ("builtin", 10_000)
    settings.goal = "none"
    assert not settings.to_settings().simplifies


def test_the_panel_has_as_many_lines_before_and_after_a_count_and_for_every_goal(scene, ball_file):
    from ctmc_addon.ui.state import session

    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    before = len(drawn(*panels.STEPS).texts)
    session.of(scene).cost = None
    for scene.ctmc.goal in ("none", "reduction", "target_faces", "max_error_mm"):
        assert len(drawn(*panels.STEPS).texts) == before
    scene.ctmc.use_threshold = True
    assert len(drawn(*panels.STEPS).texts) == before


def test_the_buttons_are_there_and_exist(scene):
    buttons = drawn(*panels.STEPS).buttons
    assert buttons[0] == "ctmc.load"
    assert "ctmc.reconstruct Reconstruct Surface" in buttons
    for button in buttons:
        assert getattr(bpy.ops.ctmc, button.split()[0].partition(".")[2]).get_rna_type()


def test_the_panel_says_when_alpha_does_nothing_and_when_settings_contradict(scene):
    says = "Alpha has no effect on a label that is not smoothed"
    assert "Otsu's threshold is used" in drawn(*panels.STEPS).texts
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
    for fact in ("24 x 24 x 12", "1 x 1 x 2 mm", "left, back, head (LPS)"):
        assert fact in texts
    assert "taken as axial" in " ".join(texts)


def test_every_panel_but_the_steps_of_the_work_begins_closed(scene):
    ours = [getattr(bpy.types, name) for name in dir(bpy.types) if name.startswith("CTMC_PT_")]
    below = [kind for kind in ours if getattr(kind, "bl_parent_id", "") == "CTMC_PT_main"]
    below = [kind for kind in below if kind not in (*panels.STEPS, results.CTMC_PT_results)]
    assert len(below) > 6
    assert all("DEFAULT_CLOSED" in kind.bl_options for kind in below)


def test_the_panel_says_which_of_several_labels_the_preview_shows(scene):
    says = "The preview shows the first ticked structure"
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
    from ctmc_addon.ui.operators import rotation as rotation_test
    from ctmc_addon.ui.state import session

    operator = rotation_test.CTMC_OT_rotation_test
    job = jobs.Job(operator.bl_idname, operator.bl_label, iter(()), scene.session_uid, locks=operator.locks)
    monkeypatch.setattr(jobs, "_running", [job])
    assert jobs.locked()
    table = type("Table", (), {"rows": staticmethod(lambda *_: [["Round"]])})()
    monkeypatch.setattr(session.of(scene), "rotation", table)
    holder = type("Panel", (), {"layout": Nested()})()
    rotation.CTMC_PT_rotation.draw(holder, bpy.context)
    assert holder.layout.pressed == {"ctmc.cancel": True, "ctmc.rotation_copy": False, "ctmc.rotation_save": False}


def test_millimeters_are_shown_as_such_and_zero_components_as_all(scene):
    for name in ("smoothing_mm", "max_error_mm"):
        assert scene.ctmc.bl_rna.properties[name].unit == "CAMERA"  # which Blender shows in mm at any scene scale
    layout = drawn(settings.CTMC_PT_parts)
    assert "All" in layout.texts
    assert "keep_parts" not in layout.shown, "its 0 would stand beside the word"
    scene.ctmc.keep_largest = True
    assert scene.ctmc.keep_parts == 1
    scene.ctmc.keep_parts = 2
    scene.ctmc.keep_largest = True
    assert scene.ctmc.keep_parts == 2
    layout = drawn(settings.CTMC_PT_parts)
    assert "All" not in layout.texts
    assert "keep_parts" in layout.shown
    scene.ctmc.keep_largest = False
    assert scene.ctmc.keep_parts == 0
