"""Quadrics against sums written out plane by plane."""

import numpy as np
import pytest

from ctmc_addon.core.quadrics import DAMPING, best_step, cross, dot, error, moved, vertex_quadrics


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


def quadrics_of(positions, faces):
    return vertex_quadrics(np.ascontiguousarray(positions.T), np.ascontiguousarray(faces.T))


def test_the_error_of_an_edge_is_the_sum_over_the_planes_of_both_ends(fan):
    positions, faces = fan
    quadrics = quadrics_of(positions, faces)
    middle = (positions[0] + positions[2]) / 2
    merged = sum(moved(quadrics[:, [v]], (middle - positions[v])[:, None]) for v in (0, 2))
    for offset in ([0, 0, 0], [0.1, 0.2, -0.3], [-1, 0.5, 2]):
        step = np.array(offset, np.float32)[:, None]
        expected = sum(error_by_planes(positions, faces, v, middle + offset) for v in (0, 2))
        assert error(merged, step)[0] == pytest.approx(expected, rel=1e-5)


def test_moving_a_quadric_changes_where_it_is_kept_and_nothing_else(fan):
    quadric = quadrics_of(*fan)[:, :1]
    there = np.array([[0.5], [-1.0], [0.25]], np.float32)
    point = np.array([[0.1], [0.2], [0.3]], np.float32)
    assert error(moved(quadric, there), point - there)[0] == pytest.approx(error(quadric, point)[0], rel=1e-5)


def test_the_best_step_solves_the_damped_system(fan):
    quadrics = quadrics_of(*fan)
    kept = moved(quadrics, np.full((3, quadrics.shape[1]), 0.2, np.float32))
    steps = best_step(kept)
    for (xx, xy, xz, yy, yz, zz, *g, _), step in zip(kept.T.astype(float), steps.T, strict=True):
        a = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        a += float(DAMPING) * np.trace(a) * np.eye(3)
        assert step == pytest.approx(np.linalg.solve(a, -np.array(g)), abs=2e-3)


def test_three_planes_that_meet_in_a_corner_are_met_at_the_corner():
    corner = np.array([1, 2, 3], np.float32)
    positions = np.concatenate([[corner], corner - np.eye(3, dtype=np.float32)])
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1]], np.int32)
    away = np.array([[0.1], [-0.2], [0.3]], np.float32)
    step = best_step(moved(quadrics_of(positions, faces)[:, :1], away))
    assert step.ravel() == pytest.approx(-away.ravel(), abs=2e-4)


def test_on_a_plane_the_best_step_only_drops_onto_the_plane():
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    quadric = quadrics_of(positions, np.array([[0, 1, 2]], np.int32))[:, :1]
    above = moved(quadric, np.array([[0.3], [0.3], [0.5]], np.float32))
    assert best_step(above).ravel() == pytest.approx([0, 0, -0.5], abs=1e-4)
    assert error(above, best_step(above))[0] == pytest.approx(0, abs=1e-8)


def test_a_face_without_area_weighs_nothing():
    positions = np.zeros((3, 3), np.float32)
    quadrics = quadrics_of(positions, np.array([[0, 1, 2]], np.int32))
    assert not quadrics.any()
    assert not best_step(quadrics).any()


def test_cross_and_dot_are_those_of_the_columns():
    u, v = np.arange(6.0).reshape(3, 2), np.arange(6.0)[::-1].reshape(3, 2) ** 2
    assert (cross(u, v) == np.cross(u.T, v.T).T).all()
    assert (dot(u, v) == (u * v).sum(axis=0)).all()
