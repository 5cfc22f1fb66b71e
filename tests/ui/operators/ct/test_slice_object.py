# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators `ctmc.add_slice` and `ctmc.cut_at_slice` as the sidebar presses them."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.slices.material import WINDOW, picture_of
from ctmc_addon.core.volume import slice_at, slice_corners, transform_points, value_at
from ctmc_addon.ui.state.ct import volumes
from ctmc_addon.ui.viewport import overlays


@pytest.fixture
def surface(scene, ball_file):
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1.0, 1.0, 2.0))
    scene.ctmc.use_threshold, scene.ctmc.threshold = True, 100
    bpy.ops.ctmc.reconstruct()
    return bpy.context.object


def test_three_slices_cross_at_the_cursor(scene, surface):
    scene.cursor.location = surface.location
    assert bpy.ops.ctmc.add_slice(three=True) == {"FINISHED"}
    added = bpy.context.selected_objects
    assert len(added) == 3
    for obj, axis in zip(sorted(added, key=lambda obj: obj.name), (2, 1, 0), strict=True):  # axial, coronal, sagittal
        assert obj.location[axis] == pytest.approx(scene.cursor.location[axis], abs=0.011)  # half a slice
        assert obj.name.split(" ")[1] == ("sagittal", "coronal", "axial")[axis]


@pytest.mark.parametrize("cursor", [(50.0, 0.0, 0.0), (0.0, 0.0, 0.0)])
def test_with_the_cursor_outside_the_ct_or_never_placed_the_three_chosen_slices_are_added(scene, surface, cursor):
    assert value_at(volumes.current(scene), (0.0, 0.0, 0.0)) is not None
    scene.cursor.location = cursor
    scene.ctmc_view.positions = (0.25, 0.5, 0.75)
    bpy.ops.ctmc.add_slice(three=True)
    volume = volumes.current(scene)
    for obj in bpy.context.selected_objects:
        scene.ctmc_view.plane = plane = obj["ctmc_slice_plane"]
        corners = slice_corners(volume, slice_at(volume, plane, scene.ctmc_view.position))
        assert np.array(obj.location) / 0.01 == pytest.approx(corners.mean(axis=0), abs=1e-3)


def test_selected_surfaces_are_cut_at_the_slice_that_is_shown_and_at_the_active_one(scene, surface):
    assert bpy.ops.ctmc.cut_at_slice() == {"FINISHED"}
    (cut,) = surface.modifiers
    plane = cut.node_group["CTMC Cut"]
    assert bpy.context.object == surface
    half = len(surface.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.polygons)
    assert 0.3 < half / len(surface.data.polygons) < 0.8
    plane.hide_set(False)
    plane.select_set(True)
    bpy.context.view_layer.objects.active = plane
    slices = len(scene.objects)
    assert bpy.ops.ctmc.cut_at_slice() == {"FINISHED"}
    assert len(scene.objects) == slices
    assert [modifier.node_group for modifier in surface.modifiers] == [cut.node_group] * 2


def test_without_a_selected_surface_nothing_is_cut(scene, surface):
    surface.select_set(False)
    assert not bpy.ops.ctmc.cut_at_slice.poll()


def test_in_edit_mode_no_slice_is_added_and_nothing_is_cut(scene, surface):
    bpy.ops.object.mode_set(mode="EDIT")
    assert not bpy.ops.ctmc.add_slice.poll()
    assert not bpy.ops.ctmc.cut_at_slice.poll()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert bpy.ops.ctmc.cut_at_slice.poll()


def pixels_of(obj):
    picture = picture_of(obj.data.materials[0])
    columns, rows = picture.size
    return np.array(picture.pixels[:]).reshape(rows, columns, -1)[..., 0]


def test_slices_meet_at_a_picked_point_and_show_the_ct_there(scene, surface):
    bpy.ops.ctmc.add_slice(three=True)
    added = {obj["ctmc_slice_plane"]: obj for obj in bpy.context.selected_objects}
    volume = volumes.current(scene)
    index = (15, 9, 4)
    point = transform_points(volume.affine, np.array([index], float))[0]
    assert bpy.ops.ctmc.pick_point(point_mm=point.tolist()) == {"FINISHED"}
    assert scene.cursor.location[:] == pytest.approx((point * 0.01).tolist(), abs=1e-6)
    expected = {"axial": volume.values[4], "coronal": volume.values[:, 9], "sagittal": volume.values[:, :, 15]}
    for plane, axis in (("axial", 2), ("coronal", 1), ("sagittal", 0)):
        assert added[plane].location[axis] / 0.01 == pytest.approx(point[axis], abs=1e-3)
        np.testing.assert_allclose(pixels_of(added[plane]), expected[plane], atol=0.02)
        scene.ctmc_view.plane = plane
        assert slice_at(volume, plane, scene.ctmc_view.position).index == index[axis]


