# SPDX-License-Identifier: GPL-3.0-or-later
"""Signed distances and nearest pairs against closed forms and against every triangle in turn."""

import numpy as np
import pytest
from meshes import as_mesh, icosphere, joined, sheet, torus
from oracles.solids import between_triangles, to_triangle, winding_numbers

from ctmc_addon.core import TriangleMesh, finish
from ctmc_addon.core.mesh.distance.nearest_pair import nearest_pair_steps
from ctmc_addon.core.mesh.distance.signed_distance import SignedSurface

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
CUBE_FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def cube(side=1.0, corner=(0, 0, 0)):
    quads = np.array(CUBE_FACES)
    return as_mesh(CUBE * side + np.array(corner), np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]))


def rough(seed, levels=2, radius=5.0, center=(0, 0, 0)):
    """A star of sharp spikes and dents, closed and free of crossings."""
    ball = icosphere(levels)
    length = np.random.default_rng(seed).uniform(0.3, 1.0, len(ball.vertices))[:, None]
    return as_mesh(ball.vertices * length * radius + np.array(center), ball.faces)


def signed(mesh):
    surface = SignedSurface()
    finish(surface.prepare_steps(mesh))
    return surface


def distances(points, mesh, threads=1):
    return finish(signed(mesh).distances_steps(points, threads))[0]


def nearest_pair(mesh, other):
    surface = signed(other)
    first, second = finish(nearest_pair_steps(mesh, surface, *finish(surface.distances_steps(mesh.vertices))))
    return np.array(first), np.array(second)


def crowd(mesh, count, seed):
    """Points around a mesh, some beyond its vertices, where edges and vertices are nearest."""
    draw = np.random.default_rng(seed)
    low, high = mesh.vertices.min(0), mesh.vertices.max(0)
    near = mesh.vertices[draw.integers(len(mesh.vertices), size=count)] + draw.normal(size=(count, 3)) * 0.1
    return np.concatenate([draw.uniform(low - 1, high + 1, (count, 3)), near])


