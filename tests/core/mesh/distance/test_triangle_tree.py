# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances to a surface against closed forms and against every triangle in turn."""

import numpy as np
import pytest
from oracles.solids import to_triangle

from ctmc_addon.core import TriangleMesh, distances, finish
from ctmc_addon.core.errors import MeshError
from ctmc_addon.core.mesh.distance import triangle_tree
from ctmc_addon.core.mesh.distance.triangle_tree import BLOCK, BRANCH, TriangleTree


def soup(count, seed):
    """Triangles of very different sizes and shapes, needles and points among them."""
    draw = np.random.default_rng(seed)
    corners = draw.normal(size=(count, 1, 3)) * 5 + draw.normal(size=(count, 3, 3)) * draw.exponential(1, (count, 1, 1))
    corners[::7, 2] = corners[::7, 1]  # edges
    corners[::11, 1:] = corners[::11, :1]  # points
    return TriangleMesh(corners.reshape(-1, 3).astype(np.float32), np.arange(3 * count, dtype=np.int32).reshape(-1, 3))


@pytest.mark.parametrize("count", [1, 2, BRANCH, BRANCH + 1, 150])
def test_the_tree_finds_what_looking_at_every_triangle_finds(count):
    mesh = soup(count, count)
    points = np.random.default_rng(9).normal(size=(40, 3)) * 6
    corners = mesh.vertices[mesh.faces].astype(float)
    expected = [min(to_triangle(point, *triangle) for triangle in corners) for point in points]
    assert distances(points, mesh) == pytest.approx(expected, abs=1e-9)


def test_more_points_than_go_down_the_tree_at_once_keep_their_order():
    mesh = soup(50, 3)
    points = np.random.default_rng(4).normal(size=(2 * BLOCK + 5, 3)) * 6
    together = distances(points, mesh)
    assert np.array_equal(together[::97], [distances(point, mesh)[0] for point in points[::97]])


def test_a_limit_leaves_out_what_is_farther_and_changes_nothing_else():
    tree = TriangleTree(soup(200, 5))
    points = np.random.default_rng(6).normal(size=(500, 3)) * 6
    exact, limited = tree.distances(points), tree.distances(points, 1.0)
    assert np.array_equal(limited, np.where(exact <= 1.0, exact, np.inf))
    assert 0 < np.isfinite(limited).sum() < len(points)


def test_vertices_and_middles_of_faces_are_at_distance_zero():
    mesh = soup(300, 7)
    assert distances(mesh.vertices, mesh).max() < 1e-12
    assert distances(mesh.vertices[mesh.faces].astype(float).mean(axis=1), mesh).max() < 1e-6


def test_no_points_have_no_distances():
    assert distances(np.empty((0, 3)), soup(3, 0)).shape == (0,)


def test_a_mesh_without_triangles_is_refused():
    with pytest.raises(MeshError, match="without triangles"):
        distances(np.zeros((1, 3)), TriangleMesh(np.empty((0, 3), np.float32), np.empty((0, 3), np.int32)))


@pytest.mark.parametrize("pairs", [1, 64, 10_000])
def test_parting_the_points_of_a_block_changes_nothing(pairs, monkeypatch):
    mesh, points = soup(400, 2), np.random.default_rng(1).normal(size=(300, 3)) * 6
    whole = finish(TriangleTree(mesh).nearest_steps(points, threads=1))
    monkeypatch.setattr(triangle_tree, "MOST_PAIRS", pairs)
    parted = finish(TriangleTree(mesh).nearest_steps(points, threads=2))
    assert all(np.array_equal(*pair) for pair in zip(whole, parted, strict=True))


def test_far_points_find_what_looking_at_every_triangle_finds():
    mesh = soup(600, 8)
    points = np.random.default_rng(2).normal(size=(60, 3)) * 3000
    corners = mesh.vertices[mesh.faces].astype(float).transpose(1, 2, 0)
    expected = [np.sqrt(triangle_tree.squared_distances(point[:, None], *corners).min()) for point in points]
    assert np.array_equal(distances(points, mesh), expected)


def test_within_a_limit_are_all_triangles_that_are():
    mesh, points = soup(300, 4), np.random.default_rng(3).normal(size=(3, 20)) * 6
    tree = TriangleTree(mesh)
    found = set(zip(*(each.tolist() for each in tree.within(points, np.full(20, 4.0))), strict=True))
    squared = np.array([triangle_tree.squared_distances(each[:, None], *tree.corners) for each in points.T])
    assert {(int(point), int(triangle)) for point, triangle in zip(*np.nonzero(squared <= 4.0), strict=True)} <= found
