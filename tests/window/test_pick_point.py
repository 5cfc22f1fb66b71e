# SPDX-License-Identifier: GPL-3.0-or-later
"""Pick Point by mouse: the slices meet where one of them is clicked, the status bar says the value, Esc ends it."""

from __future__ import annotations

import pytest
from window.conftest import CT
from window.scenes import begin, load

pytestmark = pytest.mark.window

SLICES = "{obj['ctmc_slice_plane']: list(obj.location) for obj in bpy.data.objects if 'ctmc_slice_plane' in obj}"
# The axial slice of three stands in front, seen from the head.
THREE = """
bpy.context.preferences.view.smooth_view = 0
volume = ours("ui.state.ct.volumes").current(bpy.context.scene)
box = ours("core.volume").volume_box(volume) * 0.01
bpy.context.scene.cursor.location = (box[0] + box[7]) / 2
bpy.ops.ctmc.add_slice(three=True)
bpy.ops.ed.undo_push(message="Three slices")
view = viewport()
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.ctmc.view(side="S")
    bpy.ops.ctmc.pick_point("INVOKE_DEFAULT")
middle = (box[0] + box[7]) / 2
answer = [list(middle), list(box[7] - box[0])]
"""
# What the status bar is told.
HEAR = """
said = bpy.app.driver_namespace.setdefault("said", [])
pick = ours("ui.operators.ct.pick_point").CTMC_OT_pick_point
if "heard" not in bpy.app.driver_namespace:
    bpy.app.driver_namespace["heard"] = plain = pick.show_status
    pick.show_status = lambda self, context, text: (said.append(text), plain(self, context, text))[1]
"""


def click(desk, place):
    """Click on a place in world space."""
    at = [round(value) for value in desk.ask(f"answer = on_screen({list(place)})")]
    desk.move(at[0] - 3, at[1])
    desk.move(*at)
    for action in ("mousedown", "mouseup"):
        desk.hand(action, "1")
        desk.ask("answer = 'clicked'")


def test_a_click_in_a_slice_moves_the_two_others_there(desk):
    begin(desk)
    load(desk, f"{desk.inside}/{CT}")
    desk.ask(HEAR)
    middle, size = desk.ask(THREE)
    before = desk.ask(f"answer = {SLICES}")
    clicked = [middle[0] + 0.11 * size[0], middle[1] + 0.17 * size[1], before["axial"][2]]
    click(desk, clicked)
    desk.look("pick-01-clicked")
    after = desk.ask(f"answer = {SLICES}")
    assert after["axial"] == pytest.approx(before["axial"])
    assert after["sagittal"][0] == pytest.approx(clicked[0], abs=0.015)  # two pixels of the screen and of the CT
    assert after["coronal"][1] == pytest.approx(clicked[1], abs=0.015)
    said = desk.ask("answer = bpy.app.driver_namespace['said'][-1]")
    place, value = said.split(" mm: ")
    assert [float(number) for number in place.split(", ")] == pytest.approx([100 * at for at in clicked], abs=1.5)
    assert value.endswith(" HU")
    assert desk.ask("answer = list(bpy.context.scene.cursor.location)") == pytest.approx(clicked, abs=0.015)


def test_undo_brings_the_slices_back_and_escape_gives_the_mouse_back(desk):
    after = desk.ask(f"answer = {SLICES}")
    desk.key("Escape")
    desk.ask("bpy.ops.ed.undo()")
    assert desk.ask(f"answer = {SLICES}")["sagittal"] != pytest.approx(after["sagittal"])
    before = desk.ask(f"answer = {SLICES}")
    click(desk, after["sagittal"])
    assert desk.ask(f"answer = {SLICES}") == before
    assert "Traceback" not in desk.last_words()
