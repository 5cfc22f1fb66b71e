# SPDX-License-Identifier: GPL-3.0-or-later
"""The rows of the CTs of a file: choose one, free its memory, remove it, with its objects if asked."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest
from shapes import distance_mm

bpy = pytest.importorskip("bpy")

from ui.drawing import Layout, meshes_in

from ctmc_addon.blender.rulers import PROPERTY as RULER
from ctmc_addon.blender.scene.ct_box import box_of, fingerprint_of_box, link_beside_ct, paths_of_boxes
from ctmc_addon.ui.panels.ct.scans import draw_cts
from ctmc_addon.ui.state import session
from ctmc_addon.ui.state.ct import scans, volumes
from ctmc_addon.ui.state.surface import structures
from ctmc_addon.ui.viewport.surface import live


@pytest.fixture
def two(loaded, tmp_path):
    """Load two balls; the second is the panel's. Each has a surface and a folder of its own."""
    bpy.ops.ctmc.reconstruct()
    folder = tmp_path / "other"
    folder.mkdir()
    np.save(folder / "small.npy", (130 - 10 * distance_mm((12, 24, 24), spacing=(1, 1, 2))).astype(np.int16))
    bpy.ops.ctmc.load(filepath=str(folder / "small.npy"), spacing=(1, 1, 2))
    loaded.ctmc.threshold = 90.0
    bpy.ops.ctmc.reconstruct(new=True)
    bpy.context.view_layer.update()
    bpy.ops.ed.undo_push(message="Two")
    return loaded


def fingerprint_of(scene, name):
    return next(ct.volume_fingerprint for ct in scans.listed(scene) if scans.name_of(scene, ct) == name)


def rows(scene):
    """The buttons of the rows, in their order."""
    layout = Layout()
    draw_cts(layout, bpy.context)
    return layout.buttons


def names(scene):
    return [scans.name_of(scene, ct) for ct in scans.listed(scene)]


def is_gone(reference):
    gc.collect()
    return reference() is None


def settle():
    """Drive the preview's timer until it rests."""
    while live.tick() is not None:
        pass


def test_each_ct_has_a_row_in_an_order_that_stays(two):
    buttons = ["ctmc.choose_ct ball", "ctmc.free_ct 1 MiB", "ctmc.remove_ct"]
    buttons += ["ctmc.choose_ct small", "ctmc.free_ct 1 MiB", "ctmc.remove_ct"]
    assert rows(two) == buttons
    bpy.ops.ctmc.choose_ct(fingerprint=fingerprint_of(two, "ball"))
    assert (volumes.current(two).name, two.ctmc.threshold) == ("ball", 100.0)
    assert rows(two) == buttons


@pytest.mark.parametrize("name", ["ball", "small"])
@pytest.mark.parametrize("operator", ["free_ct", "remove_ct"])
def test_nothing_holds_the_samples_of_a_ct_that_was_freed_or_removed(two, name, operator, monkeypatch):
    monkeypatch.setattr(live, "IDLE", 0.0)
    fingerprint = fingerprint_of(two, name)
    bpy.ops.ctmc.choose_ct(fingerprint=fingerprint)
    settle()
    assert live.live.fields.volume is volumes.current(two)
    volume = weakref.ref(volumes.current(two))
    values = weakref.ref(volumes.current(two).values)
    assert any(key[0] == fingerprint for key in session.of(two).full) == (name == "small")  # the last run's
    getattr(bpy.ops.ctmc, operator)(fingerprint=fingerprint)
    assert is_gone(volume)
    assert is_gone(values)
    assert not any(key[0] == fingerprint for key in session.of(two).full)
    assert len(meshes_in(two)) == 2


def test_a_freed_ct_keeps_its_row_its_surfaces_and_its_settings_and_loads_again(two):
    bpy.ops.ctmc.free_ct()
    assert rows(two)[3:] == ["ctmc.choose_ct small", "ctmc.remove_ct"]
    assert volumes.missing(two)
    assert box_of(two, two.ctmc.volume_fingerprint) is not None
    bpy.ops.ctmc.load(again=True)
    assert (volumes.current(two).name, two.ctmc.threshold) == ("small", 90.0)
    assert names(two) == ["ball", "small"]


def test_labels_are_freed_with_their_ct(loaded, tmp_path):
    inside = (distance_mm((12, 24, 24), spacing=(1, 1, 2)) < 5).astype(np.uint8)
    np.save(tmp_path / "mask.npy", inside)
    bpy.ops.ctmc.load_labels(filepath=str(tmp_path / "mask.npy"))
    labels = weakref.ref(structures.label_volume(loaded))
    assert labels() is not None
    bpy.ops.ctmc.free_ct()
    assert is_gone(labels)
    bpy.ops.ctmc.load(again=True)
    assert len(structures.label_volume(loaded).label_names) == 1


def test_labels_stay_when_their_ct_is_read_again_and_go_with_a_file_that_does_not_use_them(loaded, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "without.blend"))
    np.save(tmp_path / "mask.npy", (distance_mm((12, 24, 24), spacing=(1, 1, 2)) < 5).astype(np.uint8))
    bpy.ops.ctmc.load_labels(filepath=str(tmp_path / "mask.npy"))
    before = structures.label_volume(loaded)
    bpy.ops.ctmc.load(again=True)
    assert structures.label_volume(loaded) is before
    labels = weakref.ref(before)
    del before
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "without.blend"))
    assert volumes.current(bpy.context.scene) is not None
    assert volumes.require_loaded(bpy.context.scene).labels == {}
    assert is_gone(labels)


