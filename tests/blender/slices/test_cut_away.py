# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces from which a box takes what lies inside or outside it."""

import numpy as np
import pytest
from shapes import distance_mm

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.slices import (
    add_cut_box,
    cut_at_slice,
    cut_away,
    cut_box_of,
    flip_cut_away,
    near_half,
    remove_cut_away,
)
from ctmc_addon.blender.surface import add_reconstruction
from ctmc_addon.core import MeshError, ReconstructionSettings, Volume, reconstruct
from ctmc_addon.core.volume import region_corners

RADIUS = 0.5
UNIT = Volume(np.zeros((2, 2, 2)), np.eye(4))


@pytest.fixture
def scene():
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return bpy.context.scene


@pytest.fixture
def sphere(scene):
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=5, radius=RADIUS, location=(0.3, -0.2, 0.1))
    return bpy.context.object


def shown(obj):
    """Vertices (n, 3) in the world and faces (f, 3) of an object as it is shown."""
    bpy.context.view_layer.update()
    mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    mesh.calc_loop_triangles()
    vertices = np.array([obj.matrix_world @ vertex.co for vertex in mesh.vertices])
    return vertices, np.array([triangle.vertices[:] for triangle in mesh.loop_triangles])


def volume_of(obj):
    """The signed volume; also requires that every edge has two triangles."""
    vertices, faces = shown(obj)
    pairs = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(pairs, axis=0, return_counts=True)[1] == 2).all()
    a, b, c = np.moveaxis(vertices[faces] - vertices.mean(axis=0), 1, 0)
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def box_around(scene, low, high):
    return add_cut_box(scene, region_corners(UNIT, (*low, *high), "mm"))


def test_what_lies_inside_and_outside_a_box_add_up_to_the_sphere(scene, sphere):
    whole = volume_of(sphere)
    middle = np.array(sphere.location)
    box = box_around(scene, middle, middle + 1)
    cut_away([sphere], box)
    kept = volume_of(sphere)
    assert kept == pytest.approx(7 / 8 * whole, rel=1e-3)
    vertices, _ = shown(sphere)
    assert not (vertices > middle + 1e-5).all(axis=1).any()
    flip_cut_away(box)
    inside = volume_of(sphere)
    vertices, _ = shown(sphere)
    assert (vertices > middle - 1e-5).all()
    assert kept + inside == pytest.approx(whole, rel=1e-5)
    flip_cut_away(box)
    assert volume_of(sphere) == kept


def test_a_moved_and_scaled_box_cuts_where_it_is(scene, sphere):
    x, y, z = sphere.location
    box = box_around(scene, (x - 1, y - 1, z - 1), (x + 1, y + 1, z))
    cut_away([sphere], box)
    box.location.z, box.scale.z = z, 0.4  # from 0.2 below the middle to 0.2 above
    flip_cut_away(box)
    height, ends = 0.2, shown(sphere)[0][:, 2] - z
    assert (ends.min(), ends.max()) == pytest.approx((-height, height), abs=1e-6)
    layer = 2 * np.pi * (RADIUS**2 * height - height**3 / 3)
    assert 0.99 * layer < volume_of(sphere) < layer


def test_several_surfaces_follow_one_box_and_are_whole_again_without_it(scene, sphere):
    other = sphere.copy()
    scene.collection.objects.link(other)
    before = shown(sphere)
    box = add_cut_box(scene, near_half([sphere], (0.1, -0.9, 0.3)))
    cut_away([sphere], box)
    cut_away([sphere, other], box)
    assert [len(obj.modifiers) for obj in (sphere, other)] == [1, 1]
    assert [cut_box_of(obj) for obj in (sphere, box, None)] == [box, box, None]
    half = volume_of(other)
    # The viewer is behind: what has the lesser y is away.
    assert shown(other)[0][:, 1].min() == pytest.approx(other.location.y, abs=1e-5)
    flip_cut_away(box)
    assert volume_of(other) == pytest.approx(half, rel=1e-3)
    remove_cut_away(box)
    assert [len(obj.modifiers) for obj in (sphere, other)] == [0, 0]
    assert list(scene.objects) == [sphere, other]
    for was, again in zip(before, shown(sphere), strict=True):
        np.testing.assert_array_equal(again, was)


