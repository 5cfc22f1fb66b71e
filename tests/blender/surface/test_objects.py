# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects made from reconstructions, updated, and made final."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.surface import (
    add_reconstruction,
    apply_shape_and_modifiers,
    as_shown,
    call,
    evaluated_triangles,
    own_mesh,
    read_back,
    temporary_surfaces,
    update_reconstruction,
)
from ctmc_addon.core import ReconstructionSettings, Volume, reconstruct_labels
from ctmc_addon.core.errors import MeshError
from ctmc_addon.core.mesh.triangle_mesh import TriangleMesh


def alpha_key(obj):
    return obj.data.shape_keys.key_blocks["alpha"]


def worst_mm(obj, mesh):
    seen = evaluated_triangles(obj)
    assert (seen.faces == mesh.faces).all()
    return np.abs(seen.vertices.astype(np.float64) - mesh.vertices).max()


@pytest.mark.parametrize("alpha", [0.0, 0.3, 1.0])
def test_the_evaluated_object_is_the_result_within_a_tenth_of_a_micrometre(scene, torus, alpha):
    result = torus(alpha=alpha)
    assert worst_mm(add_reconstruction(result, scene), result.mesh) <= 1e-4


@pytest.mark.parametrize("scale", [0.001, 0.01, 1.0])
def test_blenders_own_matrix_puts_every_vertex_in_its_place(scene, torus, scale):
    result = torus(alpha=1.0)
    obj = add_reconstruction(result, scene, scale=scale)
    scene.view_layers[0].update()
    obj = obj.evaluated_get(scene.view_layers[0].depsgraph)
    seen = np.array([(obj.matrix_world @ vertex.co)[:] for vertex in obj.data.vertices]) / scale
    assert np.abs(seen - result.mesh.vertices).max() <= 1e-4


def test_moving_the_key_moves_the_surface_as_core_would(scene, torus):
    result = torus(alpha=0.25)
    obj = add_reconstruction(result, scene)
    for alpha in (0.0, 0.6, 1.0):
        alpha_key(obj).value = alpha
        assert worst_mm(obj, result.surface.at(alpha)) <= 1e-4


def test_the_origin_is_the_center_of_the_surface(scene, torus):
    result = torus(alpha=1.0, center_mm=np.array([100.0, -50.0, 30.0]))
    obj = add_reconstruction(result, scene)
    assert np.abs(np.array(obj.location) - (1.0, -0.5, 0.3)).max() < 1e-3
    low, high = result.mesh.vertices.min(axis=0), result.mesh.vertices.max(axis=0)
    assert np.abs(np.array(obj.location) - (low + high) / 200).max() < 1e-6


def test_the_mesh_is_valid_smooth_and_has_one_material(scene, torus):
    obj = add_reconstruction(torus(), scene)
    assert not obj.data.validate(verbose=True)
    assert all(face.use_smooth for face in obj.data.polygons)
    assert len(obj.data.materials) == 1


def test_edges_are_in_the_order_of_their_ends_whatever_blenders_threads(scene, torus):
    mesh = add_reconstruction(torus(rings=60, sides=30), scene).data  # Blender's own order needs 1000 faces to differ
    ends = np.array([edge.vertices[:] for edge in mesh.edges])
    assert (ends[:, 0] < ends[:, 1]).all()
    assert (np.diff(ends[:, 0] * len(mesh.vertices) + ends[:, 1]) > 0).all()
    assert {tuple(sorted(key)) for face in mesh.polygons for key in face.edge_keys} == {tuple(row) for row in ends}
    for face in mesh.polygons[:50]:
        loops = [mesh.loops[at] for at in face.loop_indices]
        for here, there in zip(loops, loops[1:] + loops[:1], strict=True):
            assert set(ends[here.edge_index]) == {here.vertex_index, there.vertex_index}


def test_the_name_is_the_structures_else_the_files_and_the_label(scene, torus):
    assert add_reconstruction(torus(label=2, threshold=None, name="volume-3"), scene).name == "volume-3 label 2"
    long = add_reconstruction(torus(label=31, threshold=None, name="肝臓" * 40), scene)
    assert long.name.endswith(" label 31")
    assert long.name.startswith("肝臓肝臓")
    known = add_reconstruction(torus(label=5, threshold=None, name="volume-3"), scene, structure="liver")
    assert (known.name, known.data.name, known.data.materials[0].name) == ("liver",) * 3
    long = add_reconstruction(torus(label=5, threshold=None, name="ct" * 40), scene, structure="肝臓" * 40)
    assert long.name.startswith("肝臓肝臓")
    assert len(long.name.encode()) <= 59


def test_another_name_goes_to_mesh_and_material_but_not_over_one_that_a_user_gave(scene, torus):
    obj = add_reconstruction(torus(), scene, structure="Bone 200 HU")
    call(obj, "Bone 300 HU")
    assert (obj.name, obj.data.name, obj.data.materials[0].name) == ("Bone 300 HU",) * 3
    obj.name = "Femur"
    call(obj, "Bone 400 HU")
    assert obj.name == "Femur"


