"""What the panels draw, onto a layout that writes down what it is asked for."""

from __future__ import annotations

import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.core.settings import described  # noqa: E402
from ctmc_addon.ui import panels  # noqa: E402


class Layout:
    """Takes the place of Blender's, which exists only while a window is drawn."""

    def __init__(self):
        self.shown, self.buttons, self.texts = [], [], []

    def row(self, **_):
        return self

    box = row

    def prop(self, owner, name, **_):
        assert name in owner.bl_rna.properties
        self.shown.append(name)

    def operator(self, name, **_):
        self.buttons.append(name)

    def label(self, text, **_):
        self.texts.append(text)


def drawn(panel):
    holder = type("Panel", (), {"layout": Layout()})()
    panel.draw(holder, bpy.context)
    return holder.layout


def test_every_setting_is_shown_once(scene):
    shown = drawn(panels.CTMC_PT_main).shown + drawn(panels.CTMC_PT_more).shown
    assert sorted(name for name in shown if not name.startswith("use_")) == sorted(described())


def test_the_buttons_are_there_and_exist(scene):
    buttons = drawn(panels.CTMC_PT_main).buttons
    assert buttons == ["ctmc.load", "ctmc.reconstruct", "ctmc.export"]
    for button in buttons:
        assert getattr(bpy.ops.ctmc, button.partition(".")[2]).get_rna_type()


def test_the_panel_says_when_alpha_does_nothing_and_when_settings_contradict(scene):
    assert not drawn(panels.CTMC_PT_main).texts
    scene.ctmc.label = 2
    assert "Alpha does nothing on a label that is not softened" in drawn(panels.CTMC_PT_main).texts
    scene.ctmc.soften_mm = 1.0
    assert not drawn(panels.CTMC_PT_main).texts
    scene.ctmc.simplifier, scene.ctmc.max_error_mm = "decimate", 0.5
    assert "Decimate knows no error bound" in drawn(panels.CTMC_PT_main).texts[0]


def test_the_panel_says_what_was_loaded(scene, ball_file):
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    texts = drawn(panels.CTMC_PT_main).texts
    assert texts[:2] == ["ball", "24 x 24 x 12 voxels, LPS"]
    assert "1 x 1 x 2 mm" in texts[2]
