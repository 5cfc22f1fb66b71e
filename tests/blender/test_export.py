# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that leave Blender: where their vertices are, what else is in them, and what happens to a full disk."""

from __future__ import annotations

import hashlib
import json
import os
import struct
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.export import export
from ctmc_addon.blender.surface import (
    add_reconstruction,
    apply_shape_and_modifiers,
    evaluated_triangles,
    mesh_data as meshes,
    update_reconstruction,
)
from ctmc_addon.core import files_of
from ctmc_addon.core.errors import MeshError, OutputError
from ctmc_addon.core.files.mesh_files import SURFACE_SUFFIXES as SUFFIXES
from ctmc_addon.core.mesh.triangle_mesh import TriangleMesh

MESHES = tuple(suffix for suffix in SUFFIXES if suffix != ".blend")
SAME_EVERYWHERE = {".stl": "bcea56fe4149", ".ply": "60c6984c00ca", ".obj": "618aab3e3e80", ".glb": "6fb6e0652fed"}


@pytest.fixture
def obj(scene, torus):
    return add_reconstruction(torus(alpha=0.7, name="leber ü"), scene)


def read_stl(path):
    """Corners (F, 3, 3) and normals (F, 3) of a binary STL."""
    raw = path.read_bytes()
    (count,) = struct.unpack_from("<I", raw, 80)
    assert len(raw) == 84 + 50 * count
    rows = np.frombuffer(raw, [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")], count, 84)
    return rows["v"], rows["n"]


def read_ply(path):
    """Vertices (V, 3), faces (F, 3) and normals (V, 3) of a binary PLY."""
    head, raw = path.read_bytes().split(b"end_header\n", 1)
    words = [line.split() for line in head.decode().splitlines()]
    vertices, faces = (int(line[2]) for line in words if line[0] == "element")
    names = [line[2] for line in words if line[0] == "property" and line[1] == "float"]
    assert names == ["x", "y", "z", "nx", "ny", "nz"]
    points = np.frombuffer(raw, "<f4", 6 * vertices).reshape(-1, 6)
    rows = np.frombuffer(raw, [("n", "u1"), ("v", "<i4", 3)], faces, points.nbytes)
    assert (rows["n"] == 3).all()
    return points[:, :3], rows["v"], points[:, 3:]


def read_obj(path):
    """Vertices (V, 3) and faces (F, 3) of an OBJ."""
    lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
    points = np.array([line[1:] for line in lines if line[0] == "v"], np.float64)
    faces = np.array([[corner.partition("/")[0] for corner in line[1:]] for line in lines if line[0] == "f"], int)
    return points, faces - 1, None


def read_glb(path):
    """The JSON of a GLB, and its accessors as arrays."""
    raw = path.read_bytes()
    assert struct.unpack_from("<4sII", raw) == (b"glTF", 2, len(raw))
    (length,) = struct.unpack_from("<I", raw, 12)
    tree, binary = json.loads(raw[20 : 20 + length]), raw[28 + length :]
    kinds = {5126: ("<f4", 4), 5123: ("<u2", 2), 5125: ("<u4", 4)}
    arrays = []
    for accessor in tree["accessors"]:
        kind, _ = kinds[accessor["componentType"]]
        width = {"SCALAR": 1, "VEC3": 3}[accessor["type"]]
        start = tree["bufferViews"][accessor["bufferView"]]["byteOffset"]
        arrays.append(np.frombuffer(binary, kind, accessor["count"] * width, start).reshape(-1, width))
    return tree, arrays


def test_an_stl_holds_the_evaluated_surface_in_ras_millimeters(obj, torus, tmp_path):
    export(obj, tmp_path / "a.stl")
    corners, normals = read_stl(tmp_path / "a.stl")
    mesh = torus(alpha=0.7).mesh
    assert np.abs(corners - mesh.vertices[mesh.faces].astype(np.float64)).max() <= 1e-4
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((outward * normals).sum(axis=1) > 0).all()
    assert len(np.unique(corners.reshape(-1, 3), axis=0)) == len(mesh.vertices)


def test_ply_and_obj_keep_vertices_and_faces(obj, torus, tmp_path):
    mesh = torus(alpha=0.7).mesh
    for read, name, tolerance in ((read_ply, "a.ply", 1e-4), (read_obj, "a.obj", 1e-4)):
        export(obj, tmp_path / name)
        points, faces, _ = read(tmp_path / name)
        assert (faces == mesh.faces).all()
        assert np.abs(points - mesh.vertices.astype(np.float64)).max() <= tolerance


def test_lps_turns_x_and_y_round_and_nothing_inside_out(obj, torus, tmp_path):
    export(obj, tmp_path / "a.stl", space="lps")
    corners, _ = read_stl(tmp_path / "a.stl")
    mesh = torus(alpha=0.7).mesh
    assert np.abs(corners - mesh.vertices[mesh.faces].astype(np.float64) * (-1, -1, 1)).max() <= 1e-4
    center = corners.reshape(-1, 3).mean(axis=0)
    assert ((corners[:, 0] - center) * np.cross(corners[:, 1] - center, corners[:, 2] - center)).sum() > 0


def test_a_mirrored_object_is_not_exported_inside_out(obj, tmp_path):
    obj.scale.x = -1.0
    export(obj, tmp_path / "a.stl")
    corners = read_stl(tmp_path / "a.stl")[0].astype(np.float64)
    center = corners.reshape(-1, 3).mean(axis=0)
    corners -= center
    assert (corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum() > 0


def test_a_glb_is_in_metres_with_y_up_and_no_morph_target(obj, torus, tmp_path):
    export(obj, tmp_path / "a.glb")
    tree, arrays = read_glb(tmp_path / "a.glb")
    (primitive,) = tree["meshes"][0]["primitives"]
    assert "targets" not in primitive
    assert "animations" not in tree
    mesh = torus(alpha=0.7).mesh
    points = arrays[primitive["attributes"]["POSITION"]].astype(np.float64)
    corners = points[arrays[primitive["indices"]].ravel()] * 1000
    expected = mesh.vertices[mesh.faces].reshape(-1, 3)[:, (0, 2, 1)] * (1, 1, -1)
    assert np.abs(corners - expected).max() <= 2e-4
    (node,) = tree["nodes"]
    assert node["name"] == "leber ü"
    assert not {"translation", "rotation", "scale", "matrix"} & set(node)
    normals = arrays[primitive["attributes"]["NORMAL"]][arrays[primitive["indices"]].ravel()]
    gradient = torus().surface.normals[mesh.faces].reshape(-1, 3)[:, (0, 2, 1)] * (1, 1, -1)
    assert (normals * gradient).sum(axis=1).min() > np.cos(np.radians(0.5))


def test_a_glb_shares_its_vertices(obj, torus, tmp_path):
    export(obj, tmp_path / "a.glb")
    tree, arrays = read_glb(tmp_path / "a.glb")
    assert len(arrays[tree["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]) == len(torus().mesh.vertices)


@pytest.mark.parametrize("suffix", MESHES)
def test_the_same_surface_gives_the_same_bytes(torus, tmp_path, suffix):
    for run in "ab":
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        (tmp_path / run).mkdir()
        export(add_reconstruction(torus(), bpy.context.scene), tmp_path / run / f"x{suffix}")
    for file in files_of(tmp_path / "a" / f"x{suffix}"):
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes()


@pytest.mark.parametrize("suffix", SAME_EVERYWHERE)
def test_every_blender_gives_the_same_bytes(torus, scene, tmp_path, suffix):
    # On whole numbers, so that no other machine's sine can differ in the last digit.
    result = torus(normals="mesh", alpha=1.0)
    rounded = TriangleMesh(np.round(result.mesh.vertices), result.mesh.faces)
    export(add_reconstruction(replace(result, mesh=rounded, surface=None), scene), tmp_path / f"a{suffix}")
    content = (tmp_path / f"a{suffix}").read_bytes()
    assert hashlib.sha256(content).hexdigest()[:12] == SAME_EVERYWHERE[suffix]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_nothing_in_the_file_tells_of_folders(obj, tmp_path, suffix):
    bpy.context.scene.render.filepath = str(tmp_path / "render")
    export(obj, tmp_path / f"a{suffix}")
    written = (tmp_path / f"a{suffix}").read_bytes()
    for secret in (str(tmp_path), os.path.expanduser("~") + "/", ".ctmc-"):  # noqa: PTH111
        assert secret.encode() not in written
    assert {path.name for path in tmp_path.iterdir()} == {file.name for file in files_of(tmp_path / f"a{suffix}")}


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_export_leaves_the_file_as_it_was(obj, scene, tmp_path, suffix):
    names = ("scenes", "objects", "meshes", "materials", "worlds", "cameras", "lights", "collections", "shape_keys")

    def state():
        blocks = {name: sorted(block.name for block in getattr(bpy.data, name)) for name in names}
        key = obj.data.shape_keys.key_blocks["alpha"].value
        return blocks, obj.name, tuple(obj.location), key, scene.camera, scene.render.engine, bpy.context.scene

    before = state()
    export(obj, tmp_path / f"a{suffix}")
    assert state() == before


def test_a_blend_opens_with_object_material_and_camera(obj, tmp_path):
    before = evaluated_triangles(obj)
    stranger = bpy.data.objects.new("stranger", None)
    bpy.context.scene.collection.objects.link(stranger)
    export(obj, tmp_path / "tumour ü.blend")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "tumour ü.blend"))
    scene = bpy.context.scene
    assert len(bpy.data.scenes) == 1
    assert sorted(one.name for one in scene.objects) == [
        "CTMC Fill Light",
        "CTMC Key",
        "CTMC Rim",
        "CTMC Studio Camera",
        "leber ü",
    ]
    assert scene.camera.name == "CTMC Studio Camera"
    assert [folder.name for folder in scene.collection.children] == ["CTMC Studio"]
    assert not bpy.data.libraries
    # Blender's rulers show the torus's 80 mm.
    meters = scene.objects["leber ü"].dimensions.x * scene.unit_settings.scale_length
    assert meters == pytest.approx(0.08, rel=0.02)
    opened = bpy.context.view_layer.objects.active
    assert opened.name == "leber ü"
    assert opened.data.materials[0].name == "leber ü"
    assert opened.data.shape_keys.key_blocks["alpha"].value == pytest.approx(0.7)
    assert (evaluated_triangles(opened).vertices == before.vertices).all()


def test_the_camera_of_a_blend_sees_the_whole_surface(obj, tmp_path):
    from bpy_extras.object_utils import world_to_camera_view

    export(obj, tmp_path / "a.blend")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    scene = bpy.context.scene
    surface, camera = scene.objects["leber ü"], scene.camera
    seen = np.array(
        [world_to_camera_view(scene, camera, surface.matrix_world @ vertex.co)[:] for vertex in surface.data.vertices]
    )
    assert (seen[:, :2] > 0.02).all()
    assert (seen[:, :2] < 0.98).all()
    assert max(np.ptp(seen[:, 0]), np.ptp(seen[:, 1])) > 0.8
    assert seen[:, 2].min() > camera.data.clip_start
    assert seen[:, 2].max() < camera.data.clip_end


def test_an_unknown_suffix_names_the_known_ones(obj, tmp_path):
    with pytest.raises(OutputError, match=r"a\.xyz.*\.stl, \.ply, \.obj, \.glb, \.3mf, \.html, \.blend"):
        export(obj, tmp_path / "a.xyz")
    with pytest.raises(OutputError, match=r"^an empty name has no known suffix"):
        export(obj, "")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_missing_folder_is_said(obj, tmp_path, suffix):
    with pytest.raises(OutputError, match="does not exist"):
        export(obj, tmp_path / "nowhere" / f"a{suffix}")


def test_a_file_in_place_of_the_folder_is_said(obj, tmp_path):
    (tmp_path / "folder").write_bytes(b"")
    with pytest.raises(OutputError, match="the folder is a file"):
        export(obj, tmp_path / "folder" / "a.stl")


def test_a_folder_in_the_way_is_said_and_nothing_left(obj, tmp_path):
    (tmp_path / "a.stl").mkdir()
    with pytest.raises(OutputError, match=r"a\.stl"):
        export(obj, tmp_path / "a.stl")
    assert [path.name for path in tmp_path.iterdir()] == ["a.stl"]


@contextmanager
def disk_that_takes(size):
    """Files may grow to `size` bytes: writing more fails as on a full disk."""
    resource = pytest.importorskip("resource", reason="only Unix limits the size of files")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("size", [0, 10_000])
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_full_disk_leaves_the_older_file_and_nothing_half_written(obj, tmp_path, suffix, size):
    target = tmp_path / f"a{suffix}"
    target.write_bytes(b"older")
    with disk_that_takes(size), pytest.raises(OutputError, match=target.name):
        export(obj, target)
    assert [path.name for path in tmp_path.iterdir()] == [target.name]
    assert target.read_bytes() == b"older"
    assert obj.name == "leber ü"
    assert len(bpy.data.scenes) == 1


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_surface_in_edit_mode_is_refused_before_anything_is_written(obj, tmp_path, suffix):
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(MeshError, match="Edit Mode; leave it first"):
        export(obj, tmp_path / f"surface{suffix}")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".stl", ".ply"])
@pytest.mark.parametrize("space", ["ras", "lps"])
@pytest.mark.parametrize(
    ("settings", "scale"),
    [({"alpha": 0.3}, 0.01), ({"alpha": 1.0}, 0.001), ({"normals": "mesh"}, 0.0137), ({"reduction": 0.6}, 1.0)],
)
def test_an_object_is_exported_to_the_bytes_that_the_surface_has_without_blender(
    ball, scene, tmp_path, suffix, space, settings, scale
):
    result = ball(**settings)
    export(add_reconstruction(result, scene, scale), tmp_path / f"panel{suffix}", space)
    result.mesh.save(tmp_path / f"command{suffix}", space)
    assert (tmp_path / f"panel{suffix}").read_bytes() == (tmp_path / f"command{suffix}").read_bytes()


def test_an_updated_and_then_applied_object_is_exported_to_the_same_bytes_too(ball, scene, tmp_path):
    obj, result = add_reconstruction(ball(alpha=1.0), scene), ball(alpha=0.3, stride=(2, 2, 1))
    update_reconstruction(obj, result)
    obj.data.shape_keys.key_blocks["alpha"].value = 0.3
    result.mesh.save(tmp_path / "command.ply")
    export(obj, tmp_path / "updated.ply")
    apply_shape_and_modifiers(obj)
    export(obj, tmp_path / "applied.ply")
    contents = {path.read_bytes() for path in tmp_path.iterdir()}
    assert len(contents) == 1


def test_a_surface_moved_by_hand_is_exported_where_it_is(obj, tmp_path):
    mesh = evaluated_triangles(obj)
    obj.location.x += 0.5
    obj.rotation_euler.z = np.pi / 2
    export(obj, tmp_path / "a.ply")
    points, _, normals = read_ply(tmp_path / "a.ply")
    center = np.array(obj.location) / 0.01
    local = mesh.vertices - (center - [50, 0, 0])
    expected = np.column_stack([-local[:, 1], local[:, 0], local[:, 2]]) + center
    assert np.abs(points - expected).max() <= 2e-4
    turned = np.column_stack([-mesh.normals[:, 1], mesh.normals[:, 0], mesh.normals[:, 2]])
    assert np.abs(normals - turned).max() <= 1e-6


def test_a_modifier_is_exported_with_normals_of_its_own(obj, tmp_path):
    modifier = obj.modifiers.new("Decimate", "DECIMATE")
    modifier.ratio = 0.25
    export(obj, tmp_path / "a.ply")
    points, faces, normals = read_ply(tmp_path / "a.ply")
    assert abs(len(faces) - 2304 / 4) <= 2
    assert np.abs(np.sqrt((normals**2).sum(axis=1)) - 1).max() <= 1e-5
    outward = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
    assert ((outward * normals[faces].sum(axis=1)).sum(axis=1) > 0).mean() > 0.99


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_export_never_renames_or_writes_into_the_object(obj, tmp_path, suffix, monkeypatch):
    names, written = [], []
    bpy.app.handlers.depsgraph_update_pre.append(lambda *_: names.append(obj.name))
    monkeypatch.setattr(meshes, "encode_normals", lambda mesh, *_: written.append(mesh.as_pointer()))
    pointer = obj.data.as_pointer()
    export(obj, tmp_path / f"a{suffix}")
    bpy.app.handlers.depsgraph_update_pre.clear()
    assert set(names) <= {"leber ü"}
    assert pointer not in written


def test_obj_and_glb_have_the_objects_name(obj, tmp_path):
    obj.name = "left lung"
    export(obj, tmp_path / "a.obj")
    assert b"\no left_lung\n" in (tmp_path / "a.obj").read_bytes()
    export(obj, tmp_path / "a.glb")
    assert [node["name"] for node in read_glb(tmp_path / "a.glb")[0]["nodes"]] == ["left lung"]


def test_an_update_after_apply_is_written_where_the_patient_has_it(scene, torus, tmp_path):
    obj = add_reconstruction(torus(alpha=0.3), scene)
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    bpy.ops.object.transform_apply(location=True, rotation=True, scale=True)
    result = torus(alpha=0.3, rings=30)
    update_reconstruction(obj, result)
    export(obj, tmp_path / "applied.stl")
    export(add_reconstruction(result, scene), tmp_path / "new.stl")
    (written, _), (expected, _) = (read_stl(tmp_path / name) for name in ("applied.stl", "new.stl"))
    assert np.abs(written.astype(np.float64) - expected).max() <= 1e-4
