# SPDX-License-Identifier: GPL-3.0-or-later
"""The part Maps of the page Results: add, show, change, remove; saved, undone, exported."""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
from ui.drawing import drawn

bpy = pytest.importorskip("bpy")

import ctmc_addon
from ctmc_addon.blender.maps import read_map, shown_map, shown_name, stored_maps
from ctmc_addon.blender.maps.colors import COLORS
from ctmc_addon.blender.rulers import points_of, rulers_of
from ctmc_addon.blender.surface import own_mesh
from ctmc_addon.core import SurfaceRequest, Volume, length_text, make_surfaces_steps
from ctmc_addon.core.maps import QUANTITIES, DistanceTo, MapRequest, Thickness
from ctmc_addon.core.progress import finish
from ctmc_addon.ui import jobs
from ctmc_addon.ui.operators.results import maps
from ctmc_addon.ui.panels.results.maps import label_of
from ctmc_addon.ui.panels.results.page import CTMC_PT_results
from ctmc_addon.ui.state import session
from ctmc_addon.ui.state.ct import volumes
from ctmc_addon.ui.state.results import surfaces
from ctmc_addon.ui.state.surface import structures


def active():
    return bpy.context.view_layer.objects.active


@pytest.fixture
def surface(loaded):
    """A ball of 12 mm."""
    bpy.ops.ctmc.reconstruct()
    return active()


@pytest.fixture
def thick(surface):
    assert bpy.ops.ctmc.map_add(quantity="thickness") == {"FINISHED"}
    return surface


def test_the_menu_has_every_quantity(surface):
    items = bpy.ops.ctmc.map_add.get_rna_type().properties["quantity"].enum_items
    names = [item.identifier for item in items]
    assert names == [kind.flag for kind in QUANTITIES]
    assert "ctmc.map_add Add Map" in drawn(CTMC_PT_results).buttons


def test_a_map_is_added_and_shown_with_its_numbers(thick, loaded):
    found = read_map(thick.data, "thickness_mm")
    assert found.statistics.median == pytest.approx(12.0, abs=1.2)
    assert shown_name(thick) == "thickness_mm"
    assert thick.data.color_attributes.active_color_name == COLORS
    texts = drawn(CTMC_PT_results).texts
    assert texts[texts.index("Median") + 1].endswith(" mm")
    assert "ctmc.map_show Thickness [mm]" in drawn(CTMC_PT_results).buttons
    assert (loaded.ctmc_map.low, loaded.ctmc_map.high) == pytest.approx(found.range)


def test_values_are_those_of_core_on_the_object_s_own_mesh(thick, loaded):
    from ctmc_addon.blender.surface import own_mesh, read_provenance
    from ctmc_addon.core import Budget
    from ctmc_addon.core.maps import MappedSurface

    provenance = read_provenance(thick)
    surface = MappedSurface(own_mesh(thick), provenance.settings, volumes.current_full(loaded), Budget(), None)
    expected = finish(Thickness().values_steps(surface)).values
    np.testing.assert_array_equal(read_map(thick.data, "thickness_mm").values, expected)


def test_range_ramp_and_limits_change_at_once(thick, loaded):
    settings = loaded.ctmc_map
    settings.low, settings.high, settings.ramp = 10.0, 13.0, "magma"
    assert (shown_map(thick).range, shown_map(thick).ramp) == ((10.0, 13.0), "magma")
    settings.low = 20.0  # beyond the last color, which moves too
    assert shown_map(thick).range == (20.0, 23.0)
    settings.high = 5.0
    assert shown_map(thick).range == (2.0, 5.0)
    assert shown_map(thick).statistics.share_below is None
    settings.use_lower = True
    assert settings.lower == shown_map(thick).limits[0]
    settings.lower = 100.0
    assert shown_map(thick).statistics.share_below == pytest.approx(1.0)
    settings.use_upper, settings.upper = True, 1.0
    assert shown_map(thick).limits == (1.0, 1.0), "the lower limit gives way"
    assert shown_map(thick).statistics.share_above > 0.9
    texts = drawn(CTMC_PT_results).texts
    assert "Above Limit" in texts
    settings.use_lower = settings.use_upper = False
    assert shown_map(thick).limits == (None, None)


