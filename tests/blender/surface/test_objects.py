# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects made from reconstructions."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from surface_objects import alpha_key, worst_mm

from ctmc_addon.blender.surface import add_reconstruction, call, evaluated_triangles
from ctmc_addon.core.errors import MeshError
from ctmc_addon.core.mesh.triangle_mesh import TriangleMesh


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
