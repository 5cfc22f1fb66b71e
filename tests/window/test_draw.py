# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawing by mouse in the viewport: strokes on the slice and along a surface, undo, Esc, Ctrl, F, lasso, growing."""

from __future__ import annotations

import pytest
from window.conftest import CT
from window.scenes import IDLE, begin, load

pytestmark = pytest.mark.window

# The axial slice in front, seen from the head; the middle of the slice and its size, world space.
BEGIN = """
bpy.context.preferences.view.smooth_view = 0
scene, view = bpy.context.scene, viewport()
scene.ctmc_view.plane, scene.ctmc_draw.radius_mm = "axial", 12.0
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.ctmc.view(side="S")
core, volume = ours("core.volume"), ours("ui.state.ct.volumes").current(scene)
corners = core.slice_corners(volume, core.slice_at(volume, "axial", scene.ctmc_view.position)) * 0.01
bpy.ops.ed.undo_push(message="Begin")
answer = [corners.mean(axis=0).tolist(), (corners.max(axis=0) - corners.min(axis=0)).tolist()]
"""
TAKE = """
view = viewport()
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.ctmc.draw_tool(tool={!r})
"""
# How many voxels the active structure has; -1 without one.
VOXELS = """
scene, drawings, masks = bpy.context.scene, ours("ui.state.draw.drawings"), ours("ui.state.draw.masks")
item = drawings.active(scene)
answer = -1 if item is None else int(masks.of(scene, item).mask.sum())
"""
SELECTED = "answer = [[obj.name for obj in bpy.context.selected_objects], getattr(bpy.context.object, 'name', None)]"
# The view from the head, and where the middle of the surface is in it.
FROM_HEAD = """
view = viewport()
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.ctmc.view(side="S")
"""
SURFACE_MIDDLE = """
from mathutils import Vector
obj = next(obj for obj in bpy.data.objects if obj.name.endswith("Structure 2"))
corners = [obj.matrix_world @ Vector(corner) for corner in obj.bound_box]
answer = [round(value) for value in on_screen(sum(corners, Vector()) / 8)]
"""
VOXEL_MM2 = 0.74 * 0.74


@pytest.fixture(scope="module")
def at(desk):
    """The pixel of a place on the slice: shares of its width and depth from its middle."""
    begin(desk)
    load(desk, f"{desk.inside}/{CT}")
    middle, size = desk.ask(BEGIN)

    def place(right, front):
        point = [middle[0] + right * size[0], middle[1] + front * size[1], middle[2]]
        return tuple(round(value) for value in desk.ask(f"answer = on_screen({point})"))

    return place


def voxels(desk):
    return desk.ask(VOXELS)


def test_a_stroke_is_as_large_as_the_brush_and_undo_takes_it_back(desk, at):
    desk.ask(TAKE.format("ctmc.brush"))
    desk.drag(at(-0.2, 0.1), at(-0.1, 0.1))
    length, radius = 0.1 * 512 * 0.74, 12.0
    exact = (2 * radius * length + 3.1416 * radius**2) / VOXEL_MM2
    first = voxels(desk)
    assert first == pytest.approx(exact, rel=0.08)  # a pixel of the screen is 0.8 mm
    assert desk.ask("answer = bpy.data.is_dirty")
    desk.look("draw-01-stroke")
    desk.drag(at(-0.2, -0.05), at(-0.15, -0.05))
    assert voxels(desk) > 1.3 * first
    desk.key("ctrl+z")
    assert voxels(desk) == first
    desk.key("ctrl+shift+z")
    assert voxels(desk) > 1.3 * first
    desk.key("ctrl+z")


def test_escape_takes_a_stroke_back_and_ctrl_erases(desk, at):
    before = voxels(desk)
    desk.move(*at(0.1, 0.1))
    desk.hand("mousedown", "1")
    desk.move(*at(0.15, 0.1))
    assert voxels(desk) > before
    desk.key("Escape")
    desk.hand("mouseup", "1")
    assert voxels(desk) == before
    desk.hand("keydown", "ctrl")
    desk.drag(at(-0.2, 0.1), at(-0.1, 0.1))
    desk.hand("keyup", "ctrl")
    assert voxels(desk) < 0.05 * before
    desk.key("ctrl+z")
    assert voxels(desk) == before


