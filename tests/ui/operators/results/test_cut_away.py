# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators `ctmc.cut_away`, `ctmc.flip_cut_away` and `ctmc.remove_cut_away` as the sidebar presses them."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")


@pytest.fixture
def surface(scene, ball_file):
    """A ball of 6 mm radius."""
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1.0, 1.0, 2.0))
    scene.ctmc.use_threshold, scene.ctmc.threshold = True, 100
    bpy.ops.ctmc.reconstruct()
    return bpy.context.object


def ends_mm(obj):
    """The lowest and the highest x, y, z of an object as it is shown, (2, 3)."""
    bpy.context.view_layer.update()
    mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    points = np.array([obj.matrix_world @ vertex.co for vertex in mesh.vertices]) / 0.01
    return np.array([points.min(axis=0), points.max(axis=0)])


def test_the_front_half_is_cut_away_its_box_is_active_and_all_comes_back(scene, surface, tmp_path):
    before, objects = ends_mm(surface), list(scene.objects)
    middle = before.mean(axis=0)[1]
    assert not bpy.ops.ctmc.flip_cut_away.poll()
    assert not bpy.ops.ctmc.remove_cut_away.poll()
    assert bpy.ops.ctmc.cut_away() == {"FINISHED"}
    box = bpy.context.object
    assert bpy.context.selected_objects == [box]
    assert not bpy.ops.ctmc.cut_away.poll()  # a box is not a surface
    bpy.ops.ctmc.export(filepath=str(tmp_path / "front.ply"))  # not the box, but the one visible surface
    assert ends_mm(surface)[:, 1] == pytest.approx((before[0, 1], middle), abs=1e-3)
    bpy.ops.ctmc.flip_cut_away()
    assert ends_mm(surface)[:, 1] == pytest.approx((middle, before[1, 1]), abs=1e-3)
    bpy.context.view_layer.objects.active = surface
    surface.select_set(True)
    bpy.ops.ctmc.export(filepath=str(tmp_path / "half.ply"), which="SELECTED")  # one surface: PLY holds no more
    assert (tmp_path / "front.ply").exists()
    bpy.ops.ctmc.flip_cut_away()
    assert ends_mm(surface)[:, 1] == pytest.approx((before[0, 1], middle), abs=1e-3)
    assert bpy.ops.ctmc.remove_cut_away() == {"FINISHED"}
    np.testing.assert_array_equal(ends_mm(surface), before)
    assert (list(scene.objects), len(surface.modifiers)) == (objects, 0)


def test_the_box_begins_as_the_region(scene, surface):
    x, y, z = middle = ends_mm(surface).mean(axis=0)
    scene.ctmc.region_in = "mm"
    scene.ctmc.region = (x - 3, y - 2, z - 1, x + 3, y + 2, z + 1)
    assert scene.ctmc.use_region
    bpy.ops.ctmc.cut_away()
    half = np.array([3, 2, 1])
    expected = [middle - half, middle + half]
    np.testing.assert_allclose(ends_mm(bpy.context.object), expected, atol=1e-3)
    bpy.ops.ctmc.flip_cut_away()
    np.testing.assert_allclose(ends_mm(surface), expected, atol=1e-3)


def test_the_active_box_cuts_further_surfaces(scene, surface):
    other = surface.copy()
    scene.collection.objects.link(other)
    other.select_set(False)
    bpy.ops.ctmc.cut_away()
    box = bpy.context.object
    assert not other.modifiers
    other.select_set(True)
    count = len(scene.objects)
    bpy.ops.ctmc.cut_away()
    assert bpy.context.object == box
    assert len(scene.objects) == count
    np.testing.assert_array_equal(ends_mm(other), ends_mm(surface))
