# SPDX-License-Identifier: GPL-3.0-or-later
import tracemalloc

import numpy as np
import pytest
from shapes import distance_mm

from ctmc_addon.core import ReconstructionSettings, Volume, reconstruct
from ctmc_addon.core.mesh import coarse, coarse_mesh
from ctmc_addon.core.mesh.triangle_mesh import TriangleMesh


@pytest.fixture(scope="module")
def ball():
    values = (20 - distance_mm((48, 48, 48))).astype(np.float32)
    return reconstruct(Volume(values, np.eye(4)), ReconstructionSettings(threshold=0)).mesh


@pytest.mark.parametrize("most", [200, 1000, 5000])
def test_a_coarse_ball_has_few_triangles_and_nearly_its_volume(ball, most):
    assert len(ball.faces) > 10_000
    coarse = coarse_mesh(ball, most)
    assert most / 5 < len(coarse.faces) <= most
    assert coarse.faces.max() < len(coarse.vertices)
    corners = coarse.vertices[coarse.faces].astype(float)  # (f, 3, 3)
    volume = np.linalg.det(corners - 0.0).sum() / 6
    assert (1 - 60 / most) * ball.volume < volume < ball.volume
    center = ball.vertices.mean(axis=0)
    radius = np.linalg.norm(coarse.vertices - center, axis=1)
    assert radius.max() < 20.1
    np.testing.assert_allclose(np.linalg.norm(coarse.normals, axis=1), 1, atol=1e-5)
    outwards = ((coarse.vertices - center) / radius[:, None] * coarse.normals).sum(axis=1)
    assert outwards.min() > 0.95


def test_a_mesh_that_is_small_enough_stays_and_one_point_is_no_picture(ball):
    assert coarse_mesh(ball, len(ball.faces)) is ball
    point = TriangleMesh(np.ones((3, 3), np.float32), np.array([[0, 1, 2]] * 5, np.int32))
    assert coarse_mesh(point, 2) is point


def test_a_large_mesh_is_taken_in_pieces_and_needs_less_memory_than_it_has(ball, monkeypatch):
    copies = np.arange(40, dtype=np.int32)[:, None, None]
    vertices = (ball.vertices + copies * np.float32(60)).reshape(-1, 3)
    large = TriangleMesh(vertices, (ball.faces + copies * np.int32(len(ball.vertices))).reshape(-1, 3))
    tracemalloc.start()
    in_pieces = coarse_mesh(large, 5000)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 64 * len(large.faces)
    monkeypatch.setattr(coarse, "PIECE", len(large.faces))
    at_once = coarse_mesh(large, 5000)
    assert (in_pieces.faces == at_once.faces).all()
    np.testing.assert_allclose(in_pieces.vertices, at_once.vertices, rtol=1e-6)
