# SPDX-License-Identifier: GPL-3.0-or-later
"""Pick Component by mouse: several clicks, each on another surface's component, undo and Esc."""

from __future__ import annotations

import pytest
from window.scenes import IDLE, begin, load

pytestmark = pytest.mark.window

RADII = (6, 5, 4, 3)  # voxels of balls in a row along x
APART = 16
PLACES = {"REMOVE": 0.2, "KEEP": 0.5, "SEPARATE": 0.8}  # shares of the sidebar's width
# Balls of 100 HU in air, looked at from the front of the patient.
BALLS = """
import numpy as np
z, y, x = np.mgrid[:16, :16, :64]
values = np.full(x.shape, -1000, np.int16)
for number, radius in enumerate({radii}):
    values[(x - 8 - {apart} * number) ** 2 + (y - 8) ** 2 + (z - 8) ** 2 < radius**2] = 100
np.save("{folder}/balls.npy", values)
"""
VIEW = """
view = viewport()
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.ctmc.view(side="A")
bpy.context.scene.ctmc_view.show_slice = False
bpy.ops.ed.undo_push(message="Begin")
"""
# The balls that each surface holds.
FOUND = """
answer = {}
for obj in (obj for obj in bpy.data.objects if obj.type == "MESH"):
    lefts = [-100 * (obj.matrix_world @ vertex.co).x for vertex in obj.data.vertices]  # to the patient
    answer[obj.name] = sorted({int(left // 16) for left in lefts})
"""


@pytest.fixture(scope="module", autouse=True)
def balls(desk):
    """A surface of four balls."""
    begin(desk)
    desk.ask("bpy.context.preferences.view.smooth_view = 0")
    desk.ask(BALLS.format(radii=RADII, apart=APART, folder=desk.inside))
    load(desk, f"{desk.inside}/balls.npy", spacing=(1.0, 1.0, 1.0))
    desk.ask("s = bpy.context.scene.ctmc; s.use_threshold = True; s.threshold = 0; s.preview = False")
    desk.ask("bpy.ops.ctmc.reconstruct()")
    desk.wait(IDLE)
    desk.ask(VIEW)


def pick(desk, ball):
    """Click on the middle of a ball."""
    at = [0.01 * value for value in (-8 - APART * ball, -8, 8)]
    desk.click(*(round(value) for value in desk.ask(f"answer = on_screen({at})")))


def begin_to(desk, action):
    desk.press(f"bpy.ops.ctmc.pick_component(action='{action}')", "pick_component", PLACES[action])


def test_several_clicks_remove_one_after_the_other_and_undo_takes_back_one(desk):
    (name,) = desk.ask(FOUND)
    begin_to(desk, "REMOVE")
    desk.look("component-01-begun")
    pick(desk, 1)
    assert desk.ask(FOUND)[name] == [0, 2, 3]
    pick(desk, 3)
    assert desk.ask(FOUND)[name] == [0, 2]
    desk.key("ctrl+z")
    assert desk.ask(FOUND)[name] == [0, 2, 3]
    desk.key("Escape")
    pick(desk, 2)
    assert desk.ask(FOUND)[name] == [0, 2, 3]


def test_a_component_becomes_an_object_and_one_is_kept(desk):
    (name,) = desk.ask(FOUND)
    desk.ask(f"o = bpy.data.objects[{name!r}]; o.select_set(True); bpy.context.view_layer.objects.active = o")
    begin_to(desk, "SEPARATE")
    pick(desk, 2)
    desk.key("Return")
    found = desk.ask(FOUND)
    assert sorted(found.values()) == [[0, 3], [2]]
    desk.look("component-02-separate")
    begin_to(desk, "KEEP")
    pick(desk, 3)
    desk.key("Escape")
    assert sorted(desk.ask(FOUND).values()) == [[2], [3]]
    desk.look("component-03-kept")
    assert "Traceback" not in desk.last_words()