def test_labels_have_different_colors_and_a_given_color_wins(scene, torus):
    objs = [add_reconstruction(torus(label=label, threshold=None), scene) for label in (1, 2)]
    objs.append(add_reconstruction(torus(), scene, color=(0.1, 0.2, 0.3)))
    colors = [tuple(round(part, 3) for part in obj.data.materials[0].diffuse_color) for obj in objs]
    assert len(set(colors)) == 3
    assert colors[2] == (0.1, 0.2, 0.3, 1.0)


def test_a_surface_without_triangles_is_refused(scene, torus):
    from dataclasses import replace

    empty = TriangleMesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    with pytest.raises(MeshError, match="no triangles"):
        add_reconstruction(replace(torus(), mesh=empty, surface=None), scene)
    assert not len(bpy.data.objects)


def test_after_the_builtin_simplifier_the_mesh_is_plain(scene, torus):
    result = torus(reduction=0.5)
    obj = add_reconstruction(result, scene)
    assert obj.data.shape_keys is None
    assert not obj.modifiers
    assert worst_mm(obj, result.mesh) <= 1e-4


@pytest.mark.parametrize(("goal", "left"), [({"reduction": 0.75}, 576), ({"target_faces": 400}, 400)])
def test_decimate_stays_live_and_meets_the_goal(scene, torus, goal, left):
    obj = add_reconstruction(torus(simplifier="decimate", **goal), scene)
    assert [modifier.type for modifier in obj.modifiers] == ["DECIMATE"]
    assert len(obj.data.polygons) == 2304
    assert abs(len(evaluated_triangles(obj).faces) - left) <= 2
    assert alpha_key(obj).value == 0.5


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
    with pytest.raises(MeshError, match="edit mode"):
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


def test_made_final_it_is_a_plain_mesh_in_the_same_shape(scene, torus):
    obj = add_reconstruction(torus(simplifier="decimate", reduction=0.75, alpha=0.7), scene)
    before, material = evaluated_triangles(obj), obj.data.materials[0]
    apply_shape_and_modifiers(obj)
    after = evaluated_triangles(obj)
    assert obj.data.shape_keys is None
    assert not obj.modifiers
    assert obj.data.materials[0] == material
    assert len(obj.data.polygons) == len(before.faces)
    assert (after.faces == before.faces).all()
    assert np.abs(after.vertices - before.vertices).max() <= 1e-4
    assert len(bpy.data.meshes) == 1


def test_larger_polygons_are_read_as_triangles(scene):
    mesh = bpy.data.meshes.new("square")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [], [(0, 1, 2, 3)])
    obj = bpy.data.objects.new("square", mesh)
    scene.collection.objects.link(obj)
    seen = evaluated_triangles(obj)
    assert len(seen.faces) == 2
    assert seen.area == pytest.approx(100.0**2)


def test_a_surface_that_nobody_changed_comes_back_bit_for_bit(scene, torus):
    for alpha in (0.0, 0.3, 1.0):
        result = torus(alpha=alpha)
        seen = evaluated_triangles(add_reconstruction(result, scene, scale=0.0137))
        assert (seen.vertices == result.mesh.vertices).all()
        assert (seen.normals == result.mesh.normals).all()


def test_applied_it_keeps_its_millimeters(scene, torus):
    result = torus(alpha=0.3)
    obj = add_reconstruction(result, scene)
    apply_shape_and_modifiers(obj)
    assert (evaluated_triangles(obj).vertices == result.mesh.vertices).all()


def test_a_vertex_moved_by_hand_is_read_where_it_is_and_the_others_where_they_were(scene, torus):
    result = torus(alpha=1.0, reduction=0.5)
    obj = add_reconstruction(result, scene)
    obj.data.vertices[7].co.z += 0.02
    seen = evaluated_triangles(obj)
    expected = result.mesh.vertices.astype(np.float64)
    expected[7, 2] += 2.0
    assert np.abs(seen.vertices - expected).max() <= 1e-4
    others = np.arange(len(expected)) != 7
    assert (seen.vertices[others] == result.mesh.vertices[others]).all()


def test_temporary_surfaces_leave_nothing(scene, torus):
    kinds = ("scenes", "objects", "meshes", "materials", "shape_keys")
    before = [len(getattr(bpy.data, kind)) for kind in kinds]
    with temporary_surfaces([torus(), torus(reduction=0.5)]) as (own_scene, objects):
        assert [obj.name for obj in own_scene.objects] == [obj.name for obj in objects]
    assert [len(getattr(bpy.data, kind)) for kind in kinds] == before


def apply_transforms(obj, **kinds):
    """Blender's Apply, as Ctrl-A does it."""
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    which = {"location": True, "rotation": True, "scale": True, **kinds}
    assert bpy.ops.object.transform_apply(**which) == {"FINISHED"}