def test_f_changes_the_radius_and_escape_leaves_it(desk, at):
    x, y = at(0.0, 0.1)
    for key, larger in (("Return", True), ("Escape", False)):
        before = desk.ask("answer = bpy.context.scene.ctmc_draw.radius_mm")
        desk.move(x, y)
        desk.key("f")
        desk.move(x + 60, y)
        desk.look(f"draw-02-radius-{key}")
        desk.key(key)
        after = desk.ask("answer = bpy.context.scene.ctmc_draw.radius_mm")
        assert (after > 1.2 * before) if larger else (after == pytest.approx(before))


def test_a_click_during_a_job_and_scissors_without_a_structure_select_nothing(desk, at):
    before = desk.ask(SELECTED)
    marked = desk.ask("answer = bpy.context.scene.ctmc.label_index")
    desk.ask(
        "class Steps: close = staticmethod(lambda: None)\njobs = ours('ui.jobs')\n"
        "jobs._running.append(jobs.Job('', 'Test', Steps, 0))"
    )
    desk.click(*at(0.2, 0.1))
    desk.ask("ours('ui.jobs').stop_running()")
    desk.ask("bpy.context.scene.ctmc.label_index = -1")
    desk.ask(TAKE.format("ctmc.scissors"))
    desk.click(*at(0.2, 0.1))
    desk.ask(TAKE.format("ctmc.brush"))
    desk.ask(f"bpy.context.scene.ctmc.label_index = {marked}")
    assert desk.ask(SELECTED) == before != [[], None]


def test_scissors_cut_off_what_the_lasso_encloses(desk, at):
    before = voxels(desk)
    desk.ask(TAKE.format("ctmc.scissors"))
    (left, top), (right, bottom) = at(-0.3, 0.2), at(-0.15, 0.0)
    desk.move(left - 2, top)
    desk.move(left, top)
    desk.hand("mousedown", "1")
    desk.ask("answer = 'pressed'")  # a press is where the mouse is when Blender sees it
    for corner in ((right, top), (right, bottom), (left, bottom)):
        desk.move(*corner)
    desk.hand("mouseup", "1")
    desk.wait(IDLE)
    assert 0.2 * before < voxels(desk) < 0.8 * before
    desk.key("ctrl+z")
    assert voxels(desk) == before


def test_a_click_grows_and_reconstruct_makes_it(desk, at):
    desk.ask("bpy.ops.ctmc.draw_add()")
    desk.ask(TAKE.format("ctmc.grow"))
    desk.click(*at(0.06, 0.12))  # the liver of the phantom
    desk.wait(IDLE)
    grown = voxels(desk)
    assert grown > 50_000
    desk.look("draw-03-grown")
    desk.ask("for line in bpy.context.scene.ctmc.labels[:-1]: line.chosen = False")
    desk.ask("bpy.ops.ctmc.reconstruct()")
    made = desk.ask("answer = [obj.name for obj in bpy.data.objects if obj.name.endswith('Structure 2')]")
    assert len(made) == 1
    desk.ask("view = viewport()\nview.space.overlay.show_overlays = True")
    desk.look("draw-04-made")


def test_the_brush_draws_along_a_surface(desk, at):
    before = voxels(desk)
    desk.ask(FROM_HEAD)
    desk.ask(TAKE.format("ctmc.brush"))
    desk.ask("bpy.context.scene.ctmc_view.show_slice = False; bpy.context.scene.ctmc_draw.on_surfaces = True")
    x, y = desk.ask(SURFACE_MIDDLE)
    desk.drag((x - 20, y), (x + 20, y))
    desk.look("draw-05-on-surface")
    assert voxels(desk) > before + 300  # half of the ball lies outside of the surface
    with_bump = voxels(desk)
    desk.hand("keydown", "ctrl")
    desk.drag((x - 20, y), (x + 20, y))
    desk.hand("keyup", "ctrl")
    assert voxels(desk) < before < with_bump
    desk.key("ctrl+z")
    assert voxels(desk) == with_bump
    desk.drag((120, 120), (160, 120))  # beside the surface
    assert voxels(desk) == with_bump
    assert "Traceback" not in desk.last_words()
