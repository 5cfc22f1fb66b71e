# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances to a surface against closed forms and against every triangle in turn."""

import numpy as np
import pytest

from ctmc_addon.core import TriangleMesh, distances
from ctmc_addon.core.errors import MeshError
from ctmc_addon.core.mesh.distance.triangle_tree import BLOCK, BRANCH, TriangleTree


def soup(count, seed):
    """Triangles of very different sizes and shapes, needles and points among them."""
    draw = np.random.default_rng(seed)
    corners = draw.normal(size=(count, 1, 3)) * 5 + draw.normal(size=(count, 3, 3)) * draw.exponential(1, (count, 1, 1))
    corners[::7, 2] = corners[::7, 1]  # edges
    corners[::11, 1:] = corners[::11, :1]  # points
    return TriangleMesh(corners.reshape(-1, 3).astype(np.float32), np.arange(3 * count, dtype=np.int32).reshape(-1, 3))


def distance_to_triangle(point, a, b, c):
    """After Ericson, Real-Time Collision Detection, 5.1.5, by regions; degenerate triangles by their edges."""
    best = min(distance_to_edge(point, *edge) for edge in ((a, b), (b, c), (c, a)))
    normal = np.cross(b - a, c - a)
    if np.dot(normal, normal) > 0:
        foot = point - normal * np.dot(point - a, normal) / np.dot(normal, normal)
        if all(np.dot(np.cross(q - p, foot - p), normal) >= 0 for p, q in ((a, b), (b, c), (c, a))):
            best = min(best, np.linalg.norm(point - foot))
    return best


def distance_to_edge(point, a, b):
    along = b - a
    share = np.clip(np.dot(point - a, along) / max(np.dot(along, along), 1e-300), 0, 1)
    return np.linalg.norm(point - a - share * along)


@pytest.mark.parametrize("count", [1, 2, BRANCH, BRANCH + 1, 150])
def test_the_tree_finds_what_looking_at_every_triangle_finds(count):
    mesh = soup(count, count)
    points = np.random.default_rng(9).normal(size=(40, 3)) * 6
    corners = mesh.vertices[mesh.faces].astype(float)
    expected = [min(distance_to_triangle(point, *triangle) for triangle in corners) for point in points]
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
