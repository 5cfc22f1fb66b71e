# SPDX-License-Identifier: GPL-3.0-or-later
"""No panel, poll or handler fails in a mode in which a mesh has no attributes; operators ask to leave it."""

from __future__ import annotations

import pytest

bpy = pytest.importorskip("bpy")

from ui.drawing import drawn

from ctmc_addon.blender.shape_change import shape_change
from ctmc_addon.ui.panels.draw import CTMC_PT_draw
from ctmc_addon.ui.panels.results.page import CTMC_PT_results
from ctmc_addon.ui.state.results import measurements
from ctmc_addon.ui.viewport.ct import slice_objects
from ctmc_addon.ui.viewport.surface import live

MODES = ("EDIT", "SCULPT", "VERTEX_PAINT", "WEIGHT_PAINT", "TEXTURE_PAINT")


def active():
    return bpy.context.view_layer.objects.active


@pytest.fixture
def surface(loaded):
    loaded.ctmc.reduction = 0.5
    bpy.ops.ctmc.reconstruct()
    bpy.ops.ctmc.map_add(quantity="deviation")
    yield active()
    if active() is not None and active().mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


def panels():
    kinds = [getattr(bpy.types, name) for name in dir(bpy.types) if name.startswith("CTMC_PT_")]
    return [kind for kind in kinds if "draw" in vars(kind)]


@pytest.mark.parametrize("mode", MODES)
def test_panels_polls_and_handlers_work_in_every_mode(surface, loaded, mode, tmp_path):
    assert bpy.ops.object.mode_set(mode=mode) == {"FINISHED"}
    assert surface.mode == mode
    assert len(panels()) == 6
    for panel in panels():
        if not hasattr(panel, "poll") or panel.poll(bpy.context):
            drawn(panel)
    for name in dir(bpy.ops.ctmc):
        getattr(bpy.ops.ctmc, name).poll()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    for kind in ("depsgraph_update_post", "undo_pre", "undo_post", "redo_post"):
        for handler in getattr(bpy.app.handlers, kind):
            if handler.__module__.startswith("ctmc_addon."):
                handler(loaded, depsgraph)
    loaded.ctmc.alpha = 0.5
    live.alpha.settle(loaded)
    assert shape_change(surface).factors == pytest.approx((1.0, 1.0, 1.0), rel=1e-3)
    slice_objects.show(loaded)
    assert bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "mode.blend")) == {"FINISHED"}
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "mode.blend"))
    drawn(CTMC_PT_results)


def test_a_copy_that_shares_a_mesh_in_edit_mode_breaks_nothing(surface):
    other = surface.copy()
    bpy.context.collection.objects.link(other)
    bpy.ops.object.mode_set(mode="EDIT")
    assert other.mode == "OBJECT"
    assert measurements.of(other) is None
    assert shape_change(other).factors == pytest.approx((1.0, 1.0, 1.0), rel=1e-3)


@pytest.mark.parametrize(
    ("mode", "text"), [("EDIT", "Leave Edit Mode first"), ("SCULPT", "Switch to Object Mode first")]
)
def test_the_page_draw_says_why_its_buttons_are_gray(surface, mode, text):
    hint = "draw with the brush"  # The end of the usual one.
    assert hint in drawn(CTMC_PT_draw).texts
    bpy.ops.object.mode_set(mode=mode)
    texts = drawn(CTMC_PT_draw).texts
    assert text in texts
    assert hint not in texts
    with pytest.raises(RuntimeError, match=text):
        bpy.ops.ctmc.draw_add()


def test_results_ask_to_leave_edit_mode_and_return_afterwards(surface):
    before = drawn(CTMC_PT_results).texts
    bpy.ops.object.mode_set(mode="EDIT")
    texts = drawn(CTMC_PT_results).texts
    assert measurements.of(surface) is None
    assert "Leave Edit Mode first" in texts
    bpy.ops.object.mode_set(mode="OBJECT")
    assert drawn(CTMC_PT_results).texts == before


REFUSED = (
    *("measure", "remove_small", "keep_largest", "simplify", "make_final", "table", "export"),
    *("map_add", "map_show", "map_remove", "choose_alpha", "pick_component", "figure_deviation"),
)


@pytest.mark.parametrize("name", REFUSED)
def test_operators_on_a_surface_ask_to_leave_edit_mode(surface, tmp_path, name):
    bpy.ops.object.mode_set(mode="EDIT")
    operator = getattr(bpy.ops.ctmc, name)
    options = {"filepath": str(tmp_path / "a.stl")} if name in ("export", "figure_deviation") else {}
    with pytest.raises(RuntimeError, match=r"Edit Mode; leave it first|Leave Edit Mode first"):
        operator(**options)
    assert not list(tmp_path.glob("a.*"))


@pytest.mark.parametrize("mode", ["EDIT", "SCULPT"])
def test_the_rotation_test_asks_for_object_mode(surface, mode):
    bpy.ops.object.mode_set(mode=mode)
    with pytest.raises(RuntimeError, match="Switch to Object Mode first"):
        bpy.ops.ctmc.rotation_test()