@pytest.mark.parametrize("mesh", [rough(1), rough(2), torus(12, 8), cube(3.0), joined(cube(), cube(2.0, (3, 0, 0)))])
def test_distance_and_sign_are_those_of_every_triangle_and_of_the_winding_number(mesh):
    points = crowd(mesh, 15, 5)
    corners = mesh.vertices[mesh.faces].astype(float)
    far = np.array([min(to_triangle(point, *triangle) for triangle in corners) for point in points])
    inside = winding_numbers(points, mesh) > 0.5
    assert 0 < inside.sum() < len(points)
    np.testing.assert_allclose(distances(points, mesh), np.where(inside, -far, far), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_the_sign_is_right_at_every_spike(seed):
    mesh = rough(seed)
    points = crowd(mesh, 1000, seed)
    assert np.array_equal(distances(points, mesh) < 0, winding_numbers(points, mesh) > 0.5)


def test_cubes_that_share_an_edge_and_a_vertex_have_the_right_sign_beside_them():
    # One edge of four triangles, one vertex of two fans.
    vertices = np.concatenate([cube().vertices, cube(1.0, (1, 1, 0)).vertices, cube(1.0, (2, 2, 1)).vertices])
    unique, number = np.unique(vertices, axis=0, return_inverse=True)
    faces = np.concatenate([cube().faces + 8 * at for at in range(3)])
    mesh = as_mesh(unique, number.reshape(-1)[faces])
    points = np.random.default_rng(0).uniform(-0.5, 3.5, (4000, 3))
    lows = np.array([[0, 0, 0], [1, 1, 0], [2, 2, 1]])
    inside = np.any([((points >= low) & (points <= low + 1)).all(1) for low in lows], 0)
    surface = signed(mesh)
    assert surface.closed
    assert np.array_equal(finish(surface.distances_steps(points))[0] < 0, inside)


def test_triangles_without_area_do_not_turn_the_sign():
    flat = cube(2.0)
    # The edge 0-4 gets a vertex in its middle and triangles without area beside its triangles.
    middle = (flat.vertices[0] + flat.vertices[4]) / 2
    faces = [tuple(face) for face in flat.faces.tolist()]
    one = next(face for face in faces if {0, 4} <= set(face))
    at = next(i for i in range(3) if {one[i], one[i - 2]} == {0, 4})
    start, end, top = one[at], one[at - 2], one[at - 1]
    faces.remove(one)
    faces += [(start, 8, top), (8, end, top), (start, end, 8)]
    mesh = as_mesh(np.concatenate([flat.vertices, middle[None]]), faces)
    points = crowd(mesh, 2000, 3)
    inside = ((points > 0) & (points < 2)).all(1)
    assert np.array_equal(distances(points, mesh) < 0, inside)


def test_an_open_surface_has_no_signs():
    surface = signed(sheet(5, 5))
    assert not surface.closed
    far, _ = finish(surface.distances_steps(np.array([[2.0, 2, 3], [2, 2, -3]])))
    assert far.tolist() == [3.0, 3.0]


def test_points_on_the_surface_are_at_distance_zero():
    mesh = rough(3)
    assert np.abs(distances(mesh.vertices, mesh)).max() < 1e-12


@pytest.mark.once
def test_any_number_of_threads_gives_the_same_bytes():
    mesh, points = rough(4, 4), crowd(rough(4, 4), 40_000, 1)
    one, several = distances(points, mesh, 1), distances(points, mesh, 3)
    assert one.tobytes() == several.tobytes()


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.once) for seed in range(1, 6))])
def test_the_nearest_pair_is_that_of_all_pairs_of_triangles(seed):
    draw = np.random.default_rng(seed)
    first, second = rough(seed, 0), rough(seed + 50, 0, center=draw.normal(size=3) + np.array([11, 0, 0]))
    corners = [mesh.vertices[mesh.faces].astype(float) for mesh in (first, second)]
    expected = min(between_triangles(one, other) for one in corners[0] for other in corners[1])
    here, there = nearest_pair(first, second)
    assert np.linalg.norm(here - there) == pytest.approx(expected, abs=1e-8)
    assert min(to_triangle(here, *triangle) for triangle in corners[0]) < 1e-6
    assert min(to_triangle(there, *triangle) for triangle in corners[1]) < 1e-6


def test_edges_are_nearest_where_no_vertex_is():
    # Two long edges at a right angle, 0.5 apart, in the middle of both.
    roof = as_mesh([[-3, 0, 0], [3, 0, 0], [0, 3, -3], [0, -3, -3]], [[0, 1, 2], [1, 0, 3]])
    trough = as_mesh([[0, -3, 0.5], [0, 3, 0.5], [3, 0, 4], [-3, 0, 4]], [[0, 1, 2], [1, 0, 3]])
    here, there = nearest_pair(roof, trough)
    assert here.tolist() == [0, 0, 0]
    assert there.tolist() == [0, 0, 0.5]


def test_a_vertex_of_the_other_surface_may_be_nearest():
    spike = as_mesh([[0.2, 0.2, 1], [1, 0, 2], [0, 1, 2]], [[0, 1, 2]])
    floor = as_mesh([[-9, -9, 0], [9, -9, 0], [0, 9, 0]], [[0, 1, 2]])
    here, there = nearest_pair(floor, spike)
    np.testing.assert_allclose([here, there], [[0.2, 0.2, 0], [0.2, 0.2, 1]], atol=1e-7)


def test_surfaces_that_cross_have_one_nearest_point_on_both():
    first, second = icosphere(3, 5.0), icosphere(3, 5.0, (7.3, 0.1, 0.2))
    here, there = nearest_pair(first, second)
    assert np.array_equal(here, there)
    for mesh in (first, second):
        assert abs(distances(here[None], mesh)[0]) < 1e-6


def test_parallel_walls_are_at_their_distance():
    wall = sheet(60, 60)
    other = TriangleMesh(wall.vertices + np.float32([0.3, 0.2, 4]), wall.faces)
    here, there = nearest_pair(wall, other)
    assert np.linalg.norm(here - there) == pytest.approx(4.0, abs=1e-7)
