# SPDX-License-Identifier: GPL-3.0-or-later
"""What drawing refuses, and that nothing is left of it: without labels in memory, in edit mode, after undo."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
from ui.strokes import mask, middle, stroke

from ctmc_addon.core import SettingsError, Volume, finish
from ctmc_addon.core.volume import ValueKind
from ctmc_addon.ui.operators.draw import stroke as stroke_module
from ctmc_addon.ui.operators.draw.edits import CTMC_OT_draw_margin
from ctmc_addon.ui.operators.draw.grow import CTMC_OT_draw_grow
from ctmc_addon.ui.operators.draw.radius import CTMC_OT_draw_radius
from ctmc_addon.ui.operators.draw.scissors import CTMC_OT_draw_cut
from ctmc_addon.ui.operators.draw.stroke import CTMC_OT_draw_stroke
from ctmc_addon.ui.state.ct import volumes
from ctmc_addon.ui.state.surface import structures
from ctmc_addon.ui.viewport.ct.slice_hits import SliceHit


@pytest.mark.parametrize("how", ["or", "minus", "and"])
def test_a_label_that_is_not_in_memory_is_not_combined(drawing, tmp_path, how):
    scene, ct = bpy.context.scene, volumes.current(bpy.context.scene)
    stroke(middle())
    before = mask().copy()
    labels = Volume(np.ones(ct.shape, np.uint8), ct.affine, kind=ValueKind.LABEL, label_names={1: "liver"})
    structures.add_labels(scene, labels, "a file", tmp_path / "gone.nii.gz")
    volumes.require_loaded(scene).labels.clear()  # as when the .blend is opened and the file is gone
    drawing.other, drawing.combination = "liver", how
    with pytest.raises(RuntimeError, match="The labels of liver are not in memory; press Load Again"):
        bpy.ops.ctmc.draw_combine()
    assert (mask() == before).all()
    assert before.any()


def test_in_edit_mode_nothing_is_drawn_nor_removed(drawing):
    stroke(middle())
    before = mask().copy()
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.object.mode_set(mode="EDIT")
    edits = ("draw_margin", "draw_islands", "draw_holes", "draw_between", "draw_combine", "remove_structure")
    for name in ("draw_stroke", "draw_grow", "draw_cut", "draw_lasso", "draw_add", "draw_tool", *edits):
        assert not getattr(bpy.ops.ctmc, name).poll(), name
    with pytest.raises(RuntimeError, match="Leave Edit Mode first"):
        bpy.ops.ctmc.draw_margin()
    assert (mask() == before).all()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert bpy.ops.ctmc.draw_margin() == {"FINISHED"}


def chosen():
    """What of the list and the panel a first stroke changes."""
    stored = bpy.context.scene.ctmc
    ticks = [(line.name, line.chosen) for line in stored.labels]
    return stored.label_index, stored.label, stored.use_label, stored.use_threshold, ticks


def test_the_eraser_needs_a_structure(drawing):
    before = chosen()
    with pytest.raises(RuntimeError, match="There is no structure; add one first"):
        stroke(middle(), erase=True)
    assert chosen() == before
    assert len(drawing.structures) == 0


def test_a_first_stroke_that_draws_nothing_leaves_no_structure(drawing):
    before = chosen()
    drawing.use_range, drawing.low, drawing.high = True, 500.0, 100.0
    with pytest.raises(RuntimeError, match="not from 500 to 100; swap them"):
        stroke(middle())
    drawing.low, drawing.high = 30_000.0, 31_000.0
    with pytest.raises(RuntimeError, match="Nothing was drawn: no voxel under the brush is in the CT and in the range"):
        stroke(middle())
    drawing.use_range = False
    with pytest.raises(RuntimeError, match="Nothing was drawn"):
        stroke((900.0, 0.0, 0.0))
    assert chosen() == before
    assert len(drawing.structures) == 0


@pytest.mark.parametrize("mode", ["label", "threshold"])
def test_a_first_stroke_that_is_taken_back_leaves_the_list_as_it_was(drawing, mode):
    scene = bpy.context.scene
    ct = volumes.current(scene)
    for name in ("liver", "spleen"):
        labels = Volume(np.ones(ct.shape, np.uint8), ct.affine, kind=ValueKind.LABEL, label_names={1: name})
        structures.add_labels(scene, labels, name)
    if mode == "label":
        scene.ctmc.labels[0].chosen = True
    else:
        scene.ctmc.threshold = 120.0
    before = chosen()
    running = operator(CTMC_OT_draw_stroke, erase=False)
    running.start(scene)
    running.dab(scene, [middle()], (0, 0, 1))
    assert chosen() != before
    running.cancel(bpy.context)
    assert chosen() == before


def test_without_a_structure_surfaces_are_made_at_the_threshold_again(drawing):
    stored = bpy.context.scene.ctmc
    stroke(middle())
    assert stored.use_label
    bpy.ops.ctmc.remove_structure()
    assert not stored.use_label
    assert (stored.use_threshold, stored.threshold) == (True, 100.0)
    assert [settings.threshold for settings in stored.all_settings()] == [100.0]


def test_a_label_that_is_removed_is_not_the_one_that_is_made(drawing):
    stored = bpy.context.scene.ctmc
    stroke(middle())
    bpy.ops.ctmc.draw_add()
    stored.label = 2
    bpy.ops.ctmc.remove_structure()
    assert (stored.label, stored.label_index, stored.use_label) == (1, 0, True)


def two_strokes(drawing):
    """Two balls, a step of undo each; returns the first alone."""
    drawing.radius_mm, drawing.ball = 3.0, True
    x, y, z = middle()
    stroke((x - 5, y, z))
    bpy.ops.ed.undo_push(message="Stroke")
    first = mask().copy()
    stroke((x + 5, y, z))
    bpy.ops.ed.undo_push(message="Stroke")
    return first


def operator(kind, **properties):
    """An operator as it is while it runs, without a window."""
    return type("Running", (kind.__mro__[1], SimpleNamespace), dict(vars(kind)))(**properties)


@pytest.mark.parametrize("kind", ["margin", "cut", "grow"])
def test_undo_while_a_job_changes_the_structure_is_not_overwritten(drawing, kind):
    first = two_strokes(drawing)
    drawing.method, drawing.low, drawing.high, drawing.margin_mm = "connected", 100.0, 1000.0, 6.0
    kinds = {"margin": CTMC_OT_draw_margin, "cut": CTMC_OT_draw_cut, "grow": CTMC_OT_draw_grow}
    lasso = [SimpleNamespace(at=at) for at in ((-1, -1), (1, -1), (0, 1))]
    running = operator(
        kinds[kind], view=np.eye(4), lasso=lasso, keep_inside=False, point_mm=middle(), surroundings=False
    )
    steps = running.plan(bpy.context)
    next(steps)
    bpy.ops.ed.undo()
    with pytest.raises(SettingsError, match="changed meanwhile"):
        finish(steps)()
    assert (mask() == first).all()


def test_work_under_way_reads_the_drawing_as_it_was_before_undo(drawing):
    two_strokes(drawing)
    held, before = structures.label_volume(bpy.context.scene), mask().copy()
    bpy.ops.ed.undo()
    assert (mask() != before).any()
    assert ((held.values > 0) == before).all()


def test_a_stroke_follows_the_mouse_in_the_viewport_where_it_began(drawing, monkeypatch):
    area = SimpleNamespace(type="VIEW_3D", as_pointer=lambda: 7)
    other = SimpleNamespace(type="VIEW_3D", as_pointer=lambda: 8)
    asked = []
    monkeypatch.setattr(stroke_module, "brush_under", lambda _scene, area, *_: asked.append(area))
    running = operator(CTMC_OT_draw_stroke, area=7, hit=SliceHit(middle(), np.eye(4, 3)))
    for areas in ([other, area], [other]):  # the mouse is over another editor; then the viewport is gone
        window = SimpleNamespace(screen=SimpleNamespace(areas=areas))
        context = SimpleNamespace(scene=bpy.context.scene, area=None, window=window)
        assert running.modal(context, SimpleNamespace(type="MOUSEMOVE", value="NOTHING")) == {"RUNNING_MODAL"}
    assert asked == [area]


@pytest.mark.parametrize(
    ("key", "result", "radius_mm"),
    [
        ("ESC", {"CANCELLED"}, 5.0),
        ("RIGHTMOUSE", {"CANCELLED"}, 5.0),
        ("LEFTMOUSE", {"FINISHED"}, 10.0),
        ("RET", {"FINISHED"}, 10.0),
        ("A", {"RUNNING_MODAL"}, 10.0),
    ],
)
def test_a_radius_is_accepted_by_a_click_and_brought_back_by_esc(drawing, key, result, radius_mm):
    running = operator(CTMC_OT_draw_radius, before=5.0, left=0)
    system = SimpleNamespace(ui_scale=1.0)
    context = SimpleNamespace(
        scene=bpy.context.scene,
        workspace=bpy.context.workspace or bpy.data.workspaces[0],
        preferences=SimpleNamespace(system=system),
    )
    running.modal(context, SimpleNamespace(type="MOUSEMOVE", value="NOTHING", mouse_x=120))
    assert drawing.radius_mm == pytest.approx(10.0)
    assert running.modal(context, SimpleNamespace(type=key, value="PRESS")) == result
    assert drawing.radius_mm == pytest.approx(radius_mm)
