# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces written piece by piece: the bytes of the whole, and nothing left behind."""

import numpy as np
import pytest
from meshes import pieces_of
from shapes import distance_mm

from ctmc_addon.core import finish, marching_cubes
from ctmc_addon.core.errors import MeshError, OutputError
from ctmc_addon.core.files.piece_files import write_pieces_steps
from ctmc_addon.core.mesh.triangle_mesh import SurfacePiece, TriangleMesh


def ball(normals):
    values = -distance_mm((40, 36, 38), (18.2, 17.7, 19.1)).astype(np.float32)
    mesh = marching_cubes(values, -14.0, normals=normals)
    order = np.argsort(mesh.vertices[:, 2].astype(int) // 5, kind="stable")  # vertices as the pieces have them
    place = np.empty(len(order), np.int32)
    place[order] = np.arange(len(order))
    faces = place[mesh.faces]
    return TriangleMesh(mesh.vertices[order], faces, None if mesh.normals is None else mesh.normals[order])


@pytest.mark.parametrize("space", ["ras", "lps"])
@pytest.mark.parametrize("suffix", [".stl", ".ply", ".PLY"])
@pytest.mark.parametrize("normals", [True, False])
@pytest.mark.parametrize("count", [1, 2, 7])
def test_the_bytes_are_those_of_the_whole_mesh(count, normals, suffix, space, tmp_path):
    pieces = list(pieces_of(ball(normals), count))
    vertices = np.concatenate([piece.vertices for piece in pieces])
    firsts = np.cumsum([0] + [len(piece.vertices) for piece in pieces])
    faces = np.concatenate([piece.faces + np.int32(first) for piece, first in zip(pieces, firsts, strict=False)])
    whole_normals = np.concatenate([piece.normals for piece in pieces]) if normals else None
    TriangleMesh(vertices, faces, whole_normals).save(tmp_path / f"whole{suffix}", space)

    written = finish(write_pieces_steps(tmp_path / f"pieces{suffix}", stream(pieces), space))
    assert (tmp_path / f"pieces{suffix}").read_bytes() == (tmp_path / f"whole{suffix}").read_bytes()
    assert (written.vertices, written.faces, written.info) == (len(vertices), len(faces), "info")


def stream(pieces):
    yield from pieces
    return "info"


@pytest.mark.parametrize("suffix", [".stl", ".ply"])
def test_nothing_is_left_where_the_maker_fails_or_the_work_is_closed(suffix, tmp_path):
    def failing():
        yield from list(pieces_of(ball(False), 5))[:3]
        raise MeshError("no more")

    with pytest.raises(MeshError, match="no more"):
        finish(write_pieces_steps(tmp_path / f"a{suffix}", failing()))
    steps = write_pieces_steps(tmp_path / f"b{suffix}", stream(list(pieces_of(ball(False), 5))))
    next(steps)
    steps.close()
    assert list(tmp_path.iterdir()) == []


def test_refusals_say_what_is_wrong(tmp_path):
    with pytest.raises(OutputError, match="neither"):
        finish(write_pieces_steps(tmp_path / "a.obj", stream([])))
    with pytest.raises(MeshError, match="no surface"):
        finish(write_pieces_steps(tmp_path / "a.stl", stream([])))
    piece = SurfacePiece(np.zeros((1, 3), np.float32), np.array([[0, 1, 2]], np.int32))
    with pytest.raises(MeshError, match="in order"):
        finish(write_pieces_steps(tmp_path / "a.stl", stream([piece])))