def test_added_slices_follow_window_and_level_of_the_sidebar(scene, surface):
    bpy.ops.ctmc.add_slice()
    (material,) = bpy.context.object.data.materials
    scene.ctmc_view.window, scene.ctmc_view.level = 50.0, 130.0
    gray = next(node for node in material.node_tree.nodes if node.label == WINDOW)
    assert (gray.inputs["From Min"].default_value, gray.inputs["From Max"].default_value) == (105.0, 155.0)


def test_a_slice_that_is_moved_by_hand_shows_the_ct_there_and_is_saved_so(scene, surface, tmp_path):
    bpy.ops.ctmc.add_slice()
    obj, volume = bpy.context.object, volumes.current(scene)
    before = pixels_of(obj)
    obj.location.z += 2 * 0.01  # one slice
    bpy.context.view_layer.update()
    assert not np.array_equal(pixels_of(obj), before)
    number = slice_at(volume, "axial", scene.ctmc_view.position).index + 1
    np.testing.assert_allclose(pixels_of(obj), volume.values[number], atol=0.02)
    name = obj.name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "case.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "case.blend"))
    np.testing.assert_allclose(pixels_of(bpy.data.objects[name]), volume.values[number], atol=0.02)
    images = [image for image in bpy.data.images if image.type != "RENDER_RESULT"]
    assert all(image.packed_file is not None for image in images)
    assert str(tmp_path) not in "".join(image.filepath for image in images)


def kept_mm(surface):
    """The lowest and the highest place of the evaluated surface, millimetres towards the head."""
    mesh = surface.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    heights = [(surface.matrix_world @ vertex.co).z for vertex in mesh.vertices]
    return min(heights) / 0.01, max(heights) / 0.01


def test_a_cut_can_be_flipped_and_flipped_back(scene, surface):
    low, high = kept_mm(surface)
    assert not bpy.ops.ctmc.flip_cut.poll()
    bpy.ops.ctmc.cut_at_slice()
    plane = surface.modifiers[0].node_group["CTMC Cut"]
    at = plane.location.z / 0.01
    assert kept_mm(surface) == pytest.approx((low, at), abs=0.01)
    bpy.ops.ctmc.flip_cut()
    bpy.context.view_layer.update()
    assert kept_mm(surface) == pytest.approx((at, high), abs=0.01)
    plane.hide_set(False)
    bpy.context.view_layer.objects.active = plane
    bpy.ops.ctmc.flip_cut()
    bpy.context.view_layer.update()
    assert kept_mm(surface) == pytest.approx((low, at), abs=0.01)


def test_after_a_cut_add_slice_shows_its_slice_and_keeps_the_selection(scene, surface):
    bpy.ops.ctmc.cut_at_slice()
    plane = surface.modifiers[0].node_group["CTMC Cut"]
    count = len(scene.objects)
    assert plane.hide_get()
    assert bpy.ops.ctmc.add_slice() == {"FINISHED"}
    assert len(scene.objects) == count
    assert not plane.hide_get()
    assert (bpy.context.object, bpy.context.selected_objects) == (surface, [surface])
    scene.ctmc_view.position = 0.2
    bpy.ops.ctmc.add_slice()
    assert len(scene.objects) == count + 1
    assert bpy.context.object != surface


def test_the_drawn_slice_does_not_cover_a_cut_that_shows_the_same(scene, surface):
    volume = volumes.current(scene)
    assert overlays.shows_slice(scene, volume)
    bpy.ops.ctmc.cut_at_slice()
    bpy.context.view_layer.update()
    assert not overlays.shows_slice(scene, volume)
    scene.ctmc_view.position = 0.2
    assert overlays.shows_slice(scene, volume)
    scene.ctmc_view.position = 0.5
    scene.ctmc_view.plane = "coronal"
    assert overlays.shows_slice(scene, volume)
    scene.ctmc_view.plane = "axial"
    surface.hide_set(True)
    assert overlays.shows_slice(scene, volume)
