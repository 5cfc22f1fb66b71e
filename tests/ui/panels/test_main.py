# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panels draw, onto a layout that writes down what it is asked for."""

from __future__ import annotations

import pytest

bpy = pytest.importorskip("bpy")

from ui.drawing import Layout, drawn

from ctmc_addon.core.settings import described
from ctmc_addon.ui.panels import figure as figure_panel
from ctmc_addon.ui.panels import main as panels
from ctmc_addon.ui.panels import region, results, rotation, settings

PANELS = (
    panels.CTMC_PT_main,
    region.CTMC_PT_region,
    settings.CTMC_PT_parts,
    settings.CTMC_PT_normals,
    settings.CTMC_PT_advanced,
    rotation.CTMC_PT_rotation,
    results.CTMC_PT_results,
    figure_panel.CTMC_PT_figure,
)


def test_every_setting_is_shown(scene):
    shown = set()
    for use_label in (False, True):
        scene.ctmc.use_label = use_label
        for panel in PANELS:
            shown |= set(drawn(panel).shown)
    scene.ctmc.smoothing = "gaussian"
    shown |= set(drawn(panels.CTMC_PT_main).shown)
    assert set(described()) <= shown


def test_the_buttons_are_there_and_exist(scene):
    buttons = drawn(panels.CTMC_PT_main).buttons
    assert buttons[0] == "ctmc.load"
    assert "ctmc.reconstruct Reconstruct Surface" in buttons
    for button in buttons:
        assert getattr(bpy.ops.ctmc, button.split()[0].partition(".")[2]).get_rna_type()


def test_the_panel_says_when_alpha_does_nothing_and_when_settings_contradict(scene):
    plain = ["Otsu's threshold is used", "Stride"]
    assert drawn(panels.CTMC_PT_main).texts == plain
    scene.ctmc.label = 2
    scene.ctmc.smoothing = "none"
    assert "Alpha has no effect on a label that is not smoothed" in " ".join(drawn(panels.CTMC_PT_main).texts)
    scene.ctmc.smoothing = "constrained"
    assert drawn(panels.CTMC_PT_main).texts == plain[1:]
    scene.ctmc.simplifier, scene.ctmc.max_error_mm = "decimate", 0.5
    assert "max_error_mm is not possible with simplifier decimate" in " ".join(drawn(panels.CTMC_PT_main).texts)


def test_the_panel_says_what_was_loaded(scene, ball_file):
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    texts = drawn(panels.CTMC_PT_main).texts
    assert texts[0] == "ball"
    for fact in ("24 x 24 x 12", "1 x 1 x 2 mm", "left, back, head (LPS)"):
        assert fact in texts
    assert "taken as axial" in " ".join(texts)


def test_every_panel_but_the_main_one_begins_closed(scene):
    ours = [getattr(bpy.types, name) for name in dir(bpy.types) if name.startswith("CTMC_PT_")]
    below = [kind for kind in ours if getattr(kind, "bl_parent_id", "") == "CTMC_PT_main"]
    assert len(below) > 6
    assert all("DEFAULT_CLOSED" in kind.bl_options for kind in below)


def test_the_panel_says_which_of_several_labels_the_preview_shows(scene):
    says = "The preview shows the first label that is ticked"
    scene.ctmc.show_labels([(1, "", (1, 0, 0)), (2, "", (0, 1, 0))])
    scene.ctmc.labels[0].chosen = True
    assert says not in " ".join(drawn(panels.CTMC_PT_main).texts)
    scene.ctmc.labels[1].chosen = True
    assert says in " ".join(drawn(panels.CTMC_PT_main).texts)
    scene.ctmc.preview = False
    assert says not in " ".join(drawn(panels.CTMC_PT_main).texts)


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
    assert "All" in drawn(settings.CTMC_PT_parts).labels
    scene.ctmc.keep_parts = 2
    assert "All" not in drawn(settings.CTMC_PT_parts).labels
