# SPDX-License-Identifier: GPL-3.0-or-later
"""STL and PLY files of any form become the same triangles over shared vertices."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from ctmc_addon.core import ReadError, TriangleMesh, finish
from ctmc_addon.readers import read_surface_steps

VERTICES = np.array([[0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0], [1, 1, 4]], np.float32)
FACES = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]], np.int32)
PYRAMID = TriangleMesh(VERTICES, FACES)
SQUARE_FIRST = "4 0 3 2 1\n3 0 1 4\n3 1 2 4\n3 2 3 4\n3 3 0 4\n"
ASCII_HEAD = (
    "ply\nformat ascii 1.0\ncomment of a test\nelement vertex 5\nproperty uchar red\nproperty float x\n"
    "property double y\nproperty float z\nelement face 5\nproperty list uchar int vertex_indices\nend_header\n"
)
ASCII_VERTICES = "".join(f"7 {x:g} {y:g} {z:g}\n" for x, y, z in VERTICES)


def read(path):
    return finish(read_surface_steps(path))


def ascii_stl():
    lines = ["solid pyramid"]
    for face in FACES:
        corners = [f"vertex {x:g} {y:g} {z:g}" for x, y, z in VERTICES[face]]
        lines += ["facet normal 0 0 0", "outer loop", *corners, "endloop", "endfacet"]
    return "\n".join([*lines, "endsolid pyramid"]).encode()


def binary_ply(order):
    name = {"<": "little", ">": "big"}[order]
    head = ASCII_HEAD.replace("ascii", f"binary_{name}_endian").encode()
    body = b"".join(struct.pack(f"{order}Bfdf", 7, *vertex) for vertex in VERTICES)
    for line in SQUARE_FIRST.splitlines():
        count, *corners = map(int, line.split())
        body += struct.pack(f"{order}B{count}i", count, *corners)
    return head + body


@pytest.mark.parametrize("suffix", [".stl", ".ply"])
def test_what_is_written_is_read_again(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    PYRAMID.save(path)
    mesh = read(path)
    assert mesh.vertices.dtype == np.float32
    assert mesh.faces.dtype == np.int32
    assert len(mesh.vertices) == 5
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], VERTICES[FACES])
    assert mesh.volume == pytest.approx(8.0)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("ascii.stl", ascii_stl()),
        ("ascii.ply", (ASCII_HEAD + ASCII_VERTICES + SQUARE_FIRST).encode()),
        ("windows.ply", (ASCII_HEAD + ASCII_VERTICES + SQUARE_FIRST).replace("\n", "\r\n").encode()),
        ("little.ply", binary_ply("<")),
        ("big.ply", binary_ply(">")),
    ],
)
def test_each_form_gives_the_same_pyramid(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    mesh = read(path)
    assert (len(mesh.vertices), len(mesh.faces)) == (5, 6)
    assert mesh.closed
    assert mesh.volume == pytest.approx(8.0)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.stl", b"solid x\nendsolid x\n", "a.stl has no triangles; give a surface"),
        ("a.stl", b"\0" * 100, "a.stl is damaged or not STL; write it again"),
        ("a.ply", binary_ply("<")[:-3], "a.ply is damaged or not PLY; write it again"),
        ("a.ply", b"ply\nformat ascii 1.0\n", "a.ply is damaged or not PLY; write it again"),
        ("a.ply", ASCII_HEAD.replace("format ascii 1.0\n", "").encode(), "a.ply is damaged or not PLY; write it again"),
        ("a.ply", ASCII_HEAD.replace("vertex 5", "vertex -5").encode(), "a.ply is damaged or not PLY; write it again"),
        (
            "a.ply",
            ASCII_HEAD.replace("element face", "element edge 3\nelement face").encode() + ASCII_VERTICES.encode(),
            "a.ply is damaged or not PLY; write it again",
        ),
        (
            "a.ply",
            ASCII_HEAD.replace("vertex_indices", "corners").encode() + (ASCII_VERTICES + SQUARE_FIRST).encode(),
            "a.ply is damaged or not PLY; write it again",
        ),
        (
            "a.ply",
            (ASCII_HEAD + ASCII_VERTICES.replace("4", "nan") + SQUARE_FIRST).encode(),
            "a.ply has positions that are not numbers; write it again",
        ),
        (
            "a.ply",
            (ASCII_HEAD + ASCII_VERTICES + SQUARE_FIRST.replace("4\n", "9\n")).encode(),
            "a.ply has faces of missing vertices; write it again",
        ),
    ],
)
def test_what_is_no_surface_is_refused(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ReadError) as error:
        read(path)
    assert str(error.value) == message


def test_polygons_that_alternate_are_all_read(tmp_path):
    count = 3000
    head = ASCII_HEAD.replace("element face 5", f"element face {2 * count}")
    path = tmp_path / "a.ply"
    path.write_text(head + ASCII_VERTICES + count * "4 0 3 2 1\n3 0 1 4\n", "ascii")
    mesh = read(path)
    assert len(mesh.faces) == 3 * count
    assert np.bincount(mesh.faces.ravel()).tolist() == [3 * count, 2 * count, 2 * count, count, count]


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(ReadError, match="cannot be read"):
        read(tmp_path / "nowhere.stl")