def test_settings_of_no_map_change_nothing(surface, loaded):
    loaded.ctmc_map.low, loaded.ctmc_map.ramp, loaded.ctmc_map.use_lower = 3.0, "magma", True
    assert (loaded.ctmc_map.low, loaded.ctmc_map.ramp, loaded.ctmc_map.use_lower) == (0.0, "viridis", False)
    assert stored_maps(surface.data) == []


def test_maps_are_shown_one_at_a_time_and_removed(thick):
    own = thick.data.materials[0]
    bpy.ops.ctmc.map_add(quantity="angle")
    assert shown_name(thick) == "angle_deg"
    bpy.ops.ctmc.map_show(map_name="thickness_mm")
    assert shown_name(thick) == "thickness_mm"
    bpy.ops.ctmc.map_show()
    assert shown_name(thick) == ""
    assert thick.material_slots[0].material == own
    bpy.ops.ctmc.map_remove(map_name="thickness_mm")
    assert [each.name for each in stored_maps(thick.data)] == ["angle_deg"]
    with pytest.raises(RuntimeError, match="There is no map x; the maps are angle_deg"):
        bpy.ops.ctmc.map_show(map_name="x")
    bpy.ops.ctmc.map_remove()
    assert not bpy.ops.ctmc.map_remove.poll()
    assert not bpy.ops.ctmc.map_show.poll()


def test_a_volume_is_painted_under_a_name(surface, ball_file):
    bpy.ops.wm.save_as_mainfile(filepath=str(ball_file.with_name("a.blend")))
    options = {"quantity": "paint", "filepath": str(ball_file.with_name("dose.npy"))}
    np.save(ball_file.with_name("dose.npy"), np.full((12, 24, 24), 7, np.int16))
    assert bpy.ops.ctmc.map_add(map_name="dose", paint_depth=1.0, paint_how="max", **options) == {"FINISHED"}
    assert read_map(surface.data, "dose").statistics.maximum == 7.0
    bpy.ops.ctmc.map_add(**options)
    assert [each.name for each in stored_maps(surface.data)] == ["dose"], "the file's name"
    with pytest.raises(RuntimeError, match="No file was chosen; choose the volume to paint"):
        bpy.ops.ctmc.map_add(quantity="paint")


@pytest.fixture
def two_labels(scene, tmp_path):
    """Two cubes of 6 mm with 4 mm between them; the first is active."""
    values = np.zeros((16, 16, 32), np.uint8)
    values[5:11, 5:11, 5:11], values[5:11, 5:11, 15:21] = 1, 2
    np.save(tmp_path / "labels.npy", values)
    bpy.ops.ctmc.load(filepath=str(tmp_path / "labels.npy"), spacing=(1, 1, 1))
    scene.ctmc.labels[1].name = "portal vein"
    scene.ctmc.use_label, scene.ctmc.label = True, 1
    bpy.ops.ctmc.reconstruct()
    return active()


def test_the_distance_to_a_structure_of_the_list_has_its_name(two_labels):
    assert bpy.ops.ctmc.map_add(quantity="distance-to", structure="portal vein") == {"FINISHED"}
    found = read_map(two_labels.data, "distance_portal_vein_mm")
    assert found.statistics.minimum == pytest.approx(4.0, abs=1.0)
    assert found.nearest is not None
    assert label_of(replace(found, name="distance_vertebrae_L3_mm")) == "Distance vertebrae L3 [mm]"
    assert bpy.ops.ctmc.map_add(quantity="distance-to", structure="1") == {"FINISHED"}
    assert read_map(two_labels.data, "distance_1_mm").statistics.share_without == 1.0
    with pytest.raises(RuntimeError, match="No structure and no file was chosen"):
        bpy.ops.ctmc.map_add(quantity="distance-to", structure="FILE")


