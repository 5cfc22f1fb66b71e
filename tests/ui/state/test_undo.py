# SPDX-License-Identifier: GPL-3.0-or-later
"""Undo, redo, Save As and reopening: the panel never shows what the file does not hold."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ui.drawing import drawn

from ctmc_addon.ui.panels import main as panels
from ctmc_addon.ui.panels.results import page as results
from ctmc_addon.ui.state import session
from ctmc_addon.ui.state.ct import stored_paths, volumes
from ctmc_addon.ui.viewport.surface import live, preview


@pytest.fixture
def loaded(loaded):
    """The ball, loaded, threshold 100, and an undo step."""
    bpy.ops.ed.undo_push(message="Loaded")
    return loaded


def active():
    return bpy.context.view_layer.objects.active


def triangles():
    """The line of Results that counts triangles."""
    texts = drawn(results.CTMC_PT_results).texts
    return texts[texts.index("Triangles") + 1]


def rest():
    """Drive the timer until everything has followed."""
    for _ in range(10_000):
        if live.tick() is None:
            return
    raise AssertionError("the timer never ends")


def test_undo_while_counting_ends_calmly_and_counts_again(loaded, monkeypatch):
    monkeypatch.setattr(live, "IDLE", 0.0)
    monkeypatch.setattr(live, "TICK", -1.0)
    loaded.ctmc.preview = False
    loaded.ctmc.threshold = 110.0
    bpy.ops.ed.undo_push(message="Threshold")
    live.tick()
    live.tick()
    assert live.live.work
    bpy.ops.ed.undo()
    rest()
    scene = bpy.context.scene
    assert scene.ctmc.threshold == 100.0
    assert session.of(scene).cost is not None
    assert "..." not in drawn(*panels.STEPS).texts


def test_undo_of_labels_brings_the_preview_back(loaded, monkeypatch):
    monkeypatch.setattr(live, "IDLE", 0.0)
    loaded.ctmc.use_threshold, loaded.ctmc.use_label, loaded.ctmc.label = False, True, 100
    rest()
    assert preview.state.shown is not None
    bpy.ops.ed.undo_push(message="Label")
    bpy.ops.ctmc.reconstruct()
    bpy.ops.ed.undo_push(message="Reconstructed")
    rest()
    assert preview.state.shown is None
    bpy.context.object.hide_set(True)
    bpy.ops.ed.undo_push(message="Hidden")
    bpy.ops.ed.undo()
    rest()
    assert preview.state.shown is None, "its surface is there"
    bpy.ops.ed.undo()
    rest()
    assert not [obj for obj in bpy.context.scene.objects if obj.type == "MESH"]
    assert preview.state.shown is not None


def test_results_are_those_of_the_mesh_that_stands_there_after_undo(loaded):
    bpy.ops.ctmc.reconstruct()
    bpy.ops.ed.undo_push(message="Reconstructed")
    before = triangles()
    loaded.ctmc.reduction = 0.8
    bpy.ops.ctmc.simplify()
    bpy.ops.ed.undo_push(message="Simplified")
    assert triangles() != before
    bpy.ops.ed.undo()
    assert triangles() == before


def test_results_survive_reopening_the_file(loaded, tmp_path):
    loaded.ctmc.reduction = 0.8
    bpy.ops.ctmc.reconstruct()
    before = drawn(results.CTMC_PT_results).texts
    assert "To Full Surface" in before
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "day.blend"))
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "day.blend"))
    assert drawn(results.CTMC_PT_results).texts == before


def test_costs_are_counted_after_reopening_a_file_whose_ct_is_in_memory(loaded, tmp_path, monkeypatch):
    monkeypatch.setattr(live, "IDLE", 0.0)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "day.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "day.blend"))
    rest()
    assert session.of(bpy.context.scene).cost.faces > 0
    assert "..." not in drawn(*panels.STEPS).texts


def test_measures_of_another_mesh_are_not_shown(loaded):
    bpy.ops.ctmc.reconstruct()
    assert "Area" in drawn(results.CTMC_PT_results).texts
    active().data = bpy.data.meshes.new("empty")
    assert "Surface: not measured" in drawn(results.CTMC_PT_results).texts


def test_simplify_after_undo_starts_from_the_surface_that_stands_there(loaded):
    bpy.ops.ctmc.reconstruct()
    full = len(active().data.polygons)
    bpy.ops.ed.undo_push(message="Reconstructed")
    loaded.ctmc.threshold = 130.0
    bpy.ops.ctmc.reconstruct()
    bpy.ops.ed.undo_push(message="Smaller")
    assert len(active().data.polygons) < 0.5 * full
    bpy.ops.ed.undo()
    bpy.context.scene.ctmc.reduction = 0.5
    bpy.ops.ctmc.simplify()
    assert abs(len(active().data.polygons) - full / 2) <= 1


def test_undo_of_a_second_load_finds_the_first_ct(loaded, tmp_path):
    first = volumes.current(loaded)
    np.save(tmp_path / "other.npy", np.zeros((4, 4, 4), np.uint8))
    bpy.ops.ctmc.load(filepath=str(tmp_path / "other.npy"))
    bpy.ops.ed.undo_push(message="Other")
    bpy.ops.ed.undo()
    assert volumes.current(bpy.context.scene) is first


def test_volumes_that_only_undo_needs_are_let_go_where_memory_is_short(loaded, tmp_path, monkeypatch):
    monkeypatch.setattr(volumes, "available_bytes", lambda: 100)
    np.save(tmp_path / "other.npy", np.zeros((4, 4, 4), np.uint8))
    bpy.ops.ctmc.load(filepath=str(tmp_path / "other.npy"))
    assert len(volumes._loaded) == 1


@pytest.mark.parametrize("copy", [False, True])
def test_save_as_to_another_folder_keeps_the_way_to_the_ct(loaded, ball_file, tmp_path, copy):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "day.blend"))
    bpy.ops.ctmc.load(again=True)
    assert loaded.ctmc.volume_path == "//ball.npy"
    (tmp_path / "below" / "deeper").mkdir(parents=True)
    target = tmp_path / "below" / "deeper" / "day.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(target), copy=copy)
    assert Path(bpy.path.abspath(loaded.ctmc.volume_path)).resolve() == ball_file
    bpy.ops.wm.open_mainfile(filepath=str(target))
    assert stored_paths.exists(bpy.context.scene.ctmc.volume_path)


@pytest.mark.parametrize("copy", [False, True])
def test_the_first_save_leaves_no_absolute_path_of_the_ct_in_the_file(loaded, ball_file, tmp_path, copy):
    assert Path(loaded.ctmc.volume_path) == ball_file
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "day.blend"), copy=copy, compress=False)
    saved = (tmp_path / "day.blend").read_bytes()
    assert str(ball_file).encode() not in saved
    assert saved.count(bytes(tmp_path)) == saved.count(bytes(tmp_path / "day.blend"))  # Blender's own
    assert loaded.ctmc.volume_path == (str(ball_file) if copy else "//ball.npy")


def test_a_ct_that_is_loaded_again_after_a_save_elsewhere_has_the_same_box_and_folder(loaded, tmp_path):
    (tmp_path / "below").mkdir()
    for folder in (tmp_path, tmp_path / "below"):
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / "day.blend"))
        loaded.ctmc.flip = "x"  # another reading of the same file
        bpy.ops.ctmc.load(again=True)
        assert len([obj for obj in bpy.data.objects if obj.type == "EMPTY"]) == 1
        assert len(loaded.collection.children) == 1


@pytest.mark.parametrize("path", ["C:\\ct\\ball.npy", "C:/ct/ball.npy"])
def test_a_path_of_another_system_is_saved_as_it_is(loaded, tmp_path, path):
    loaded.ctmc.volume_path = path
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "day.blend"))
    assert loaded.ctmc.volume_path == path


@pytest.mark.parametrize("memory", [3, "mine", {"report": "{}"}, {"settings": "[", "report": "none"}])
def test_another_add_ons_property_of_our_name_breaks_no_panel(scene, memory):
    mesh = bpy.data.meshes.new("mine")
    obj = bpy.data.objects.new("mine", mesh)
    scene.collection.objects.link(obj)
    obj["ctmc"] = memory
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    for panel in panels.STEPS:
        drawn(panel)
    others = ("map_add", "map_show", "map_remove", "make_final", "adopt_settings", "export")
    for operator in ("reconstruct", "simplify", "measure", *others):
        getattr(bpy.ops.ctmc, operator).poll()
    assert not bpy.ops.ctmc.measure.poll()
    scene.ctmc.alpha = 0.5  # the slider moves the selected surfaces


@pytest.mark.parametrize(
    "bad",
    [
        {"measures": {"faces": "x"}},
        {"measures": {"area": "x"}},
        {"measures": {"volume": float("nan")}},
        {"measures": {"closed": 1}},
        {"measures": {"no such measure": 1}},
        {"distance": {"to_full": {"mean": "x", "percentile_95": 1.0, "largest": 1.0}}},
        {"distance": 3},
    ],
)
def test_a_measurement_that_cannot_be_breaks_no_panel(loaded, bad):
    from ctmc_addon.ui.state.results import measurements

    bpy.ops.ctmc.reconstruct()
    obj = active()
    stored = json.loads(obj[measurements.PROPERTY])
    bad = {"measures": stored["measures"] | bad["measures"]} if "measures" in bad else bad
    for text in (json.dumps(stored | bad), "[" * 100_000, "3"):
        obj[measurements.PROPERTY] = text
        assert measurements.of(obj) is None
        assert "Surface: not measured" in drawn(results.CTMC_PT_results).texts
