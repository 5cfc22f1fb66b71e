# SPDX-License-Identifier: GPL-3.0-or-later
"""A transform that was applied to a mesh is found from its vertices, though some were moved by hand."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.surface.placement import Placement, fitted_affine, fitted_placement

TURNED = ((0.6, -0.9, 0.1), (0.8, 0.5, 0.0), (0.1, 0.2, 1.4))


def points(count=400):
    return np.random.default_rng(0).uniform(-60, 60, (count, 3)).astype(np.float32)


def test_a_transform_is_found_though_some_vertices_were_moved():
    applied = Placement((0.3, -0.2, 0.1), 0.01, TURNED)
    local = applied.to_local(points())
    local[::5] += 0.07
    found = fitted_placement(Placement((0.0, 0.0, 0.0), 0.01), points(), local)
    np.testing.assert_allclose(found.applied, TURNED, atol=1e-6)
    np.testing.assert_allclose(found.origin, applied.origin, atol=1e-6)
    moved = np.arange(len(local)) % 5 == 0
    np.testing.assert_allclose(found.to_mm(local)[~moved], points()[~moved], atol=1e-3)


def test_the_fit_is_the_least_squares_of_numpy():
    kept, noise = points().astype(float), np.random.default_rng(1).normal(0, 0.1, (400, 3))
    moved = kept @ np.array(TURNED).T + (1.0, 2.0, 3.0) + noise
    solution = np.linalg.lstsq(np.c_[kept, np.ones(400)], moved, rcond=None)[0]
    np.testing.assert_allclose(fitted_affine(kept, moved)[:3], solution.T, atol=1e-10)


@pytest.mark.parametrize("axis", range(3))
def test_nothing_is_fitted_to_points_in_one_plane(axis):
    flat = points().astype(float)
    flat[:, axis] = 7.5
    assert fitted_affine(flat, flat) is None


def test_nothing_is_fitted_where_a_mesh_was_pressed_flat():
    assert fitted_placement(Placement(), points(), points() * np.float32([0.01, 0.01, 0.0])) is None
