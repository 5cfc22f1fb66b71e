# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut Away by mouse and keys: a half, inside and outside; a box that G moves by typed millimeters."""

from __future__ import annotations

import pytest
from window.scenes import IDLE, begin, load

pytestmark = pytest.mark.window

RADIUS = 12.0  # mm
# A ball of 100 HU in air, looked at from the patient's front.
BALL = """
import numpy as np
z, y, x = np.mgrid[:32, :32, :32] - 15.5
np.save("{folder}/ball.npy", (100 * np.clip({radius} - np.sqrt(x**2 + y**2 + z**2), -1, 1)).astype(np.int16))
"""
VIEW = """
view = viewport()
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.ctmc.view(side="A")
bpy.context.scene.ctmc_view.show_slice = False
"""
# Volume in ml of the surface as it is shown, and its ends along y (to the front) from the ball's middle, mm.
SHOWN = """
import numpy as np
bpy.context.view_layer.update()
(obj,) = [obj for obj in bpy.data.objects if obj.modifiers and obj.type == "MESH" and "ctmc" in obj]
mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
mesh.calc_loop_triangles()
points = np.array([obj.matrix_world @ vertex.co for vertex in mesh.vertices]) * 100 - (-15.5, -15.5, 15.5)
triangles = points[np.array([triangle.vertices[:] for triangle in mesh.loop_triangles])]
volume = np.einsum("ij,ij->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6
answer = [volume / 1000, points[:, 1].min(), points[:, 1].max()]
"""
FULL = 4 / 3 * 3.14159265 * RADIUS**3 / 1000


@pytest.fixture(scope="module", autouse=True)
def ball(desk):
    """A surface of a ball."""
    begin(desk, "cuts")
    desk.ask("bpy.context.preferences.view.smooth_view = 0")
    desk.ask(BALL.format(radius=RADIUS, folder=desk.inside))
    load(desk, f"{desk.inside}/ball.npy", spacing=(1.0, 1.0, 1.0))
    desk.ask("s = bpy.context.scene.ctmc; s.use_threshold = True; s.threshold = 0; s.preview = False")
    desk.ask("bpy.ops.ctmc.reconstruct()")
    desk.wait(IDLE)
    desk.ask(VIEW)


def test_the_half_before_the_eye_is_taken_away_and_the_other_in_its_place(desk):
    desk.press("bpy.ops.ctmc.cut_away()", "cut_away", 0.2)
    assert desk.ask(SHOWN) == pytest.approx([FULL / 2, -RADIUS, 0], rel=0.02, abs=0.05)
    desk.look("away-01-half")
    desk.ask("bpy.ops.ctmc.flip_cut_away()")
    assert desk.ask(SHOWN) == pytest.approx([FULL / 2, 0, RADIUS], rel=0.02, abs=0.05)
    desk.ask("bpy.ops.ctmc.flip_cut_away()")


def test_g_moves_the_cut_with_the_box_and_escape_brings_it_back(desk):
    before = desk.ask(SHOWN)
    desk.move(*desk.ask("view = viewport().region; answer = [view.x + view.width // 3, view.y + view.height // 3]"))
    for keys in ("g", "y", "6"):
        desk.key(keys)
    assert desk.ask(SHOWN)[2] == pytest.approx(6, abs=0.05)  # live, before Enter
    desk.key("Escape")
    assert desk.ask(SHOWN) == pytest.approx(before)
    for keys in ("g", "y", "6", "Return"):
        desk.key(keys)
    volume, *_ = desk.ask(SHOWN)
    cap = 3.14159265 * 6**2 * (3 * RADIUS - 6) / 3 / 1000  # above 6 mm from the middle
    assert volume == pytest.approx(FULL - cap, rel=0.02)
    desk.look("away-02-moved")


def test_remove_makes_it_whole(desk):
    desk.ask("bpy.ops.ctmc.remove_cut_away()")
    assert desk.ask("answer = [len(o.modifiers) for o in bpy.data.objects if o.type == 'MESH']") == [0]
    assert "Traceback" not in desk.last_words()