def test_applied_transforms_leave_the_millimeters_and_an_update_its_place(scene, torus):
    obj = add_reconstruction(torus(alpha=0.3), scene)
    apply_transforms(obj)
    assert tuple(obj.location) == (0.0, 0.0, 0.0)
    for rings in (48, 30):
        result = torus(alpha=0.3, rings=rings)
        update_reconstruction(obj, result)
        for mesh in (evaluated_triangles(obj), own_mesh(obj), as_shown(obj).mesh, read_back(obj).mesh):
            assert np.abs(mesh.vertices.astype(np.float64) - result.mesh.vertices).max() <= 1e-4


@pytest.mark.parametrize("settings", [{}, {"reduction": 0.5}])
def test_applied_transforms_alone_change_nothing_that_is_read(scene, torus, settings):
    result = torus(alpha=0.3, **settings)
    obj = add_reconstruction(result, scene)
    apply_transforms(obj)
    for mesh in (evaluated_triangles(obj), own_mesh(obj), as_shown(obj).mesh, read_back(obj).mesh):
        assert (mesh.vertices == result.mesh.vertices).all()


@pytest.mark.parametrize("size", [(2.0, 2.0, 2.0), (1.0, 2.0, 0.5), (-1.0, 1.0, 1.0)])
def test_a_turned_and_scaled_surface_is_the_same_before_and_after_apply(scene, torus, size):
    obj = add_reconstruction(torus(alpha=0.3), scene)
    obj.location.x += 1.0
    obj.rotation_euler = (0.3, -0.4, 0.5)
    obj.scale = size
    before = evaluated_triangles(obj)
    apply_transforms(obj)
    obj.data.shape_keys.reference_key.points[7].co.z += 1.0  # a hand of no weight
    after = evaluated_triangles(obj)
    others = np.arange(len(before.vertices)) != 7
    # Applying a mirrored scale, Blender 5.0 turns the triangles outward again; 5.2 leaves them as they were.
    assert (np.sort(after.faces, axis=1) == np.sort(before.faces, axis=1)).all()
    assert (after.faces == before.faces).all() or (size[0] < 0 and bpy.app.version >= (5, 1, 0))
    assert np.abs(after.vertices - before.vertices)[others].max() <= 1e-3
    result = torus(alpha=0.3, rings=30)
    update_reconstruction(obj, result)
    assert np.abs(as_shown(obj).mesh.vertices - result.mesh.vertices).max() <= 1e-4
    moved = evaluated_triangles(obj)

    assert moved.volume == pytest.approx(result.mesh.volume * abs(np.prod(size)), rel=1e-4)
    assert (moved.normals * result.mesh.normals).sum(axis=1).min() < 0.99


def test_another_origin_leaves_the_millimeters(scene, torus):
    obj = add_reconstruction(torus(alpha=0.3, reduction=0.5), scene)
    obj.data.vertices[7].co.z += 1.0  # the box has another middle
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    assert bpy.ops.object.origin_set(type="ORIGIN_GEOMETRY", center="BOUNDS") == {"FINISHED"}
    result = torus(alpha=0.3, rings=30)
    update_reconstruction(obj, result)
    assert worst_mm(obj, result.mesh) <= 1e-4


def test_vertices_all_moved_by_hand_stay_where_they_are_read(scene, torus):
    obj = add_reconstruction(torus(alpha=0.3, reduction=0.5), scene)
    before = evaluated_triangles(obj).vertices.astype(np.float64)
    local = np.array([vertex.co[:] for vertex in obj.data.vertices], np.float32)
    local += 0.01 * np.sin(40 * local)
    obj.data.vertices.foreach_set("co", local.ravel())
    seen = own_mesh(obj).vertices
    expected = (local.astype(np.float64) + obj.location) * 100
    assert np.abs(seen - expected).max() <= 1e-3
    assert np.abs(seen - before).max() > 0.5


def test_a_face_says_which_label_lies_behind_it_and_both_sides_of_a_wall_move_alike(scene):
    values = np.zeros((10, 12, 14), np.uint8)
    values[2:8, 2:10, 2:7], values[2:8, 2:10, 7:12] = 1, 2
    volume = Volume(values, np.diag([1.0, 1.0, 2.0, 1.0]), kind="label")
    results = reconstruct_labels(volume, ReconstructionSettings()).surfaces
    objects = [add_reconstruction(result, scene) for result in results]
    walls = []
    for obj, result in zip(objects, results, strict=True):
        neighbor = np.empty(len(obj.data.polygons), np.int32)
        obj.data.attributes["neighbor_label"].data.foreach_get("value", neighbor)
        assert neighbor.tolist() == result.beyond.tolist()
        alpha_key(obj).value = 0.3
        mesh = evaluated_triangles(obj)
        wall = mesh.vertices[mesh.faces[neighbor == 3 - result.settings.label]]
        walls.append({tuple(map(tuple, triangle)) for triangle in np.round(wall, 4).tolist()})
    turned = {(triangle[0], triangle[2], triangle[1]) for triangle in walls[1]}
    rolled = {roll for a, b, c in turned for roll in ((a, b, c), (b, c, a), (c, a, b))}
    assert len(walls[0]) == results[0].neighbors[0].triangles > 20
    assert walls[0] <= rolled
