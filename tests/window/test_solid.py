# SPDX-License-Identifier: GPL-3.0-or-later
"""The fold Solid by mouse: a hollow ball is cut, its planes are seen in the viewport, and its parts are made."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import distance_mm
from window.scenes import IDLE, QUIET, begin, load

pytestmark = pytest.mark.window

SIDE = 56  # Samples and mm of the CT.
MAKE = "bpy.ops.ctmc.reconstruct()"
PARTS = "answer = sorted(o.name for o in bpy.data.objects if o.type == 'MESH')"
CUT_COLOR = (242, 115, 26)
# The cursor in the middle of the ball, and a cut across an axis there.
CUT = """
corners = ours("core.volume").volume_box(ours("ui.state.ct.volumes").current(bpy.context.scene))
bpy.context.scene.cursor.location = corners.mean(axis=0) * 0.01
bpy.ops.ctmc.cut_add(direction={axis!r})
"""


@pytest.fixture(scope="module", autouse=True)
def ball(desk):
    """A ball of 20 mm, loaded, the fold Solid open."""
    values = 300 - 10 * distance_mm((SIDE, SIDE, SIDE), spacing=(1, 1, 1))
    np.save(desk.folder / "ball.npy", values.astype(np.int16))
    begin(desk, "solid")
    load(desk, f"{desk.inside}/ball.npy", spacing=(1, 1, 1))
    desk.ask("s = bpy.context.scene; s.ctmc.threshold = 100; s.ctmc.preview = False")
    desk.ask("bpy.context.scene.ctmc_view.show_slice = False")
    desk.wait(QUIET)
    desk.show("SURFACE")
    yield desk
    desk.ask("bpy.context.preferences.view.language = 'en_US'")


FROM_THE_FRONT = """
from mathutils import Euler, Vector
about = viewport().space.region_3d
about.view_perspective = "PERSP"
about.view_rotation = Euler((1.2, 0, 2.6)).to_quaternion()
"""
# Where the handles of the first cut are: the head of the arrow, and the ring before it.
HANDLES = """
from mathutils import Vector
handles, scene = ours("ui.viewport.surface.solid_handles"), bpy.context.scene
middle, unit = Vector(handles.middle_of(scene, 0) * 0.01), Vector(scene.ctmc_solid.cuts[0].normal)
(x, y), (u, v) = on_screen(middle), on_screen(middle + unit)
length = ((u - x) ** 2 + (v - y) ** 2) ** 0.5
size = bpy.context.preferences.view.gizmo_size * bpy.context.preferences.system.ui_scale
answer = [[round(x + at * size * (u - x) / length), round(y + at * size * (v - y) / length)] for at in (0.55, 1.0)]
"""
VALUES = "c = bpy.context.scene.ctmc_solid.cuts[0]; answer = [*c.point, *c.normal]"


def of_color(picture, color):
    """Number of pixels about this color."""
    pixels = np.asarray(picture.convert("RGB"), np.int16)
    return int((np.abs(pixels - color).max(axis=-1) < 24).sum())


def test_cuts_pegs_and_drains_are_seen_in_the_viewport(desk):
    before = of_color(desk.look("solid-01-before"), CUT_COLOR)
    desk.ask(CUT.format(axis="Z"))
    assert of_color(desk.look("solid-02-cut"), CUT_COLOR) > before + 200
    desk.ask("s = bpy.context.scene.ctmc_solid; s.use_pegs = True; s.hollow = 6; s.peg_diameter = 2; s.peg_length = 3")
    desk.press("bpy.ops.ctmc.drain_add()", "drain_add", 0.3)
    assert desk.ask("answer = len(bpy.context.scene.ctmc_solid.drains)") == 1
    desk.wait("not ours('ui.viewport.surface.solid_places').is_looking(bpy.context.scene)")
    outline = "outline = ours('ui.viewport.surface.solid').outline_of(bpy.context.scene)"
    assert desk.ask(f"{outline}; answer = [len(outline.pegs), len(outline.drains)]") == [2, 1]
    desk.look("solid-03-pegs-and-drain")
    desk.show("RESULTS")
    assert of_color(desk.look("solid-04-other-page"), CUT_COLOR) <= before
    desk.show("SURFACE")


def test_a_drag_moves_the_cut_another_turns_it_and_each_is_one_step_to_undo(desk):
    desk.ask(FROM_THE_FRONT)
    desk.ask("bpy.context.scene.ctmc_solid.drains.clear(); bpy.ops.ed.undo_push(message='Before')")
    before = desk.ask(VALUES)
    (x, y), _ = desk.ask(HANDLES)
    desk.drag((x, y), (x, y - 60))
    moved = desk.ask(VALUES)
    desk.look("solid-03-moved")
    assert moved[2] > before[2] + 2
    assert moved[3:] == before[3:]
    _, (x, y) = desk.ask(HANDLES)
    desk.drag((x, y), (x + 60, y))
    turned = desk.ask(VALUES)
    desk.look("solid-03-turned")
    assert abs(turned[3]) > 0.2
    for values in (moved, before):
        desk.key("ctrl+z")
        assert desk.ask(VALUES) == pytest.approx(values)


def test_escape_leaves_no_part_and_undo_takes_all_back(desk):
    desk.ask("bpy.context.scene.ctmc_solid.drains.clear()")
    desk.press(MAKE, "reconstruct")
    desk.key("Escape")
    desk.wait(IDLE)
    assert desk.ask(PARTS) == []
    desk.press(MAKE, "reconstruct")
    desk.wait(f"{IDLE} and len(bpy.data.meshes) == 2")
    assert desk.ask(PARTS) == ["ball a", "ball b"]
    desk.look("solid-05-parts")
    left, _, width, _ = desk.sidebar()
    desk.move(left - width, 500)
    desk.key("ctrl+z")
    assert desk.ask(PARTS) == []
    desk.key("ctrl+shift+z")
    assert desk.ask(PARTS) == ["ball a", "ball b"]


def test_one_press_resets_the_solid(desk):
    desk.press("bpy.ops.ctmc.solid_reset()", "solid_reset", 0.83)
    assert desk.ask("answer = bool(bpy.context.scene.ctmc_solid.to_request())") is False


@pytest.mark.parametrize(
    "language", ["en_US", *(pytest.param(each, marks=pytest.mark.once) for each in ("de_DE", "zh_HANS"))]
)
def test_the_fold_can_be_looked_at_in_every_language(desk, language):
    desk.ask(f"bpy.context.preferences.view.language = {language!r}")
    desk.show("SURFACE")
    desk.ask(CUT.format(axis="X"))
    desk.ask("bpy.ops.ctmc.drain_add(); bpy.ops.ctmc.drain_add(auto=True); bpy.ops.ctmc.combination_add()")
    desk.ask("s = bpy.context.scene.ctmc_solid; s.use_pegs = s.use_bed = True; s.hollow = 2")
    desk.look(f"solid-06-{language}")
    desk.scroll(1)
    desk.look(f"solid-07-{language}")
    desk.scroll(0)
    desk.ask("bpy.ops.ctmc.solid_reset()")