def test_the_next_ct_is_the_panels_after_one_is_removed_and_an_empty_panel_after_the_last(two):
    bpy.ops.ctmc.remove_ct()
    assert (names(two), volumes.current(two).name, two.ctmc.threshold) == (["ball"], "ball", 100.0)
    assert [obj.name for obj in two.objects if obj.type == "EMPTY"] == ["ball"]
    bpy.ops.ctmc.remove_ct()
    assert (names(two), two.ctmc.volume_path, two.ctmc.use_threshold, len(two.ctmc_scans)) == ([], "", False, 0)
    assert [obj.type for obj in two.objects] == ["MESH", "MESH"]
    assert not volumes._loaded
    with pytest.raises(RuntimeError, match="This CT is not in the scene"):
        bpy.ops.ctmc.remove_ct()


def test_its_objects_go_with_a_ct_if_asked_and_only_its_own(two):
    bpy.ops.ctmc.add_slice()
    meshes = len(bpy.data.meshes)
    own = fingerprint_of(two, "small")
    bpy.ops.ctmc.remove_ct(fingerprint=own, with_objects=True)
    assert sorted((obj.name, obj.type) for obj in two.objects) == [("Surface 100", "MESH"), ("ball", "EMPTY")]
    assert len(bpy.data.meshes) < meshes
    assert not any(mesh.users == 0 for mesh in bpy.data.meshes)
    assert "other" not in bpy.data.collections


def test_undo_brings_a_removed_ct_back_to_be_loaded_again(two):
    bpy.ops.ctmc.remove_ct(with_objects=True)
    bpy.ops.ed.undo_push(message="Removed")
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert names(scene) == ["ball", "small"]
    assert volumes.missing(scene)
    assert len(meshes_in(scene)) == 2
    bpy.ops.ctmc.load(again=True)
    assert volumes.current(scene).name == "small"


def test_deleting_the_box_removes_the_ct_and_undo_brings_it_back_with_its_values(two):
    box = box_of(two, two.ctmc.volume_fingerprint)
    with bpy.context.temp_override(selected_objects=[box], active_object=box, object=box):
        bpy.ops.object.select_all(action="DESELECT")
        box.select_set(True)
        bpy.ops.object.delete()
    bpy.context.view_layer.update()
    assert (names(two), volumes.current(two).name) == (["ball"], "ball")
    assert len(meshes_in(two)) == 2
    bpy.ops.ed.undo_push(message="Deleted")
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    bpy.context.view_layer.update()
    assert (names(scene), volumes.current(scene).name) == (["ball", "small"], "small")


def test_two_readings_of_a_file_share_a_box_and_stay(loaded, ball_file):
    bpy.context.view_layer.update()
    first = loaded.ctmc.volume_fingerprint
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(2, 2, 2))
    bpy.context.view_layer.update()
    assert first in [scan.volume_fingerprint for scan in loaded.ctmc_scans]
    assert len(scans.listed(loaded)) == 2


@pytest.mark.parametrize("removed", [0, 1])
@pytest.mark.parametrize("with_objects", [False, True])
def test_another_reading_of_a_file_keeps_its_row_its_box_and_its_rulers(loaded, ball_file, removed, with_objects):
    first = loaded.ctmc.volume_fingerprint
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(2, 2, 2))
    readings = [first, loaded.ctmc.volume_fingerprint]
    ruler = bpy.data.objects.new("Mine", None)
    ruler[RULER] = {"kind": "distance", "value": 1.0}
    link_beside_ct(loaded, ruler, loaded.ctmc.volume_fingerprint)
    bpy.context.view_layer.update()
    bpy.ops.ctmc.remove_ct(fingerprint=readings[removed], with_objects=with_objects)
    bpy.context.view_layer.update()
    kept = readings[1 - removed]
    assert [ct.volume_fingerprint for ct in scans.listed(loaded)] == [kept]
    assert fingerprint_of_box(box_of(loaded, kept)) == kept
    assert "Mine" in loaded.objects
    bpy.ops.ctmc.remove_ct(with_objects=True)
    assert len(loaded.objects) == 0


@pytest.mark.parametrize("with_objects", [False, True])
def test_a_ct_that_is_removed_stays_in_a_linked_copy_of_the_scene(two, with_objects):
    bpy.ops.scene.new(type="LINK_COPY")
    copy = bpy.context.scene
    assert copy != two
    objects, cts = sorted(two.objects.keys()), names(two)
    bpy.ops.ctmc.remove_ct(with_objects=with_objects)
    bpy.context.view_layer.update()
    assert names(copy) == ["ball"]
    assert (sorted(two.objects.keys()), names(two)) == (objects, cts)
    assert volumes.current(two).name == "small"
    bpy.data.scenes.remove(copy)


def test_objects_are_looked_through_only_after_their_number_or_the_cts_have_changed(two, monkeypatch):
    calls = []
    monkeypatch.setattr(scans, "paths_of_boxes", lambda scene: calls.append(scene) or paths_of_boxes(scene))
    scans.drop_deleted(two)
    calls.clear()
    for _ in range(3):
        scans.drop_deleted(two)
    assert calls == []
    two.collection.objects.link(bpy.data.objects.new("Mine", None))
    scans.drop_deleted(two)
    assert calls == [two]
    scans.remove(two, fingerprint_of(two, "ball"))
    calls.clear()
    scans.drop_deleted(two)
    assert calls == [two]
