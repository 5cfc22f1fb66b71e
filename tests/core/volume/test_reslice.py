# SPDX-License-Identifier: GPL-3.0-or-later
"""Values anywhere in a volume: equal to the samples on them, linear between them, and nothing outside."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.core.volume import (
    PLANES,
    Volume,
    position_through,
    resliced,
    slice_at,
    slice_corners,
    slice_values,
    transform_points,
    value_at,
)

AFFINE = np.array([[-0.7, 0.1, 0, 312.5], [0.1, 0.8, 0, -207.25], [0.05, 0.2, 2.0, 715.125], [0, 0, 0, 1.0]])


@pytest.fixture
def volume():
    values = np.random.default_rng(3).integers(-1000, 2000, (7, 8, 9)).astype(np.int16)
    return Volume(values, AFFINE)


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("position", [0.0, 0.4, 1.0])
def test_a_plane_on_a_slice_has_its_samples(volume, plane, position):
    section = slice_at(volume, plane, position)
    values = slice_values(volume, section)
    found = resliced(volume, slice_corners(volume, section), values.shape, -1e6)
    np.testing.assert_allclose(found, values, atol=1e-2)


def test_a_turned_plane_has_a_linear_volumes_values_and_nothing_outside():
    z, y, x = np.indices((20, 20, 20))
    volume = Volume((100 * x + 10 * y - 30 * z).astype(np.float32), AFFINE)
    index = np.array([[4, 4, 3.0], [12, 6, 5], [13, 16, 12], [5, 14, 10]])  # a parallelogram
    found = resliced(volume, transform_points(AFFINE, index), (6, 4), -1e6)
    right, below = np.meshgrid((np.arange(4) + 0.5) / 4, (np.arange(6) + 0.5) / 6)
    at = index[0] + right[..., None] * (index[1] - index[0]) + below[..., None] * (index[3] - index[0])
    np.testing.assert_allclose(found, at @ [100, 10, -30], atol=0.05)
    assert (resliced(volume, transform_points(AFFINE, np.add(index, (0, 0, 40))), (6, 4), -1e6) == -1e6).all()


def test_the_value_at_a_point_is_that_of_the_nearest_sample(volume):
    point = transform_points(AFFINE, np.array([[3.4, 5.6, 2.2]]))[0]
    assert value_at(volume, point) == volume.values[2, 6, 3]
    assert value_at(volume, transform_points(AFFINE, np.array([[8.6, 0, 0.0]]))[0]) is None


@pytest.mark.parametrize("plane", PLANES)
def test_the_position_through_a_point_shows_its_slice(volume, plane):
    index = np.array([3.2, 5.9, 2.1])
    point = transform_points(AFFINE, index[None])[0]
    section = slice_at(volume, plane, position_through(volume, plane, point))
    assert section.index == round(index[section.axis])
