# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators `ctmc.add_slice` and `ctmc.cut_at_slice` as the sidebar presses them."""

import pytest

bpy = pytest.importorskip("bpy")


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


def test_selected_surfaces_are_cut_at_the_slice_that_is_shown_and_at_the_active_one(scene, surface):
    assert bpy.ops.ctmc.cut_at_slice() == {"FINISHED"}
    (cut,) = surface.modifiers
    plane = cut.object.parent
    assert bpy.context.object == surface
    half = len(surface.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.polygons)
    assert 0.3 < half / len(surface.data.polygons) < 0.8
    plane.hide_set(False)
    plane.select_set(True)
    bpy.context.view_layer.objects.active = plane
    slices = len(scene.objects)
    assert bpy.ops.ctmc.cut_at_slice() == {"FINISHED"}
    assert len(scene.objects) == slices
    assert [modifier.object for modifier in surface.modifiers] == [cut.object] * 2


def test_without_a_selected_surface_nothing_is_cut(scene, surface):
    surface.select_set(False)
    assert not bpy.ops.ctmc.cut_at_slice.poll()


def test_in_edit_mode_no_slice_is_added_and_nothing_is_cut(scene, surface):
    bpy.ops.object.mode_set(mode="EDIT")
    assert not bpy.ops.ctmc.add_slice.poll()
    assert not bpy.ops.ctmc.cut_at_slice.poll()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert bpy.ops.ctmc.cut_at_slice.poll()
