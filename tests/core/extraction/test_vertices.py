# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the vertices on edges lie: Su and Ma, eq. 5 to 7."""

import numpy as np
import pytest

from ctmc_addon.core import finish, marching_cubes
from ctmc_addon.core.extraction.grid import make_grid
from ctmc_addon.core.extraction.marching_cubes import extract_steps


def noise(shape, seed=0, dtype=np.uint8):
    return np.random.default_rng(seed).integers(0, 255, shape).astype(dtype)


def test_alpha_blends_midpoint_and_linear_crossing_and_keeps_the_triangles():
    values = noise((8, 9, 10))
    grid = make_grid(values)
    surface = finish(extract_steps(grid, 127.5))
    for alpha in (0.0, 0.37, 1.0):
        mesh = marching_cubes(values, 127.5, alpha=alpha)
        np.testing.assert_array_equal(mesh.faces, surface.faces)
        np.testing.assert_array_equal(mesh.vertices, surface.at(alpha).vertices)
    assert (surface.midpoints * 2 == np.round(surface.midpoints * 2)).all()
    moved = surface.linear != surface.midpoints
    assert (moved.sum(axis=1) <= 1).all()


def test_on_a_mask_every_crossing_is_the_midpoint():
    mask = noise((8, 8, 8)) > 127
    np.testing.assert_array_equal(marching_cubes(mask, 0.5).vertices, marching_cubes(mask, 0.5, alpha=0).vertices)


@pytest.mark.parametrize("value", [0, 127, 254])
def test_a_threshold_equal_to_voxel_values_leaves_no_hole_and_no_two_vertices_in_one_place(value):
    values = np.random.default_rng(3).choice([0, 127, 254], (12, 12, 12)).astype(np.int16)
    mesh = marching_cubes(values, max(value, 1), close_border=True)
    assert mesh.closed
    assert len(np.unique(mesh.vertices, axis=0)) == len(mesh.vertices)


def test_caps_have_the_border_normals_and_lie_half_a_pixel_outside():
    values = np.ones((5, 6, 7), np.uint8)
    mesh = marching_cubes(values, 0.5, stride=(2, 2, 1), close_border=True)
    np.testing.assert_array_equal(mesh.vertices.min(axis=0), [-0.5, -0.5, -0.5])
    np.testing.assert_array_equal(mesh.vertices.max(axis=0), [6.5, 5.5, 4.5])
    top = (mesh.vertices[:, 2] == 4.5) & (np.abs(mesh.vertices[:, :2] - [3, 2.5]) < 1.6).all(axis=1)
    np.testing.assert_allclose(mesh.normals[top], [[0, 0, 1]] * top.sum(), atol=1e-6)


@pytest.mark.parametrize(("alpha", "x"), [(0.0, 5.0), (0.5, 4.7), (1.0, 4.4)])
def test_a_crossing_is_interpolated_along_an_edge_of_the_enlarged_voxel(alpha, x):
    values = np.broadcast_to(np.array([100, 100, 100, 100, 100, 150, 200, 200, 200], np.int16), (3, 3, 9))
    mesh = marching_cubes(values, 120, (2, 1, 1), alpha)
    np.testing.assert_allclose(mesh.vertices[:, 0], x, atol=1e-6)
