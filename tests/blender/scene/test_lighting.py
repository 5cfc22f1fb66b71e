# SPDX-License-Identifier: GPL-3.0-or-later
"""The studio: what is shown lies inside the picture, lights are as large as it, and nothing of others is touched."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

from ctmc_addon.blender.scene.background import NAME
from ctmc_addon.blender.scene.ct_box import show_box
from ctmc_addon.blender.scene.lighting import LAMPS, has_placed_camera, set_up_studio, sphere_of
from ctmc_addon.blender.scene.new_file import _is_plain, is_first_camera, is_first_light
from ctmc_addon.blender.scene.studio import corners_of
from ctmc_addon.blender.surface import add_reconstruction


@pytest.mark.parametrize("size", [(320, 180), (90, 200)])
@pytest.mark.parametrize("scale", [0.01, 1.0])
def test_the_camera_frames_what_is_shown_from_the_front_left(scene, torus, size, scale):
    objects = [add_reconstruction(torus(), scene, scale), add_reconstruction(torus((400, -300, 900)), scene, scale)]
    scene.render.resolution_x, scene.render.resolution_y = size
    set_up_studio(scene, objects)
    scene.view_layers[0].update()
    points = np.concatenate([corners_of(obj, scene) for obj in objects])
    seen = np.array([world_to_camera_view(scene, scene.camera, Vector(point)) for point in points.tolist()])
    across = seen[:, :2]
    assert across.min() > 0.0
    assert across.max() < 1.0
    assert np.ptp(across, axis=0).max() == pytest.approx(1 / 1.12, rel=1e-3)
    assert seen[:, 2].min() > scene.camera.data.clip_start
    assert seen[:, 2].max() < scene.camera.data.clip_end
    towards = scene.camera.matrix_world.col[2]
    assert towards.x < 0 < towards.y  # RAS+: to the patient's left, and to the front


def test_lights_are_sized_to_the_subject(scene, torus):
    lit = {}
    for scale in (0.01, 0.1):
        obj = add_reconstruction(torus(), scene, scale)
        set_up_studio(scene, [obj])
        middle, radius = sphere_of(corners_of(obj, scene))
        for name, lamp in LAMPS.items():
            light = scene.objects[name]
            away = float(np.linalg.norm(np.array(light.matrix_world.translation) - middle))
            assert away == pytest.approx(lamp.away * radius, rel=1e-3)
            assert light.data.size == pytest.approx(lamp.size * radius, rel=1e-5)
            lit.setdefault(name, []).append(light.data.energy / away**2)
    assert all(first == pytest.approx(second, rel=1e-3) for first, second in lit.values())


def test_the_studio_stands_alone_and_again_takes_its_place(scene, torus):
    obj = add_reconstruction(torus(), scene)
    lamp = bpy.data.objects.new("mine", bpy.data.lights.new("mine", "SUN"))
    scene.collection.objects.link(lamp)
    scene.view_layers[0].update()
    before = (obj.matrix_world.copy(), scene.render.engine, scene.render.resolution_x, len(bpy.data.materials))
    for _ in range(2):
        set_up_studio(scene, [obj])
    assert sorted(thing.name for thing in bpy.data.collections[NAME].objects) == [
        *sorted([*LAMPS, "CTMC Studio Camera"])
    ]
    assert [folder.name for folder in scene.collection.children] == [NAME]
    assert (len(bpy.data.cameras), len(bpy.data.lights)) == (1, 4)
    assert sum(world.name.startswith(NAME) for world in bpy.data.worlds) == 1
    assert before == (obj.matrix_world, scene.render.engine, scene.render.resolution_x, len(bpy.data.materials))
    assert lamp.name in scene.objects


def test_camera_and_lights_stand_outside_the_ct_and_clicks_miss_the_lights(scene, torus):
    obj = add_reconstruction(torus(), scene)
    scene.view_layers[0].update()
    middle, radius = sphere_of(corners_of(obj, scene))
    signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8).T
    corners = middle + radius * np.array([2.0, 1.0, 0.0]) + 8.0 * radius * signs
    show_box(scene, corners, "patient", "f", "patient.nii", ("folder", "folder"))
    set_up_studio(scene, [obj])
    for light in [scene.objects[name] for name in LAMPS]:
        turn = np.array(light.matrix_world)[:3, :3]
        ahead = (corners - np.array(light.matrix_world.translation)) @ turn[:, 2]
        assert ahead.max() < 0.0  # A light shines along its negative z: the whole box is on that side.
        assert light.hide_select
    eye = scene.camera
    ahead = (corners - np.array(eye.matrix_world.translation)) @ np.array(eye.matrix_world)[:3, 2]
    assert ahead.max() < 0.0
    assert not eye.hide_select


def test_a_camera_is_placed_by_a_person_once_it_was_moved(scene, torus):
    obj = add_reconstruction(torus(), scene)
    assert not has_placed_camera(scene)
    set_up_studio(scene, [obj])
    scene.view_layers[0].update()
    assert not has_placed_camera(scene)
    scene.objects["CTMC Key"].data.energy *= 2.0
    assert has_placed_camera(scene)
    set_up_studio(scene, [obj])
    assert not has_placed_camera(scene)
    scene.camera.location.x += 0.1
    assert has_placed_camera(scene)


def test_the_camera_and_the_light_of_a_new_file_are_not_a_persons(torus):
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    scene = bpy.context.scene
    obj = add_reconstruction(torus(), scene)
    assert not has_placed_camera(scene)
    set_up_studio(scene, [obj])
    assert bpy.data.objects["Light"].hide_render
    own = bpy.data.objects["Camera"]
    own.location.x += 1.0
    scene.camera = own
    assert has_placed_camera(scene)


@pytest.mark.parametrize("change", ["turned", "tracking", "parented"])
@pytest.mark.parametrize("name", ["Camera", "Light"])
def test_the_camera_or_light_of_a_new_file_is_a_persons_once_changed(name, change):
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    obj, is_first = bpy.data.objects[name], {"Camera": is_first_camera, "Light": is_first_light}[name]
    assert is_first(obj)
    if change == "turned":
        obj.rotation_euler.z += 0.1
    elif change == "tracking":
        obj.constraints.new("TRACK_TO").target = bpy.data.objects["Cube"]
    else:
        obj.parent = bpy.data.objects["Cube"]
    assert not is_first(obj)


def test_a_material_without_nodes_is_not_that_of_a_new_file():
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    assert _is_plain(bpy.data.meshes["Cube"])
    assert not _is_plain(SimpleNamespace(materials=[SimpleNamespace(node_tree=None)]))
