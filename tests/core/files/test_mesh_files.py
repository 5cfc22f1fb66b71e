# SPDX-License-Identifier: GPL-3.0-or-later
"""STL and PLY as bytes: what is in them, in which axes, and that nothing half-written is left."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from meshes import read_ply

from ctmc_addon.core.errors import OutputError
from ctmc_addon.core.files import mesh_files
from ctmc_addon.core.mesh.triangle_mesh import TriangleMesh


@pytest.fixture
def tetrahedron():
    """The corner of a cube of 2 mm, its faces pointing outwards."""
    vertices = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2]], np.float32)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
    mesh = TriangleMesh(vertices, faces)
    assert mesh.volume == pytest.approx(8 / 6)
    return mesh


def read_stl(path):
    raw = path.read_bytes()
    (count,) = struct.unpack_from("<I", raw, 80)
    rows = np.frombuffer(raw, [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")], count, 84)
    assert len(raw) == 84 + 50 * count
    assert not raw.startswith(b"solid")  # as a text STL begins
    return rows["corners"], rows["normal"]


def test_an_stl_has_every_facet_with_its_outward_normal(tetrahedron, tmp_path):
    tetrahedron.save(tmp_path / "a.stl")
    corners, normals = read_stl(tmp_path / "a.stl")
    assert (corners == tetrahedron.vertices[tetrahedron.faces]).all()
    expected = [[0, 0, -1], [0, -1, 0], [-1, 0, 0], [3**-0.5] * 3]
    assert np.abs(normals - expected).max() < 1e-7


def test_a_triangle_without_area_has_no_normal(tmp_path):
    TriangleMesh(np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.int32)).save(tmp_path / "a.stl")
    assert (read_stl(tmp_path / "a.stl")[1] == 0).all()


def test_a_ply_has_vertices_faces_and_the_surfaces_own_normals(tetrahedron, tmp_path):
    normals = np.tile(np.array([0, 0.6, 0.8], np.float32), (4, 1))
    TriangleMesh(tetrahedron.vertices, tetrahedron.faces, normals).save(tmp_path / "a.ply")
    points, written, faces = read_ply(tmp_path / "a.ply")
    assert (points == tetrahedron.vertices).all()
    assert (faces == tetrahedron.faces).all()
    assert (written == normals).all()


def test_a_ply_without_normals_gets_the_mean_of_its_faces(tetrahedron, tmp_path):
    tetrahedron.save(tmp_path / "a.ply")
    assert np.abs(read_ply(tmp_path / "a.ply")[1][0] - [-(3**-0.5)] * 3).max() < 1e-7


@pytest.mark.parametrize(("suffix", "read"), [(".stl", read_stl), (".ply", read_ply)])
def test_lps_turns_x_and_y_and_nothing_inside_out(tetrahedron, tmp_path, suffix, read):
    for space in mesh_files.SPACES:
        tetrahedron.save(tmp_path / f"{space}{suffix}", space)
    (ras, ras_normals, *_), (lps, lps_normals, *_) = (read(tmp_path / f"{space}{suffix}") for space in ("ras", "lps"))
    assert (lps == ras * [-1, -1, 1]).all()
    assert np.abs(lps_normals - ras_normals * [-1, -1, 1]).max() < 1e-7


@pytest.mark.parametrize("suffix", [".stl", ".ply"])
def test_the_bytes_do_not_depend_on_how_many_are_written_at_once(tetrahedron, tmp_path, suffix, monkeypatch):
    tetrahedron.save(tmp_path / f"a{suffix}")
    monkeypatch.setattr(mesh_files, "ROWS_AT_ONCE", 3)
    tetrahedron.save(tmp_path / f"b{suffix}")
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_another_suffix_or_folder_is_refused_and_nothing_left(tetrahedron, tmp_path):
    for path in (tmp_path / "a.obj", tmp_path / "a", tmp_path / "nowhere" / "a.stl"):
        with pytest.raises(OutputError):
            tetrahedron.save(path)
    assert not list(tmp_path.iterdir())
