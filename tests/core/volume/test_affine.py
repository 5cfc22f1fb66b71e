# SPDX-License-Identifier: GPL-3.0-or-later
"""Affines carry points, normals and winding exactly, and name the axes right."""

import numpy as np
import pytest

from ctmc_addon.core import TriangleMesh
from ctmc_addon.core.volume.affine import (
    axis_codes,
    cofactors,
    determinant,
    farthest_corner_mm,
    index_to_index,
    product,
    to_index,
    transform_faces,
    transform_normals,
    transform_points,
)


def random_affine(seed):
    rng = np.random.default_rng(seed)
    affine = np.eye(4)
    affine[:3, :3] = rng.normal(size=(3, 3)) * [0.7, 0.7, 5.0]
    affine[:3, 3] = rng.normal(size=3) * 200
    return affine


@pytest.mark.parametrize("seed", range(5))
def test_points_move_as_the_matrix_says_and_back(seed):
    affine = random_affine(seed)
    points = np.random.default_rng(seed + 100).uniform(-500, 500, (50, 3))
    moved = transform_points(affine, points)
    np.testing.assert_allclose(moved, points @ affine[:3, :3].T + affine[:3, 3], rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(to_index(affine, moved), points, atol=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_determinant_and_cofactors_are_numpys(seed):
    affine = random_affine(seed)
    linear = affine[:3, :3]
    assert determinant(affine) == pytest.approx(np.linalg.det(linear))
    np.testing.assert_allclose(cofactors(affine), np.linalg.inv(linear).T * np.linalg.det(linear), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_normals_stay_at_right_angles_to_the_surface(seed):
    """A plane's normal must stay a normal under a sheared, mirrored affine, and on the same side."""
    affine, rng = random_affine(seed), np.random.default_rng(seed + 7)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    inside_plane = np.linalg.svd(normal[None])[2][1:]
    (moved,) = transform_normals(affine, normal[None])
    assert np.abs(inside_plane @ affine[:3, :3].T @ moved).max() < 1e-5
    assert np.linalg.norm(moved) == pytest.approx(1, abs=1e-6)
    assert (affine[:3, :3] @ normal) @ moved > 0


@pytest.mark.parametrize("seed", range(5))
def test_faces_point_outwards_on_a_mirrored_grid_too(seed):
    affine = random_affine(seed)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)
    moved = TriangleMesh(transform_points(affine, corners).astype(np.float32), transform_faces(affine, faces))
    assert moved.volume == pytest.approx(abs(determinant(affine)) / 6, rel=1e-4)


@pytest.mark.parametrize(("diagonal", "codes"), [((1, 1, 1), "RAS"), ((-1, -1, 1), "LPS"), ((-0.7, 0.7, -5), "LAI")])
def test_axes_are_named_after_the_sides_they_run_towards(diagonal, codes):
    assert axis_codes(np.diag([*diagonal, 1.0])) == codes


def test_permuted_and_tilted_axes_are_named_right():
    sagittal = np.array([[0, 0, 2, 0], [-1, 0, 0, 0], [0, -1, 0.3, 0], [0, 0, 0, 1.0]])
    assert axis_codes(sagittal) == "PIR"


@pytest.mark.parametrize("seed", range(3))
def test_products_and_ways_between_grids_are_numpys(seed):
    affine, other = random_affine(seed), random_affine(seed + 50)
    np.testing.assert_allclose(product(affine, other), affine @ other, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(index_to_index(affine, other), np.linalg.inv(other) @ affine, rtol=1e-9, atol=1e-9)


def test_a_product_adds_from_left_to_right():
    # 1e16 + 1 is 1e16 in float64, so every other order gives 1 or 2.
    assert product(np.array([[1.0, 1.0, 1.0]]), np.array([[1e16], [1.0], [-1e16]])).tolist() == [[0.0]]


def test_corners_of_grids_differ_by_the_shift_and_by_what_a_longer_step_adds_up_to():
    affine = np.diag([0.5, 0.5, 2.0, 1.0])
    moved = affine.copy()
    moved[1, 3] = -0.25
    assert farthest_corner_mm(affine, moved, (10, 20, 30)) == 0.25
    moved[2, 2] = 2.5
    assert farthest_corner_mm(affine, moved, (10, 20, 30)) == 15.0