def test_the_nearest_points_become_a_ruler_where_the_surface_lies(two_labels, scene):
    bpy.ops.ctmc.map_add(quantity="thickness")
    with pytest.raises(RuntimeError, match="has no nearest points"):
        bpy.ops.ctmc.map_nearest()
    assert not any("ctmc.map_nearest" in button for button in drawn(CTMC_PT_results).buttons)
    bpy.ops.ctmc.map_add(quantity="distance-to", structure="portal vein")
    found = read_map(two_labels.data, "distance_portal_vein_mm")
    two_labels.location.x += 1.0
    bpy.context.view_layer.update()
    shown = drawn(CTMC_PT_results)
    assert any("ctmc.map_nearest" in button for button in shown.buttons)
    assert shown.texts[shown.texts.index("Nearest") + 1] == length_text(found.nearest_distance)
    assert bpy.ops.ctmc.map_nearest() == {"FINISHED"}
    [ruler] = rulers_of(scene)
    assert ruler["ctmc_ruler"]["value"] == pytest.approx(found.nearest_distance)
    expected = np.array(found.nearest) * 0.01 + (1.0, 0.0, 0.0)
    assert np.array(points_of(ruler)) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("in_memory", [True, False])
def test_the_distance_to_a_label_with_a_shared_wall_is_that_of_the_command_line(scene, tmp_path, in_memory):
    values = np.zeros((16, 16, 32), np.uint8)
    values[5:11, 5:11, 5:11], values[5:11, 5:11, 11:17], values[5:11, 5:11, 17:23] = 1, 2, 3
    np.save(tmp_path / "labels.npy", values)
    bpy.ops.ctmc.load(filepath=str(tmp_path / "labels.npy"), spacing=(1, 1, 1))
    scene.ctmc.use_label = True
    for item in scene.ctmc.labels:
        item.chosen = True
    bpy.ops.ctmc.reconstruct()
    requests = [SurfaceRequest(settings) for settings in scene.ctmc.all_settings()]
    assert len(requests) == 3
    volume = volumes.require_loaded(scene).full
    first = finish(make_surfaces_steps(volume, requests, maps=MapRequest((DistanceTo(2),))))[0].result
    obj = next(obj for obj in scene.objects if surfaces.is_surface(obj) and surfaces.require_settings(obj).label == 1)
    bpy.context.view_layer.objects.active = obj
    if not in_memory:
        session.of(scene).full.clear()
    assert bpy.ops.ctmc.map_add(quantity="distance-to", structure="2") == {"FINISHED"}
    found = read_map(obj.data, "distance_2_mm").values
    assert np.array_equal(own_mesh(obj).faces, first.mesh.faces)
    assert np.abs(found - first.maps[0].values).max() < 1e-5
    assert np.count_nonzero(np.abs(found) < 1e-5) > 20  # The wall is shared.


def test_the_distance_to_a_label_that_has_changed_is_to_its_present_shape(scene, tmp_path):
    def labels(start):
        values = np.zeros((16, 16, 40), np.uint8)
        values[5:11, 5:11, 3:9], values[5:11, 5:11, start : start + 6] = 1, 2
        return Volume(values, volumes.require_loaded(scene).full.affine, kind="label")

    np.save(tmp_path / "ct.npy", np.broadcast_to(np.arange(40, dtype=np.int16), (16, 16, 40)))
    bpy.ops.ctmc.load(filepath=str(tmp_path / "ct.npy"), spacing=(1, 1, 1))
    structures.add_labels(scene, labels(15), "labels")
    scene.ctmc.use_label = True
    for item in scene.ctmc.labels:
        item.chosen = True
    bpy.ops.ctmc.reconstruct()
    structures.put(scene, "labels", labels(28))
    obj = next(obj for obj in scene.objects if surfaces.is_surface(obj) and surfaces.require_settings(obj).label == 1)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.ctmc.map_add(quantity="distance-to", structure="2")
    nearest = np.nanmin(read_map(obj.data, "distance_2_mm").values)
    assert 18 < nearest < 19.5  # From sample 8 to sample 28, each less up to half a step; the old label is at 15.


