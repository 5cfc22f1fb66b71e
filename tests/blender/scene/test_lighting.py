# SPDX-License-Identifier: GPL-3.0-or-later
"""The studio: what is shown lies inside the picture, lights are as large as it, and nothing of others is touched."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

from ctmc_addon.blender.scene.lighting import LAMPS, NAME, set_up_studio, sphere_of
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
