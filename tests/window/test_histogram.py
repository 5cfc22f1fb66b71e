# SPDX-License-Identifier: GPL-3.0-or-later
"""The histogram in the viewport: lines follow the mouse, a drag is one undo step, everything else passes through."""

from __future__ import annotations

import pytest
from window.scenes import QUIET, begin, load

pytestmark = pytest.mark.window

CT = "volume-0.nii.gz"
BUTTON = "bpy.ops.ctmc.histogram()"
ICON = 0.85  # of the sidebar's width, where the button is
LIMITS = "s = bpy.context.scene.ctmc; answer = [s.threshold, s.upper if s.use_upper else None]"
IS_OPEN = "ours('ui.viewport.surface.histogram').current() is not None"
# Pixels of values on the screen, from the window's top left: x of each, and y of the bars' middle.
PLACES = """
view, module = viewport(), ours("ui.viewport.surface.histogram")
strip = module.strip_of(view.area, bpy.context.scene)
y = view.window.height - 1 - view.region.y - round((strip.bottom + strip.top) / 2)
answer = [round(view.region.x + strip.x_of(value)) for value in {values}] + [y]
"""


def places(desk, *values):
    """Where these values are on the screen."""
    *xs, y = desk.ask(PLACES.replace("{values}", repr(values)))
    return [(x, y) for x in xs]


@pytest.fixture(scope="module", autouse=True)
def loaded(desk):
    """The phantom at 200 HU, its histogram open."""
    begin(desk)
    load(desk, f"{desk.inside}/{CT}")
    desk.ask("bpy.context.scene.ctmc.threshold = 200; bpy.ops.ed.undo_push(message='Before')")
    desk.press(BUTTON, "histogram", ICON)
    assert desk.ask(f"answer = {IS_OPEN}")


def test_a_line_follows_the_mouse_and_the_preview_follows_the_line(desk):
    desk.look("histogram-01-open")
    before = desk.ask("answer = len(ours('ui.viewport.surface.preview').state.shown.surface.faces)")
    start, end = places(desk, 200, 450)
    desk.drag(start, end)
    threshold, upper = desk.ask(LIMITS)
    assert threshold == pytest.approx(450, abs=5)
    assert upper is None
    desk.wait(QUIET)
    desk.look("histogram-02-dragged")
    assert desk.ask("answer = len(ours('ui.viewport.surface.preview').state.shown.surface.faces)") != before


def test_a_drag_is_one_undo_step(desk):
    desk.ask("bpy.ops.ed.undo()")
    assert desk.ask(LIMITS)[0] == 200


def test_the_upper_limit_comes_from_the_right_end_and_goes_there(desk):
    (_, last) = places(desk, 200, 1e9)
    (middle,) = places(desk, 600)
    desk.drag(last, middle)
    assert desk.ask(LIMITS) == pytest.approx([200, 600], abs=10)
    desk.look("histogram-03-upper")
    desk.drag(middle, (last[0] + 5, last[1]))
    assert desk.ask(LIMITS)[1] is None


def test_a_drag_that_is_broken_off_changes_nothing(desk):
    start, end = places(desk, 200, 600)
    desk.move(*start)
    desk.hand("mousedown", "1")
    for x in range(start[0], end[0], 20):
        desk.move(x, end[1])
    assert desk.ask(LIMITS)[0] > 300
    desk.key("Escape")
    desk.hand("mouseup", "1")
    assert desk.ask(LIMITS)[0] == 200
    assert desk.ask(f"answer = {IS_OPEN}")


def test_outside_the_strip_the_viewport_is_as_ever(desk):
    (place,) = places(desk, 500)
    eye = "answer = [viewport().space.region_3d.view_distance, *viewport().space.region_3d.view_rotation]"
    desk.ask("bpy.context.preferences.view.smooth_view = 0")
    before = desk.ask(eye)
    desk.turn_wheel(place[0], place[1] - 400, up=False, clicks=2)
    farther = desk.ask(eye)
    assert farther[0] > before[0]
    desk.key("KP_1")
    assert desk.ask(eye)[1:] != farther[1:]
    assert desk.ask(LIMITS)[0] == 200
    assert desk.ask(f"answer = {IS_OPEN}")


def test_in_german_at_twice_the_size_nothing_runs_into_each_other(desk):
    desk.ask("""
bpy.context.preferences.view.language = "de_DE"
bpy.context.preferences.view.ui_scale = 2.0
""")
    desk.look("histogram-04-german")
    (place,) = places(desk, 175)
    desk.move(*place)
    desk.look("histogram-05-german-pointed")
    desk.ask("bpy.context.preferences.view.language = 'en_US'; bpy.context.preferences.view.ui_scale = 1.1")


def test_escape_closes_it_and_the_button_too(desk):
    (place,) = places(desk, 500)
    desk.move(place[0], place[1] - 300)
    desk.key("Escape")
    assert not desk.ask(f"answer = {IS_OPEN}")
    desk.press(BUTTON, "histogram", ICON)
    assert desk.ask(f"answer = {IS_OPEN}")
    desk.press(BUTTON, "histogram", ICON)
    assert not desk.ask(f"answer = {IS_OPEN}")
    desk.look("histogram-06-closed")


def test_disabling_the_extension_leaves_nothing(desk):
    desk.press(BUTTON, "histogram", ICON)
    desk.ask("""
import addon_utils
addon_utils.disable("bl_ext.user_default.ctmc")
viewport().area.tag_redraw()
""")
    desk.look("histogram-07-disabled")
    desk.ask("addon_utils = __import__('addon_utils'); addon_utils.enable('bl_ext.user_default.ctmc')")
    assert "Traceback" not in desk.last_words()
