# SPDX-License-Identifier: GPL-3.0-or-later
"""Quadrics against sums written out plane by plane."""

import numpy as np
import pytest

from ctmc_addon.core.progress import finish
from ctmc_addon.core.simplification.engine.quadrics import (
    DAMPING,
    EdgeQuadric,
    best_step,
    cross,
    dot,
    edge_quadric,
    error,
    vertex_quadrics_steps,
)


@pytest.fixture
def fan():
    """A vertex with six faces round it, off the origin, and the faces as rows."""
    angles = np.arange(6) * np.pi / 3
    ring = np.stack([np.cos(angles), np.sin(angles), 0.3 * np.cos(3 * angles) - 0.4], axis=1)
    positions = np.stack([np.zeros(3), *ring]).astype(np.float32) + np.float32([0.5, -0.25, 1.0])
    faces = np.array([[0, 1 + i, 1 + (i + 1) % 6] for i in range(6)], np.int32)
    return positions, faces


def error_by_planes(positions, faces, vertex, point):
    """Sum over the faces at `vertex` of a third of the area times the squared distance to the plane."""
    total = 0.0
    for face in faces:
        if vertex in face:
            a, b, c = positions[face].astype(float)
            normal = np.cross(b - a, c - a)
            area = 0.5 * np.linalg.norm(normal)
            total += area / 3 * np.dot(point - a, normal / np.linalg.norm(normal)) ** 2
    return total


def quadric_of_edge(positions, faces, first, second):
    quadrics = finish(vertex_quadrics_steps(np.ascontiguousarray(positions.T), np.ascontiguousarray(faces.T)))
    half = (positions[second] - positions[first])[:, None] / np.float32(2)
    return edge_quadric(quadrics[:, [first]], quadrics[:, [second]], half)


def test_the_error_of_an_edge_is_the_sum_over_the_planes_of_both_ends(fan):
    positions, faces = fan
    quadric = quadric_of_edge(positions, faces, 0, 2)
    middle = (positions[0] + positions[2]) / 2
    for offset in ([0, 0, 0], [0.1, 0.2, -0.3], [-1, 0.5, 2]):
        step = np.array(offset, np.float32)[:, None]
        expected = sum(error_by_planes(positions, faces, v, middle + offset) for v in (0, 2))
        assert error(quadric, step)[0] == pytest.approx(expected, rel=1e-5)


def test_the_best_step_has_no_more_error_than_the_damped_solution_and_its_surroundings(fan):
    positions, faces = fan
    for ends in ((0, 1), (0, 4), (2, 3)):
        quadric = quadric_of_edge(positions, faces, *ends)
        xx, xy, xz, yy, yz, zz = quadric.matrix[:, 0].astype(float)
        a = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        damped = np.linalg.solve(a + float(DAMPING) * np.trace(a) * np.eye(3), -quadric.gradient[:, 0].astype(float))
        step = best_step(quadric)
        least = error(quadric, step)[0]
        assert least <= error(quadric, damped.astype(np.float32)[:, None])[0] + 1e-7
        for nudge in np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32) * np.float32(0.01):
            assert least <= error(quadric, step + nudge[:, None])[0] + 1e-7


def test_three_planes_that_meet_in_a_corner_are_met_at_the_corner():
    """An edge along one side of a cube's corner, cut short: both ends see the three planes."""
    positions = np.array([[1, 2, 3], [0, 2, 3], [1, 1, 3], [1, 2, 2]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1]], np.int32)
    step = best_step(quadric_of_edge(positions, faces, 0, 2)).ravel()
    assert positions[[0, 2]].mean(axis=0) + step == pytest.approx(positions[0], abs=1e-5)


def test_on_a_plane_the_best_step_stays_at_the_middle_of_the_edge():
    positions = np.array([[0, 0, 0], [1, 0, 1], [0, 1, -1], [1, 1, 0]], np.float32)
    quadric = quadric_of_edge(positions, np.array([[0, 1, 2], [1, 3, 2]], np.int32), 1, 2)
    assert best_step(quadric).ravel() == pytest.approx([0, 0, 0], abs=1e-6)
    assert error(quadric, best_step(quadric))[0] == pytest.approx(0, abs=1e-10)


def test_a_face_without_area_weighs_nothing():
    quadric = quadric_of_edge(np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.int32), 0, 1)
    assert not quadric.matrix.any()
    assert not best_step(quadric).any()


@pytest.mark.parametrize("other", [1, 2])
def test_a_pivot_that_rounding_makes_zero_leads_onto_the_plane(other):
    """Two rows of the damped matrix are the same bits: one plane, 3 away along either of two axes."""
    damped = np.float32(0.5) + DAMPING
    full = np.zeros((3, 3), np.float32)
    full[0, 0] = full[other, other] = 1.0
    full[0, other] = full[other, 0] = 2 * damped
    gradient = np.zeros((3, 1), np.float32)
    gradient[[0, other]] = 3.0
    step = best_step(EdgeQuadric(full[np.triu_indices(3)][:, None], gradient, np.zeros(1, np.float32)))
    assert step[0] + step[other] == pytest.approx(-3.0, abs=1e-4)
    assert step[3 - other] == 0.0


def test_cross_and_dot_are_those_of_the_columns():
    u, v = np.arange(6.0).reshape(3, 2), np.arange(6.0)[::-1].reshape(3, 2) ** 2
    assert (cross(u, v) == np.cross(u.T, v.T).T).all()
    assert (dot(u, v) == (u * v).sum(axis=0)).all()
