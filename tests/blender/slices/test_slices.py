# SPDX-License-Identifier: GPL-3.0-or-later
"""Slices as planes with the CT on them, and surfaces cut open at them."""

import numpy as np
import pytest
from shapes import distance_mm

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.slices import CUT, add_slice, cut_at_slice, is_slice, show_window
from ctmc_addon.blender.slices.material import SOLID, UV, picture_coordinates, picture_of
from ctmc_addon.blender.surface import add_reconstruction
from ctmc_addon.core import MeshError, ReconstructionSettings, Volume, reconstruct
from ctmc_addon.core.volume import PLANES, slice_at, slice_corners, slice_through

SCALE = 0.01
STRAIGHT = np.diag([1.0, 1.0, 1.0, 1.0])
AFFINE = np.array([[-0.7, 0.1, 0, 312.5], [0.1, 0.8, 0, -207.25], [0.05, 0.2, 2.0, 715.125], [0, 0, 0, 1.0]])


@pytest.fixture
def scene():
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return bpy.context.scene


def ball(affine=STRAIGHT):
    """HU fall from 300 by the distance from the middle, 15 voxels from every side; 200 at 10 voxels."""
    return Volume((300 - 10 * distance_mm((31, 31, 31))).astype(np.int16), affine, name="ball", kind="HU")


def world_corners(obj):
    bpy.context.view_layer.update()
    return np.array([obj.matrix_world @ vertex.co for vertex in obj.data.vertices])


@pytest.mark.parametrize("plane", PLANES)
def test_a_slice_stands_where_the_patient_has_it_and_holds_its_values(scene, plane):
    volume = ball(AFFINE)
    section = slice_at(volume, plane, 0.3)
    obj = add_slice(scene, volume, section, plane, 400, 40, SCALE)
    assert is_slice(obj)
    assert np.abs(world_corners(obj) / SCALE - slice_corners(volume, section)).max() < 1e-3  # mm
    picture = picture_of(obj.data.materials[0])
    assert picture.packed_file is not None
    pixels = np.array(picture.pixels[:]).reshape(31, 31, -1)[..., 0]
    expected = np.take(volume.values, section.index, axis=2 - section.axis)
    np.testing.assert_array_equal(pixels, expected)


def body():
    """A square of 40 HU with a hole of -900 HU in air of -1000 HU."""
    values = np.full((3, 31, 31), -1000, np.int16)
    values[:, 5:25, 5:25], values[:, 10:20, 10:20] = 40, -900
    return Volume(values, STRAIGHT, name="body", kind="HU")


def pixels_of(picture):
    return np.array(picture.pixels[:]).reshape(31, 31, 4)


def test_air_around_the_body_alone_is_transparent_and_survives_saving(scene, tmp_path):
    volume = body()
    obj = add_slice(scene, volume, slice_at(volume, "axial", 0.5), "axial", 400, 40, SCALE)
    name = obj.name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "case.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "case.blend"))
    picture = bpy.data.images[name]
    assert picture.is_float
    np.testing.assert_array_equal(pixels_of(picture)[..., 0], volume.values[1])
    np.testing.assert_array_equal(pixels_of(picture)[..., 3], volume.values[1] > -1000)


def test_solid_shading_shows_the_grays_of_window_and_level(scene):
    volume = body()
    obj = add_slice(scene, volume, slice_at(volume, "axial", 0.5), "axial", 400, 40, SCALE, "ours")
    tree = obj.data.materials[0].node_tree
    shown = tree.nodes.active.image
    assert shown == picture_of(obj.data.materials[0], SOLID)
    assert np.unique(pixels_of(shown)[5:25, 5:25, 0]) == pytest.approx([0.0, 0.5], abs=0.01)
    np.testing.assert_array_equal(pixels_of(shown)[..., 3], volume.values[1] > -1000)
    show_window(scene, "ours", 1600.0, -600.0)
    assert np.unique(pixels_of(shown)[5:25, 5:25, 0]) == pytest.approx([0.3125, 0.9], abs=0.01)


