# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects that are updated: what a user did to them stays."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from surface_objects import alpha_key, worst_mm

from ctmc_addon.blender.surface import add_reconstruction, evaluated_triangles, update_reconstruction
from ctmc_addon.core.errors import MeshError


def test_an_update_keeps_place_transform_materials_and_modifiers(scene, torus):
    obj = add_reconstruction(torus(center_mm=np.array([10.0, 20.0, 30.0])), scene)
    obj.modifiers.new("Mine", "TRIANGULATE")
    material, where = obj.data.materials[0], obj.location.copy()
    result = torus(center_mm=np.array([14.0, 25.0, 36.0]), rings=30)
    update_reconstruction(obj, result)
    assert obj.location == where
    assert obj.data.materials[0] == material
    assert [modifier.name for modifier in obj.modifiers] == ["Mine"]
    assert worst_mm(obj, result.mesh) <= 1e-4
    assert [len(bpy.data.meshes), len(bpy.data.shape_keys)] == [1, 1]
    assert obj.data.name == "torus"


def test_an_update_of_a_moved_object_leaves_it_moved(scene, torus):
    obj = add_reconstruction(torus(), scene)
    obj.location.x += 1.0
    result = torus(rings=30)
    update_reconstruction(obj, result)
    moved_mm = evaluated_triangles(obj).vertices.astype(np.float64) - result.mesh.vertices
    assert np.abs(moved_mm - (100, 0, 0)).max() < 1e-3


def test_a_key_moved_by_hand_stays_and_an_untouched_one_follows_the_settings(scene, torus):
    obj = add_reconstruction(torus(alpha=0.5), scene)
    update_reconstruction(obj, torus(alpha=0.9))
    assert alpha_key(obj).value == pytest.approx(0.9)
    alpha_key(obj).value = 0.2
    update_reconstruction(obj, torus(alpha=0.4, rings=30))
    assert alpha_key(obj).value == pytest.approx(0.2)


def test_the_keys_animation_survives_an_update(scene, torus):
    obj = add_reconstruction(torus(), scene)
    for frame, value in ((1, 0.0), (11, 1.0)):
        alpha_key(obj).value = value
        alpha_key(obj).keyframe_insert("value", frame=frame)
    result = torus(rings=30)
    update_reconstruction(obj, result)
    for frame, alpha in ((1, 0.0), (11, 1.0)):
        scene.frame_set(frame)
        assert alpha_key(obj).value == alpha
        assert worst_mm(obj, result.surface.at(alpha)) <= 1e-4


def test_the_keys_driver_survives_an_update(scene, torus):
    obj = add_reconstruction(torus(), scene)
    driver = alpha_key(obj).driver_add("value").driver
    driver.type = "SCRIPTED"
    driver.expression = "0.75"
    result = torus(rings=30)
    update_reconstruction(obj, result)
    assert worst_mm(obj, result.surface.at(0.75)) <= 1e-4


def test_an_animated_key_stays_where_it_is_even_at_the_value_of_the_settings(scene, torus):
    obj = add_reconstruction(torus(alpha=0.5), scene)
    for frame, value in ((1, 0.0), (11, 1.0)):
        alpha_key(obj).value = value
        alpha_key(obj).keyframe_insert("value", frame=frame)
    scene.frame_set(6)
    assert alpha_key(obj).value == 0.5
    update_reconstruction(obj, torus(alpha=0.9, rings=30))
    assert alpha_key(obj).value == 0.5


def test_the_keys_nla_tracks_survive_an_update(scene, torus):
    obj = add_reconstruction(torus(alpha=0.5), scene)
    for frame, value in ((1, 0.0), (11, 1.0)):
        alpha_key(obj).value = value
        alpha_key(obj).keyframe_insert("value", frame=frame)
    animation = obj.data.shape_keys.animation_data
    track = animation.nla_tracks.new()
    track.name = "rise"
    strip = track.strips.new("slow", 5, animation.action)
    strip.scale, strip.extrapolation, strip.blend_type = 2.0, "NOTHING", "REPLACE"
    strip.name = "slow"
    animation.action = None
    values = {}
    for frame in (5, 10, 15, 25):
        scene.frame_set(frame)
        values[frame] = alpha_key(obj).value
    assert values[5] < values[10] < values[15] < values[25]
    result = torus(rings=30)
    update_reconstruction(obj, result)
    kept = obj.data.shape_keys.animation_data.nla_tracks["rise"].strips["slow"]
    assert (kept.scale, kept.extrapolation, kept.blend_type) == (2.0, "NOTHING", "REPLACE")
    for frame, value in values.items():
        scene.frame_set(frame)
        assert alpha_key(obj).value == pytest.approx(value, abs=1e-6)


def test_a_muted_key_and_its_range_survive_an_update(scene, torus):
    obj = add_reconstruction(torus(alpha=0.5), scene)
    key = alpha_key(obj)
    key.slider_min, key.slider_max, key.mute = -1.0, 2.0, True
    key.value = 1.5
    update_reconstruction(obj, torus(rings=30))
    key = alpha_key(obj)
    assert (key.slider_min, key.slider_max, key.mute, key.value) == (-1.0, 2.0, True, 1.5)


def test_a_further_shape_key_is_not_lost_but_refused(scene, torus):
    obj = add_reconstruction(torus(), scene)
    obj.shape_key_add(name="mine", from_mix=False)
    mesh = obj.data
    with pytest.raises(MeshError, match="mine"):
        update_reconstruction(obj, torus(rings=30))
    assert obj.data == mesh
    assert [key.name for key in mesh.shape_keys.key_blocks] == ["Basis", "alpha", "mine"]


def test_our_decimate_follows_the_settings_unless_moved_by_hand(scene, torus):
    obj = add_reconstruction(torus(simplifier="decimate", reduction=0.5), scene)
    update_reconstruction(obj, torus(simplifier="decimate", reduction=0.9))
    assert obj.modifiers[0].ratio == pytest.approx(0.1)
    obj.modifiers[0].ratio = 0.33
    update_reconstruction(obj, torus(simplifier="decimate", reduction=0.8))
    assert obj.modifiers[0].ratio == pytest.approx(0.33)
    update_reconstruction(obj, torus())
    assert not obj.modifiers


def test_a_shared_mesh_is_left_to_the_other_object(scene, torus):
    obj = add_reconstruction(torus(), scene)
    other = obj.copy()
    scene.collection.objects.link(other)
    update_reconstruction(obj, torus(rings=30))
    assert len(other.data.polygons) == 2304
    assert len(obj.data.polygons) == 1440


def test_an_object_in_edit_mode_or_of_another_kind_is_refused(scene, torus):
    obj = add_reconstruction(torus(), scene)
    with bpy.context.temp_override(active_object=obj, object=obj):
        bpy.context.view_layer.objects.active = obj
        bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(MeshError, match="Edit Mode"):
        update_reconstruction(obj, torus())
    bpy.ops.object.mode_set(mode="OBJECT")
    stranger = bpy.data.objects.new("cube", bpy.data.meshes.new("cube"))
    with pytest.raises(MeshError, match="not made by CTMC"):
        update_reconstruction(stranger, torus())


def test_an_object_that_blender_does_not_evaluate_is_refused(scene, torus):
    obj = add_reconstruction(torus(), scene)
    obj.hide_set(True)
    assert len(evaluated_triangles(obj).faces) == 2304
    obj.hide_viewport = True
    with pytest.raises(MeshError, match="monitor icon"):
        evaluated_triangles(obj)
    scene.collection.objects.unlink(obj)
    with pytest.raises(MeshError, match="no scene"):
        evaluated_triangles(obj)
