# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles that cross: the same pairs as in fractions, whatever touches, overlaps or has no area."""

from fractions import Fraction

import numpy as np
import pytest
from meshes import boundary_edges, icosphere, joined, sheet, torus
from oracles.crossings import crossing_pairs

from ctmc_addon.core import finish, marching_cubes
from ctmc_addon.core.mesh.intersections import self_intersections
from ctmc_addon.core.mesh.intersections.orientation import sides, turns
from ctmc_addon.core.mesh.intersections.stars import _open_ends_steps

FLOOR = [(0, 0, 0), (4, 0, 0), (0, 4, 0)]


def pairs(vertices, faces):
    return [
        tuple(pair) for pair in self_intersections(np.array(vertices, np.float32), np.array(faces, np.int32)).tolist()
    ]


@pytest.mark.parametrize(
    ("corners", "meets"),
    [
        ([(1, 1, -1), (1, 1, 1), (9, 9, 0)], True),  # through the middle
        ([(1, 1, 0), (1, 1, 1), (9, 9, 9)], True),  # a corner on the inside
        ([(2, 2, 0), (5, 5, 1), (5, 5, -1)], True),  # a corner on an edge
        ([(4, 0, 0), (5, 1, 1), (5, 0, 1)], True),  # a corner on a corner
        ([(2, 2, 2**-20), (5, 5, 1), (5, 5, -1)], False),  # the same, a little off the plane and beyond the edge
        ([(1, 1, 2**-20), (1, 1, 1), (9, 9, 9)], False),
        ([(1, 1, 0), (2, 1, 0), (1, 2, 0)], True),  # within it, in its plane
        ([(-9, -9, 0), (20, 0, 0), (0, 20, 0)], True),  # around it, in its plane
        ([(5, 0, 0), (6, 0, 0), (5, 1, 0)], False),  # beside it, in its plane
        ([(3, 3, 0), (4, 4, 0), (3, 4, 0)], False),
    ],
)
def test_triangles_without_a_common_vertex_may_not_touch(corners, meets):
    assert pairs([*FLOOR, *corners], [(0, 1, 2), (3, 4, 5)]) == [(0, 1)] * meets


@pytest.mark.parametrize(
    ("corners", "meets"),
    [
        ([(-1, -1, 0), (-1, -2, 0)], False),  # in its plane, on the other side of the vertex
        ([(1, 1, 1), (2, 1, 1)], False),  # above it
        ([(1, 2, 1), (2, 1, -1)], True),  # through it
        ([(2, 2, 0), (3, 3, 1)], True),  # an edge of one inside the other
        ([(4, 0, 0), (1, 1, 1)], True),  # an edge upon an edge, of other vertices
        ([(0, -1, 0), (4, 2, 0)], True),  # in its plane, across an edge
    ],
)
def test_triangles_with_a_common_vertex_meet_there_alone(corners, meets):
    assert pairs([*FLOOR, *corners], [(0, 1, 2), (0, 3, 4)]) == [(0, 1)] * meets


@pytest.mark.parametrize(
    ("corner", "meets"),
    [((2, -4, 0), False), ((2, 1, 0), True), ((2, 1, 2**-20), False), ((0, 0, 1), False), ((9, 9, 0), True)],
)
def test_triangles_with_a_common_edge_may_not_lie_on_each_other(corner, meets):
    assert pairs([*FLOOR, corner], [(0, 1, 2), (1, 0, 3)]) == [(0, 1)] * meets


def test_triangles_of_three_common_corners_and_those_without_area_count():
    assert pairs(FLOOR, [(0, 1, 2), (2, 1, 0)]) == [(0, 1)]
    assert pairs([*FLOOR, (2, 0, 0)], [(0, 1, 3), (0, 1, 2), (0, 0, 1)]) == [(0, 0), (2, 2)]


@pytest.mark.parametrize("shift", [0.0, 7.3])
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.once) for seed in range(1, 3))])
def test_soups_of_triangles_have_the_pairs_that_fractions_give(seed, shift):
    random = np.random.default_rng(seed)
    met = 0
    for _ in range(3):
        vertices = (random.integers(0, 4, (9, 3)) * (0.1 if shift else 1.0) + shift).astype(np.float32)
        faces = np.stack([random.choice(9, 3, replace=False) for _ in range(7)])
        expected = crossing_pairs(vertices, faces)
        assert pairs(vertices, faces) == expected
        met += len(expected)
    assert met > 15


@pytest.mark.parametrize("reach", [1.0, 6.0])
def test_closed_surfaces_with_moved_vertices_have_the_pairs_that_fractions_give(reach):
    random = np.random.default_rng(4)
    corners = np.array([(3, 0, 0), (0, 3, 0), (-3, 0, 0), (0, -3, 0), (0, 0, 3), (0, 0, -3)])
    faces = [(4, i, (i + 1) % 4) for i in range(4)] + [(5, (i + 1) % 4, i) for i in range(4)]
    expected = []
    for _ in range(3):
        vertices = np.round(corners + random.uniform(-reach, reach, corners.shape)).astype(np.float32)
        expected.append(crossing_pairs(vertices, faces))
        assert pairs(vertices, faces) == expected[-1]
    assert any(expected) == (reach > 1)