@pytest.mark.parametrize("plane", PLANES)
def test_a_place_of_the_picture_lies_where_the_uv_map_says(scene, plane):
    volume = ball(AFFINE)
    obj = add_slice(scene, volume, slice_at(volume, plane, 0.5), plane, 400, 40, SCALE)
    corners = np.array([vertex.co for vertex in obj.data.vertices])
    found = 0.5 + corners @ picture_coordinates(corners).T
    places = [obj.data.uv_layers[UV].uv[loop].vector[:] for loop in obj.data.polygons[0].loop_indices]
    np.testing.assert_allclose(found, places, atol=1e-6)


def test_the_cap_has_the_uv_map_of_its_slice(scene):
    surface, slice_object, *_ = cut_ball(scene, "coronal")
    mesh = surface.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    names = [material and material.name for material in mesh.materials]
    index = names.index(slice_object.data.materials[0].name)
    loops = [loop for face in mesh.polygons if face.material_index == index for loop in face.loop_indices]
    places = np.array([mesh.uv_layers[UV].uv[loop].vector for loop in loops])
    points = np.array([surface.matrix_world @ mesh.vertices[mesh.loops[loop].vertex_index].co for loop in loops])
    corners = np.array([slice_object.matrix_world @ vertex.co for vertex in slice_object.data.vertices])
    expected = 0.5 + (points - corners.mean(axis=0)) @ picture_coordinates(corners - corners.mean(axis=0)).T
    assert len(loops) > 20
    np.testing.assert_allclose(places, expected, atol=1e-4)


def cut_ball(scene, plane, affine=STRAIGHT):
    volume = ball(affine)
    surface = add_reconstruction(reconstruct(volume, ReconstructionSettings(threshold=200)), scene, SCALE)
    slice_object = add_slice(scene, volume, slice_at(volume, plane, 0.5), plane, 400, 40, SCALE)
    cut_at_slice(scene, [surface], slice_object)
    mesh = surface.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    mesh.calc_loop_triangles()
    vertices = np.array([surface.matrix_world @ vertex.co for vertex in mesh.vertices]) / SCALE
    faces = np.array([triangle.vertices[:] for triangle in mesh.loop_triangles])
    materials = np.array([triangle.material_index for triangle in mesh.loop_triangles])
    names = [material.name for material in mesh.materials]
    return surface, slice_object, vertices, faces, np.array(names)[materials]


@pytest.mark.parametrize(("plane", "axis"), [("axial", 2), ("coronal", 1), ("sagittal", 0)])
@pytest.mark.parametrize("affine", [STRAIGHT, np.diag([-1.0, -1.0, 1.0, 1.0])])
def test_a_cut_ball_keeps_the_half_away_from_head_front_and_right(scene, plane, axis, affine):
    bpy.context.view_layer.update()
    _, slice_object, vertices, faces, _ = cut_ball(scene, plane, affine)
    middle = slice_object.location[axis] / SCALE
    assert vertices[:, axis].max() == pytest.approx(middle, abs=1e-3)
    assert vertices[:, axis].min() == pytest.approx(middle - 10, abs=0.1)
    corners = vertices[faces] - vertices.mean(axis=0)
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert volume == pytest.approx(2 / 3 * np.pi * 10**3, rel=0.02)


def test_the_cap_alone_carries_the_slice_and_moves_with_it(scene):
    surface, slice_object, vertices, faces, materials = cut_ball(scene, "axial")
    on_cap = materials == slice_object.data.materials[0].name
    height = vertices[faces][..., 2].max(axis=1)
    assert on_cap.any()
    assert np.abs(vertices[faces][on_cap][..., 2] - 15).max() < 1e-3
    assert (height[~on_cap] < 15 + 1e-3).all()
    slice_object.location.z -= 5 * SCALE
    bpy.context.view_layer.update()
    mesh = surface.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    top = max((surface.matrix_world @ vertex.co).z for vertex in mesh.vertices) / SCALE
    assert top == pytest.approx(10, abs=1e-3)
    assert [modifier.name for modifier in surface.modifiers] == [CUT]


