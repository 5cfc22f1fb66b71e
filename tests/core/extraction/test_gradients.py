# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals from the gray values, against closed forms."""

import numpy as np
import pytest

from ctmc_addon.core import marching_cubes
from ctmc_addon.core.extraction.gradients import Sampler


def sphere(radius, spacing=1.0, size=None):
    """Signed distance to a sphere about the middle, positive inside, and the middle."""
    size = size or int(2 * radius / spacing) + 7
    middle = (size - 1) / 2
    return radius - spacing * np.sqrt(((np.indices((size,) * 3) - middle) ** 2).sum(axis=0)), middle


def test_normals_point_outward_within_half_a_degree_of_a_spheres():
    values, middle = sphere(12.0)
    mesh = marching_cubes(values, 0.0)
    exact = (mesh.vertices - middle) / np.linalg.norm(mesh.vertices - middle, axis=1, keepdims=True)
    assert np.degrees(np.arccos(np.clip((mesh.normals * exact).sum(axis=1), -1, 1))).max() < 0.5
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-6)


def test_under_a_stride_normals_are_those_of_the_full_resolution():
    """A ripple of four pixels is not seen by samples four apart, but it tilts the surface between them."""
    _, y, x = np.indices((5, 9, 13)).astype(float)
    mesh = marching_cubes(y + 3 * np.sin(x * np.pi / 2), 3.5, stride=(4, 1, 1))
    np.testing.assert_allclose(mesh.vertices[:, 1], 3.5, atol=1e-6)
    slope = np.array([3, 1, 0]) / np.sqrt(10)  # inside is where y is large, so the outside is against it
    np.testing.assert_allclose(mesh.normals, np.tile(-slope, (len(mesh.normals), 1)), atol=1e-6)


def test_a_plane_has_the_closed_form_normal_at_the_border_too():
    z, y, x = np.indices((6, 7, 8)).astype(float)
    direction = np.array([2.0, -1.0, 0.5])
    values = x * direction[0] + y * direction[1] + z * direction[2]
    mesh = marching_cubes(values, 4.1)
    np.testing.assert_allclose(
        mesh.normals, np.tile(-direction / np.linalg.norm(direction), (len(mesh.normals), 1)), atol=1e-6
    )
    np.testing.assert_allclose(mesh.vertices @ direction, 4.1, atol=2e-3)


def test_normals_are_of_unit_length_where_a_gradient_reaches_a_nan_voxel():
    values = np.zeros((9, 9, 9), np.float32)
    values[3:6, 3:6, 3:6] = 1
    values[7, 4, 4] = np.nan
    mesh = marching_cubes(values, 0.5)
    assert np.allclose(np.sqrt((mesh.normals.astype(float) ** 2).sum(axis=1)), 1.0, atol=1e-5)


@pytest.mark.parametrize("turn", [(1, 1, 1), (-1, 1, 1), (1, -1, -1), (-1, -1, -1)])
@pytest.mark.parametrize("axes", [(0, 1, 2), (2, 0, 1)])
def test_values_are_gathered_from_any_memory_layout(turn, axes):
    stored = np.arange(4 * 5 * 6).reshape(4, 5, 6).astype(">i2")
    values = stored.transpose(axes)[tuple(slice(None, None, step) for step in turn)]
    sampler = Sampler(values)
    z, y, x = np.indices(values.shape)
    np.testing.assert_array_equal(sampler.gather(sampler.flat_index(x, y, z)), values)
    for axis, coordinate in enumerate((x, y, z)):
        flat = sampler.flat_index(x, y, z).ravel()
        first, last = (np.flatnonzero(coordinate == border) for border in (0, sampler.size[axis] - 1))
        found = sampler.difference(flat, axis, first, last).reshape(values.shape)
        np.testing.assert_array_equal(found, np.gradient(values.astype(float), axis=2 - axis))