@pytest.mark.parametrize("mesh", [icosphere(3), torus(40, 20), sheet(20, 20), sheet(9, 9, lambda x, y: x * y % 3)])
def test_surfaces_that_do_not_cross_have_no_pair(mesh):
    assert not len(self_intersections(mesh.vertices, mesh.faces))


def test_two_balls_cross_along_a_ring_and_one_inside_the_other_nowhere():
    crossing = joined(icosphere(2), icosphere(2, center=(1.0, 0.1, 0.2)))
    found = self_intersections(crossing.vertices, crossing.faces)
    half = len(crossing.faces) // 2
    assert len(found) > 40
    assert (found[:, 0] < half).all()
    assert (found[:, 1] >= half).all()
    middles = crossing.vertices[crossing.faces[found[:, 0]]].mean(axis=1)
    # The circle in which the spheres meet.
    away = np.abs(middles @ np.array([1.0, 0.1, 0.2]) - 0.525)
    assert away.max() < 0.25
    inside = joined(icosphere(2), icosphere(2, 0.5))
    assert not len(self_intersections(inside.vertices, inside.faces))


@pytest.mark.parametrize("share", [0.3, 0.08, 0.0])
def test_only_pairs_of_the_selected_are_given(share):
    random = np.random.default_rng(7)
    vertices = (random.random((150, 3)) * [1, 2, 9]).astype(np.float32)
    faces = np.arange(150, dtype=np.int32).reshape(50, 3)
    found = self_intersections(vertices, faces)
    selected = random.random(50) < share
    expected = found[selected[found].any(axis=1)]
    assert (len(expected) > 0) == (share > 0)
    assert len(expected) < len(found)
    assert self_intersections(vertices, faces, selected).tolist() == expected.tolist()


def test_no_triangles_have_no_pairs():
    assert self_intersections(np.zeros((3, 3), np.float32), np.zeros((0, 3), np.int32)).shape == (0, 2)


@pytest.mark.parametrize("small", [1.0, 2.0**-40])  # the second takes more bits than 64
def test_sides_are_exact_where_float64_is_not(small):
    random = np.random.default_rng(1)
    a, b, c = random.random((3, 3, 200)).astype(np.float32)
    a[:, ::3] *= np.float32(small)
    share = random.integers(0, 5, 200).astype(np.float32) / 4
    d = (a + share * (b - a)).astype(np.float32)  # on an edge but for its rounding
    signs = sides(*(point.astype(np.float64) for point in (a, b, c, d)))
    flat = turns(*(point[:2].astype(np.float64) for point in (a, b, d)))
    for number in range(200):
        p, q, r, s = ([Fraction(float(value)) for value in point[:, number]] for point in (a, b, c, d))
        u, v, w = ([x - y for x, y in zip(point, s, strict=True)] for point in (p, q, r))
        volume = sum(u[i - 2] * (v[i - 1] * w[i] - v[i] * w[i - 1]) for i in range(3))
        assert signs[number] == (volume < 0) - (volume > 0)
        area = (p[0] - s[0]) * (q[1] - s[1]) - (p[1] - s[1]) * (q[0] - s[0])
        assert flat[number] == (area > 0) - (area < 0)


def test_flat_triangles_far_from_the_origin_touch_or_not_by_one_last_place():
    step = np.spacing(np.float32(1000.0))
    for gap, meets in ((0.0, True), (step, False)):
        right = 1001 + gap
        beside = [(right, -700, 300), (right + 1, -700, 300), (right, -699, 300)]
        corners = [(1000, -700, 300), (1001, -700, 300), (1000, -699, 300), *beside]
        assert pairs(corners, [(0, 1, 2), (3, 4, 5)]) == [(0, 1)] * meets


@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0])
def test_marching_cubes_of_noise_does_not_cross_itself(alpha):
    noise = np.random.default_rng(3).standard_normal((10, 11, 12))
    mesh = marching_cubes(noise, 0.0, alpha=alpha)
    assert len(mesh.faces) > 1500
    assert not len(self_intersections(mesh.vertices, mesh.faces))


def test_the_ends_of_border_edges_are_known_among_many_vertices():
    """Products of their numbers need more than 32 bits."""
    wide = sheet(300, 300)
    ends = finish(_open_ends_steps(np.ascontiguousarray(wide.faces.T), len(wide.vertices)))
    assert np.array_equal(np.unique(ends), np.unique(boundary_edges(wide)))
    ball = icosphere(2)
    assert not len(finish(_open_ends_steps(np.ascontiguousarray(ball.faces.T), len(ball.vertices))))
    turned = ball.faces.copy()
    turned[7] = turned[7, ::-1]
    ends = finish(_open_ends_steps(np.ascontiguousarray(turned.T), len(ball.vertices)))
    assert set(ends.tolist()) == set(turned[7].tolist())
