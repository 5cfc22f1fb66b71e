# SPDX-License-Identifier: GPL-3.0-or-later
"""Quad View: three slices from their sides, none covered by a surface, each as large as there is room, to draw on."""

from __future__ import annotations

import numpy as np
import pytest
from window.conftest import CT
from window.scenes import IDLE, QUIET, begin, load

pytestmark = pytest.mark.window

CALL = """
view = viewport()
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.ctmc.{}("INVOKE_DEFAULT")
"""
# Of each view from a side: share of its free width and height that the CT takes, and how far the nearest slice that
# faces it lies behind what is shown, mm.
VIEWS = """
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Vector
view, answer = viewport(), {}
volume = ours("ui.state.ct.volumes").current(bpy.context.scene)
corners = ours("core.volume").volume_box(volume) * 0.01
planes = {obj["ctmc_slice_plane"]: obj.location for obj in bpy.data.objects if "ctmc_slice_plane" in obj}
bars = [region for region in view.area.regions if region.type in ("UI", "TOOLS")]
heads = [region.y for region in view.area.regions if region.type in ("HEADER", "TOOL_HEADER") and region.height > 1]
for region in (region for region in view.area.regions if region.type == "WINDOW" and region.data.lock_rotation):
    back = region.data.view_rotation @ Vector((0, 0, 1))
    plane = ("sagittal", "coronal", "axial")[max(range(3), key=lambda axis: abs(back[axis]))]
    xs, ys = zip(*(location_3d_to_region_2d(region, region.data, Vector(corner)) for corner in corners))
    ends = [(max(region.x, bar.x), min(region.x + region.width, bar.x + bar.width)) for bar in bars]
    left = max([0] + [b - region.x for (a, b), bar in zip(ends, bars) if b > a and bar.type == "TOOLS"])
    right = min([region.width] + [a - region.x for (a, b), bar in zip(ends, bars) if b > a and bar.type == "UI"])
    top = min([region.height] + [y - region.y for y in heads if y > region.y])
    inside = left <= min(xs) and max(xs) <= right and 0 <= min(ys) and max(ys) <= top
    share = max((max(xs) - min(xs)) / (right - left), (max(ys) - min(ys)) / top)
    clipped = Vector(region.data.clip_planes[0])
    answer[plane] = [inside, share, 100 * clipped.dot((*planes[plane], 1)), region.data.use_clip_planes]
"""


# Share of the middle of the coronal slice's view that has the preview's color, a yellow; without one it is gray.
PREVIEW = "s = bpy.context.scene.ctmc; s.use_threshold = True; s.threshold = -200; s.preview = {}"


def yellow_in_front(desk, name):
    """How many pixels of the lower left view, which sees the coronal slice, are yellow."""
    x, y, width, height = desk.ask("""
view = viewport()
region = min((r for r in view.area.regions if r.type == "WINDOW"), key=lambda r: r.x + r.y)
answer = [region.x, view.window.height - region.y - region.height, region.width, region.height]
""")
    pixels = np.asarray(desk.look(name).crop((x + 80, y + 60, x + width - 80, y + height - 10)), int)
    return int((pixels[..., 0] - pixels[..., 2] > 20).sum())


def test_each_slice_fills_its_view_and_no_surface_covers_it(desk):
    begin(desk)
    load(desk, f"{desk.inside}/{CT}")
    desk.ask("s = bpy.context.scene.ctmc; s.threshold = 200; s.stride = (8, 8, 1); s.preview = False")
    desk.ask("bpy.ops.ctmc.reconstruct()")
    desk.wait(IDLE)
    desk.ask("bpy.context.preferences.view.smooth_view = 0")
    desk.press("bpy.ops.ctmc.quad_view()", "quad_view")
    desk.look("quad-01-divided")
    views = desk.ask(VIEWS)
    assert set(views) == {"axial", "coronal", "sagittal"}
    for inside, share, behind, clips in views.values():
        assert inside
        assert 0.8 < share <= 1
        assert behind == pytest.approx(0.01, abs=1e-3)
        assert clips


def test_the_live_preview_covers_no_slice(desk):
    desk.ask(PREVIEW.format(False))
    without = yellow_in_front(desk, "quad-02-no-preview")
    desk.ask(PREVIEW.format(True))
    desk.wait(QUIET)
    assert yellow_in_front(desk, "quad-02-preview") - without < 3000
    desk.ask(PREVIEW.format(False))


def test_a_slice_that_is_moved_takes_what_hides_the_surfaces_along(desk):
    desk.ask("next(o for o in bpy.data.objects if o.get('ctmc_slice_plane') == 'axial').location.z += 0.3")
    assert desk.ask(VIEWS)["axial"][2] == pytest.approx(0.01, abs=1e-3)
    desk.look("quad-03-moved")


# Where the middle of each slice is seen from its side.
MIDDLES = """
from mathutils import Vector
from bpy_extras.view3d_utils import location_3d_to_region_2d
view, answer = viewport(), {}
planes = {obj["ctmc_slice_plane"]: obj.location for obj in bpy.data.objects if "ctmc_slice_plane" in obj}
for region in (region for region in view.area.regions if region.type == "WINDOW" and region.data.lock_rotation):
    back = region.data.view_rotation @ Vector((0, 0, 1))
    plane = ("sagittal", "coronal", "axial")[max(range(3), key=lambda axis: abs(back[axis]))]
    at = location_3d_to_region_2d(region, region.data, planes[plane])
    answer[plane] = [round(region.x + at.x) + 40, round(view.window.height - 1 - region.y - at.y)]
"""
VOXELS = """
scene, drawings, masks = bpy.context.scene, ours("ui.state.draw.drawings"), ours("ui.state.draw.masks")
answer = sum(int(masks.of(scene, item).mask.sum()) for item in drawings.structures(scene))
"""
TAKE = """
view = viewport()
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.ctmc.draw_tool(tool="ctmc.{}")
"""


@pytest.mark.once
def test_each_of_the_three_slices_is_drawn_on(desk):
    desk.ask("bpy.ops.ed.undo_push(message='Begin')")
    desk.ask(TAKE.format("brush"))
    middles = desk.ask(MIDDLES)
    assert set(middles) == {"axial", "coronal", "sagittal"}
    for x, y in middles.values():
        before = desk.ask(VOXELS)
        desk.drag((x, y), (x + 25, y))
        drawn = desk.ask(VOXELS)
        assert drawn > before
        desk.key("ctrl+z")
        assert desk.ask(VOXELS) == before
        desk.key("ctrl+shift+z")
        assert desk.ask(VOXELS) == drawn
        assert [behind for _, _, behind, _ in desk.ask(VIEWS).values()] == pytest.approx([0.01] * 3, abs=1e-3)
        desk.move(x, y + 8)
        desk.hand("mousedown", "1")
        desk.ask("answer = 'pressed'")
        desk.move(x + 25, y + 8)
        assert desk.ask(VOXELS) > drawn
        desk.key("Escape")
        desk.hand("mouseup", "1")
        assert desk.ask(VOXELS) == drawn
    desk.look("quad-04-drawn")


def test_once_more_brings_back_one_view_that_hides_nothing(desk):
    desk.ask(CALL.format("quad_view"))
    desk.look("quad-05-one")
    assert desk.ask(
        "view = viewport().space; answer = [len(view.region_quadviews), view.region_3d.use_clip_planes]"
    ) == [0, False]
    assert "Traceback" not in desk.last_words()