def edge_counts(faces):
    """How many faces each edge has."""
    pairs = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(pairs, axis=0, return_counts=True)[1]


def test_a_cut_is_closed_by_its_cap(scene):
    *_, faces, _ = cut_ball(scene, "coronal")
    assert (edge_counts(faces) == 2).all()


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_an_open_surface_with_a_cavity_is_cut_and_its_wall_alone_is_capped(scene, turn):
    # Two spheres, one inside the other and turned over, with a hole at the bottom.
    shell = bpy.data.meshes.new("shell")
    vertices, faces = [], []
    for radius, order in ((0.1, 1), (0.06, -1)):
        bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=radius)
        sphere = bpy.context.object
        kept = [face for face in sphere.data.polygons if face.center.z > -0.97 * radius]
        faces += [[corner + len(vertices) for corner in face.vertices][::order] for face in kept]
        vertices += [vertex.co[:] for vertex in sphere.data.vertices]
        bpy.data.objects.remove(sphere)
    shell.from_pydata(vertices, [], faces)
    obj = bpy.data.objects.new("shell", shell)
    scene.collection.objects.link(obj)
    volume = ball()
    plane = add_slice(scene, volume, slice_at(volume, "axial", 0.5), "axial", 400, 40, SCALE)
    plane.location, plane.rotation_euler = (0, 0, 0.02), (turn, 0, 0)
    cut_at_slice(scene, [obj], plane)
    bpy.context.view_layer.update()
    mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    name = plane.data.materials[0].name
    index = [material and material.name for material in mesh.materials].index(name)
    cap = sum(face.area for face in mesh.polygons if face.material_index == index)
    height = 0.02 * np.cos(turn)
    assert cap == pytest.approx(np.pi * ((0.1**2 - height**2) - (0.06**2 - height**2)), rel=0.01)


def test_the_cut_shows_the_gray_values_of_the_ct(scene, tmp_path):
    surface, slice_object, *_ = cut_ball(scene, "axial")
    slice_object.hide_render = True
    nodes = slice_object.data.materials[0].node_tree.nodes
    window = next(node for node in nodes if node.label == "Window and Level")
    window.inputs["From Min"].default_value, window.inputs["From Max"].default_value = 100, 400
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera, camera.location = camera, (surface.location.x, surface.location.y, surface.location.z + 1)
    camera.data.type, camera.data.ortho_scale = "ORTHO", 0.2
    scene.view_settings.view_transform = "Raw"
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    scene.render.resolution_x = scene.render.resolution_y = 20
    scene.render.film_transparent = True
    scene.render.filepath = str(tmp_path / "cut.png")
    bpy.ops.render.render(write_still=True)
    pixels = np.array(bpy.data.images.load(scene.render.filepath).pixels[:]).reshape(20, 20, 4)
    # A pixel is 1 mm, and pixels meet in the middle, at 300 HU.
    assert pixels[10, 10, 3] == 1
    assert pixels[0, 0, 3] == 0
    for away in (0.5, 3.5, 7.5):
        distance = np.hypot(away, 0.5)
        assert pixels[10, int(10 + away), 0] == pytest.approx(((300 - 10 * distance - 100) / 300) ** 2.2, abs=0.02)


def test_a_light_is_not_cut(scene):
    light = bpy.data.objects.new("light", bpy.data.lights.new("light", "POINT"))
    plane = add_slice(scene, ball(), slice_at(ball(), "axial", 0.5), "axial", 400, 40, SCALE)
    with pytest.raises(MeshError, match="light is not a surface"):
        cut_at_slice(scene, [light], plane)


def test_the_slice_through_a_point_is_the_nearest_in_each_plane():
    volume = ball(AFFINE)
    point = AFFINE[:3, :3] @ [7.2, 19.8, 40.0] + AFFINE[:3, 3]
    found = {plane: slice_through(volume, plane, point) for plane in PLANES}
    assert {section.axis: section.index for section in found.values()} == {0: 7, 1: 20, 2: 30}