def test_the_cut_of_a_box_that_was_deleted_by_hand_can_be_removed(scene, sphere):
    before = len(sphere.data.polygons)
    box = add_cut_box(scene, near_half([sphere], (0, 0, 1)))
    cut_away([sphere], box)
    sphere.select_set(False)
    box.select_set(True)
    bpy.ops.object.delete()
    assert list(scene.objects) == [sphere]
    assert len(shown(sphere)[1]) < before
    remove_cut_away(cut_box_of(sphere))
    assert len(shown(sphere)[1]) == before


@pytest.mark.parametrize("flips", [0, 1])
def test_without_its_box_a_surface_is_whole_whichever_side_was_away(scene, sphere, flips):
    box = add_cut_box(scene, near_half([sphere], (0, 0, 1)))
    cut_away([sphere], box)
    for _ in range(flips):
        flip_cut_away(box)
    bpy.data.objects.remove(box)
    sphere.update_tag()
    assert len(shown(sphere)[1]) == len(sphere.data.polygons)
    assert cut_box_of(sphere) is None


@pytest.mark.parametrize("x_mm", [0.7, -0.7])
def test_a_box_of_an_oblique_or_mirrored_region_is_its_parallelepiped(scene, sphere, x_mm):
    affine = np.array([[x_mm, 0.1, 0, 0.3], [0.05, 0.8, 0, -0.2], [0.05, 0.2, 0.6, 0.1], [0, 0, 0, 1.0]])
    corners = region_corners(Volume(np.zeros((2, 2, 2)), affine), (-0.2, -0.2, -0.2, 0.2, 0.2, 0.2), "voxel")
    box = add_cut_box(scene, corners)
    exact = 0.4**3 * abs(np.linalg.det(affine[:3, :3]))
    assert volume_of(box) == pytest.approx(exact, rel=1e-5)
    whole = volume_of(sphere)
    cut_away([sphere], box)
    assert volume_of(sphere) == pytest.approx(whole - exact, rel=1e-5)  # a cavity
    flip_cut_away(box)
    assert volume_of(sphere) == pytest.approx(exact, rel=1e-5)


def test_an_open_surface_is_cut_capped_and_stays_open_where_it_was(scene, sphere):
    faces = [face.vertices[:] for face in sphere.data.polygons if face.center.z > -0.4]
    mesh = bpy.data.meshes.new("open")
    mesh.from_pydata([vertex.co[:] for vertex in sphere.data.vertices], [], faces)
    sphere.data = mesh
    x, y, z = sphere.location
    box = box_around(scene, (x - 1, y - 1, z + 0.2), (x + 1, y + 1, z + 1))
    cut_away([sphere], box)
    vertices, faces = shown(sphere)
    corners = vertices[faces]
    on_cap = (np.abs(corners[..., 2] - z - 0.2) < 1e-6).all(axis=1)
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(sides[on_cap], axis=1).sum() / 2 == pytest.approx(np.pi * (RADIUS**2 - 0.2**2), rel=5e-3)
    pairs, counts = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0, return_counts=True)
    border = vertices[pairs[counts == 1]][..., 2] - z
    assert len(border)
    assert border.max() < -0.35


def test_the_cut_is_flat_and_has_the_first_material(scene):
    volume = Volume((300 - 10 * distance_mm((31, 31, 31))).astype(np.int16), np.eye(4), name="ball", kind="HU")
    obj = add_reconstruction(reconstruct(volume, ReconstructionSettings(threshold=200)), scene)
    bpy.context.view_layer.update()
    box = add_cut_box(scene, near_half([obj], (0, 0, 1)))
    box.location.z += 0.0033
    cut_away([obj], box)
    bpy.context.view_layer.update()
    mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert {face.material_index for face in mesh.polygons} == {0}
    caps = [face for face in mesh.polygons if not face.use_smooth]
    assert caps
    for face in caps:
        assert face.normal[:] == pytest.approx((0, 0, 1), abs=1e-5)
        for loop in face.loop_indices:
            assert mesh.corner_normals[loop].vector[:] == pytest.approx((0, 0, 1), abs=1e-5)


def test_neither_a_light_nor_a_box_is_cut(scene, sphere):
    light = bpy.data.objects.new("light", bpy.data.lights.new("light", "POINT"))
    box = add_cut_box(scene, near_half([sphere], (0, 0, 1)))
    for obj in (light, box):
        with pytest.raises(MeshError, match="is not a surface"):
            cut_away([sphere, obj], box)
    with pytest.raises(MeshError, match="is not a surface"):
        cut_at_slice(scene, [box], sphere)
    assert not sphere.modifiers
    assert box.hide_render
