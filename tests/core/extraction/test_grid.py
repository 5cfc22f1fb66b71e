# SPDX-License-Identifier: GPL-3.0-or-later
"""Which values of a volume are samples."""

import numpy as np
import pytest

from ctmc_addon.core import finish, marching_cubes
from ctmc_addon.core.errors import SettingsError
from ctmc_addon.core.extraction.grid import make_grid, sample_axis
from ctmc_addon.core.extraction.marching_cubes import extract_steps


def noise(shape, seed=0, dtype=np.uint8):
    return np.random.default_rng(seed).integers(0, 255, shape).astype(dtype)


def test_a_window_gives_the_surface_inside_it():
    values = noise((12, 13, 14))
    window = ((3, 10), (2, 9), (4, 11))
    surface = finish(extract_steps(make_grid(values, (2, 2, 2), False, window), 127.5))
    cut = marching_cubes(values[4:11, 2:9, 3:10], 127.5, (2, 2, 2))
    np.testing.assert_allclose(surface.at(1.0).vertices - np.float32([3, 2, 4]), cut.vertices, atol=1e-6)
    np.testing.assert_array_equal(surface.faces, cut.faces)


def test_a_coarse_surface_is_not_cut_short():
    values = np.zeros((5, 12, 12), np.uint8)
    values[:, 3:, 3:] = 200
    mesh = marching_cubes(values, 100, stride=(5, 5, 3))
    np.testing.assert_array_equal(mesh.vertices.max(axis=0), [11, 11, 4])


@pytest.mark.parametrize("size", [2, 3, 7, 64])
@pytest.mark.parametrize("stride", [1, 2, 5])
def test_the_first_and_the_last_value_are_samples_and_no_two_are_farther_apart_than_the_stride(size, stride):
    axis = sample_axis(0, size, stride, closed=False)
    assert (axis.index[0], axis.index[-1]) == (0, size - 1)
    assert (np.diff(axis.index)[:-1] == stride).all()
    assert 1 <= np.diff(axis.index)[-1] <= stride
    assert axis.voxels == axis.count - 1 == -(-(size - 1) // stride)
    closed = sample_axis(0, size, stride, closed=True)
    assert closed.position.tolist() == [-1, *axis.position.tolist(), size]
    assert closed.voxels == axis.voxels


def test_a_stride_as_long_as_the_window_is_refused():
    values = np.zeros((5, 6, 7), np.uint8)
    assert make_grid(values, (6, 5, 4)).voxels == 1
    with pytest.raises(SettingsError, match="stride 7 along x must be a whole number from 1 to 6"):
        make_grid(values, (7, 1, 1))
