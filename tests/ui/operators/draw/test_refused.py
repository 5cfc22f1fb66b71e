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
from ctmc_addon.ui.operators.draw.edits import CTMC_OT_draw_margin
from ctmc_addon.ui.operators.draw.grow import CTMC_OT_draw_grow
from ctmc_addon.ui.operators.draw.scissors import CTMC_OT_draw_cut
from ctmc_addon.ui.state import structures, volumes


@pytest.mark.parametrize("how", ["or", "minus", "and"])
def test_a_label_that_is_not_in_memory_is_not_combined(drawing, tmp_path, how):
    scene, ct = bpy.context.scene, volumes.current(bpy.context.scene)
    stroke(middle())
    before = mask().copy()
    labels = Volume(np.ones(ct.shape, np.uint8), ct.affine, kind=ValueKind.LABEL, label_names={1: "liver"})
    structures.add_labels(scene, labels, "a file", tmp_path / "gone.nii.gz")
    structures._sources.clear()  # as when the .blend is opened and the file is gone
    drawing.other, drawing.combination = "liver", how
    with pytest.raises(RuntimeError, match="the labels of liver are not in memory; press Load Again"):
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
    with pytest.raises(RuntimeError, match="Leave edit mode first"):
        bpy.ops.ctmc.draw_margin()
    assert (mask() == before).all()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert bpy.ops.ctmc.draw_margin() == {"FINISHED"}


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
    with pytest.raises(SettingsError, match="has changed meanwhile"):
        finish(steps)()
    assert (mask() == first).all()


def test_work_under_way_reads_the_drawing_as_it_was_before_undo(drawing):
    two_strokes(drawing)
    held, before = structures.label_volume(bpy.context.scene), mask().copy()
    bpy.ops.ed.undo()
    assert (mask() != before).any()
    assert ((held.values > 0) == before).all()
