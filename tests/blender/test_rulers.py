# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances and angles as objects: their values are the patient's, wherever the surface stands."""

import numpy as np
import pytest
from shapes import distance_mm

bpy = pytest.importorskip("bpy")

from mathutils import Vector

from ctmc_addon.blender.rulers import add_ruler, hit, is_ruler, patient_mm, place_of, rulers_of, text_of
from ctmc_addon.blender.surface import add_reconstruction
from ctmc_addon.core import MeshError, ReconstructionSettings, Volume, reconstruct

RADIUS = 8.0  # mm


@pytest.fixture
def scene():
    """An empty file."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return bpy.context.scene


def ball(scene, scale):
    """A ball of 8 mm radius round (12, 12, 12) mm."""
    volume = Volume((100 - 10 * distance_mm((25, 25, 25))).astype(np.float32), np.eye(4))
    return add_reconstruction(reconstruct(volume, ReconstructionSettings(threshold=100 - 10 * RADIUS)), scene, scale)


def shot(scene, start, end):
    """What a ray meets first."""
    bpy.context.view_layer.update()
    origin = Vector(start)
    return hit(scene, bpy.context.evaluated_depsgraph_get(), origin, (Vector(end) - origin).normalized())


@pytest.mark.parametrize("scale", [0.01, 1.0])
@pytest.mark.parametrize("size", [1.0, 2.5])
def test_a_balls_diameter_is_measured_however_it_is_moved_and_enlarged(scene, scale, size):
    obj = ball(scene, scale)
    obj.location, obj.scale, obj.rotation_euler = (1.0, 2.0, 3.0), (size, size, size), (0.3, 0.2, 0.1)
    bpy.context.view_layer.update()
    middle, far = obj.matrix_world.translation, Vector((0, 0, 1000 * scale))
    hits = [shot(scene, middle + side * far, middle) for side in (1, -1)]
    assert all(found is obj for found, _ in hits)
    points = [patient_mm(found, place, scale) for found, place in hits]
    ruler = add_ruler(scene, "distance", [place for _, place in hits], "Distance", scale, points)
    assert ruler["ctmc_ruler"]["value"] == pytest.approx(2 * RADIUS, abs=0.15)
    assert ruler.name == f"Distance {text_of(ruler)}"
    bpy.context.view_layer.update()
    assert place_of(ruler)[:] == pytest.approx(middle[:], abs=0.1 * scale * size)
    assert max(ruler.dimensions) == pytest.approx(2 * RADIUS * scale * size, rel=0.02)  # the wire spans the ball seen


def test_a_right_angle_is_a_right_angle_and_is_said_at_its_corner(scene):
    ruler = add_ruler(scene, "angle", [(1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 3.0, 0.0)], "Angle", 0.01)
    bpy.context.view_layer.update()
    assert text_of(ruler) == "90.0\N{DEGREE SIGN}"
    assert place_of(ruler)[:] == pytest.approx((0, 0, 0), abs=1e-6)


def test_a_ray_goes_through_rulers(scene):
    obj = ball(scene, 0.01)
    add_ruler(scene, "distance", [(0.12, 0.12, 1.0), (0.12, 0.12, 3.0)], "Distance", 0.01)
    found, place = shot(scene, (0.12, 0.12, 5.0), (0.12, 0.12, 0.0))
    assert found is obj
    assert place.z == pytest.approx(0.20, abs=0.002)
    assert shot(scene, (5.0, 5.0, 5.0), (5.0, 5.0, 9.0)) is None


def test_a_ruler_is_deleted_as_an_object_and_two_equal_points_make_none(scene):
    with pytest.raises(MeshError, match="the same"):
        add_ruler(scene, "distance", [(1.0, 1.0, 1.0)] * 2, "Distance", 0.01)
    ruler = add_ruler(scene, "distance", [(0.0, 0.0, 0.0), (0.0, 0.03, 0.04)], "Distance", 0.01)
    assert rulers_of(scene) == [ruler]
    assert is_ruler(ruler)
    assert text_of(ruler) == "5.0 mm"
    bpy.data.objects.remove(ruler)
    assert rulers_of(scene) == []
    assert not is_ruler(None)
