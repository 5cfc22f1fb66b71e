# SPDX-License-Identifier: GPL-3.0-or-later
"""Distance and angle by clicks: their values, what is kept, and that Esc leaves nothing."""

from __future__ import annotations

import pytest
from window.scenes import begin

pytestmark = pytest.mark.window

RULERS = "ours('blender.rulers').rulers_of(bpy.context.scene)"
COUNT = f"answer = [len({RULERS}), len(bpy.data.curves)]"
# A plate of 400 x 300 mm seen from above.
PLATE = """
bpy.ops.mesh.primitive_plane_add(size=1, location=(0, 0, 7))
bpy.context.object.scale = (4, 3, 1)
bpy.context.preferences.view.smooth_view = 0
view = viewport()
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.view3d.view_axis(type="TOP")
    bpy.ops.view3d.view_all()
"""


@pytest.fixture(scope="module", autouse=True)
def plate(desk):
    """A plate, seen from above."""
    begin(desk)
    desk.ask(PLATE)


def start(desk, operator):
    """Press the button of an operator, as the viewport it belongs to."""
    desk.ask(f"""
view = viewport()
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.ctmc.{operator}("INVOKE_DEFAULT")
""")


def click(desk, x, y, button="1"):
    """Click on a place of the plate, Blender units."""
    at = [round(value) for value in desk.ask(f"answer = on_screen(({x}, {y}, 7))")]
    desk.move(at[0] - 3, at[1])
    desk.move(*at)
    for action in ("mousedown", "mouseup"):
        desk.hand(action, button)
        desk.ask("answer = 'clicked'")


def test_two_clicks_are_a_distance_in_millimeters(desk):
    start(desk, "measure_distance")
    click(desk, -1.0, -1.0)
    click(desk, 0.5, 1.0)
    desk.look("rulers-01-distance")
    assert desk.ask(f"answer = [[r.name, r['ctmc_ruler']['value']] for r in {RULERS}]")[0][1] == pytest.approx(
        250, 0.01
    )


def test_three_clicks_are_an_angle(desk):
    start(desk, "measure_angle")
    click(desk, 1.0, 0.0)
    click(desk, 0.0, 0.0)
    desk.look("rulers-02-half-an-angle")
    click(desk, 0.0, -1.0)
    desk.look("rulers-03-angle")
    assert desk.ask(f"answer = {RULERS}[1]['ctmc_ruler']['value']") == pytest.approx(90, abs=1)


@pytest.mark.parametrize("how", ["Escape", "right click"])
def test_breaking_off_leaves_nothing(desk, how):
    before = desk.ask(COUNT)
    start(desk, "measure_angle")
    click(desk, 1.0, 1.0)
    if how == "Escape":
        desk.key("Escape")
    else:
        click(desk, 0.0, 1.0, "3")
    assert desk.ask(COUNT) == before
    assert desk.ask("answer = len(ours('ui.viewport.results.rulers').pending.world_points)") == 0


def test_undo_takes_a_distance_back(desk):
    assert desk.ask(COUNT)[0] == 2
    desk.ask("bpy.ops.ed.undo()")
    assert desk.ask(COUNT)[0] == 1
    assert "Traceback" not in desk.last_words()