def test_the_distance_to_a_file(two_labels, tmp_path):
    bpy.ops.ctmc.export(filepath=str(tmp_path / "other.stl"))
    path = str(tmp_path / "other.stl")
    assert bpy.ops.ctmc.map_add(quantity="distance-to", structure="FILE", filepath=path) == {"FINISHED"}
    values = read_map(two_labels.data, "distance_other_mm").values
    assert np.abs(values).max() < 1e-4


def test_the_deviation_is_that_to_the_full_surface_in_memory(loaded, monkeypatch):
    loaded.ctmc.reduction = 0.8
    bpy.ops.ctmc.reconstruct()

    def never(*_a, **_k):
        raise AssertionError("it is in memory")

    monkeypatch.setattr(maps, "one_of_labels_steps", never)
    assert bpy.ops.ctmc.map_add(quantity="deviation") == {"FINISHED"}
    assert read_map(active().data, "deviation_mm").statistics.maximum > 0


def test_a_closed_job_leaves_no_map(surface, loaded):
    steps = maps.added_steps(surface, loaded, Thickness, "", {})
    next(steps)
    steps.close()
    assert stored_maps(surface.data) == []
    assert jobs.running() is None


def test_a_surface_that_changed_meanwhile_gets_no_map(surface, loaded):
    conclude = finish(maps.added_steps(surface, loaded, Thickness, "", {}))
    surface.shape_key_clear()
    surface.data.vertices.add(1)
    with pytest.raises(ctmc_addon.core.CtmcError, match="add the map again"):
        conclude()
    assert session.object_of(surface.session_uid) == surface


def test_undo_takes_a_map_back(thick):
    name = thick.name
    bpy.ops.ed.undo_push(message="map")
    bpy.ops.ctmc.map_show()
    bpy.ops.ed.undo_push(message="hidden")
    assert shown_name(bpy.data.objects[name]) == ""
    bpy.ops.ed.undo()
    assert shown_name(bpy.data.objects[name]) == "thickness_mm"


def test_maps_are_written_by_export(thick, tmp_path):
    bpy.ops.ctmc.export(filepath=str(tmp_path / "a.ply"))
    head = (tmp_path / "a.ply").read_bytes().partition(b"end_header")[0]
    assert b"property float thickness_mm" in head
    bpy.ops.ctmc.export(filepath=str(tmp_path / "a.glb"))
    data = (tmp_path / "a.glb").read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    attributes = json.loads(data[20 : 20 + length])["meshes"][0]["primitives"][0]["attributes"]
    assert {"COLOR_0", "_THICKNESS_MM"} <= attributes.keys()


def test_modifiers_interpolate_the_values_of_exports(thick, tmp_path):
    thick.modifiers.new("Decimate", "DECIMATE").ratio = 0.5
    bpy.ops.ctmc.export(filepath=str(tmp_path / "a.ply"))
    assert b"property float thickness_mm" in (tmp_path / "a.ply").read_bytes()


def test_an_updated_surface_has_no_old_map(thick, loaded):
    loaded.ctmc.threshold = 110.0
    bpy.ops.ctmc.reconstruct()
    assert active() == thick
    assert (stored_maps(thick.data), shown_name(thick)) == ([], "")


def test_a_figure_of_the_panel_shows_the_map_of_the_surface(thick, loaded, tmp_path):
    image = pytest.importorskip("PIL.Image")
    from ctmc_addon.blender.figure.spec import FigureStyle
    from ctmc_addon.ui.operators.render.figure import in_map_colors

    loaded.ctmc_map.low, loaded.ctmc_map.high, loaded.ctmc_map.ramp = 0.0, 1.0, "magma"
    loaded.ctmc_figure.figure_dpi = 60
    colors = in_map_colors(FigureStyle(), bpy.context).colors
    assert (colors.name, colors.range, colors.ramp) == ("thickness_mm", (0.0, 1.0), "magma")
    bpy.ops.ctmc.figure(filepath=str(tmp_path / "a.png"))
    with image.open(tmp_path / "a.png") as file:
        picture = np.asarray(file.convert("RGB"), np.float64) / 255
    middle = picture[len(picture) // 3, picture.shape[1] // 2]
    assert np.abs(middle - np.array([0xFC, 0xFD, 0xBF]) / 255).max() < 0.1
