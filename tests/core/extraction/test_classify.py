# SPDX-License-Identifier: GPL-3.0-or-later
"""One bit for every sample: inside is at or above the threshold."""

import numpy as np
import pytest

from ctmc_addon.core.extraction.classify import inside_bits, lowest_inside
from ctmc_addon.core.extraction.grid import make_grid


@pytest.mark.parametrize("threshold", [0.7, 0.1, 1 / 3, -0.7, 1e300])
def test_values_are_compared_with_the_lowest_of_their_type_that_reaches_the_threshold(threshold):
    lowest = lowest_inside(threshold, np.dtype(np.float32))
    assert float(np.nextafter(lowest, np.float32(-np.inf))) < threshold <= float(lowest)


@pytest.mark.parametrize(
    ("threshold", "dtype", "lowest"),
    [(127.5, "u1", 128), (-3, "u1", 0), (255, "u1", 255), (255.5, "u1", None), (-0.5, ">i2", 0), (40000, "i2", None)],
)
def test_of_whole_numbers_the_next_one_up_is_the_lowest_inside(threshold, dtype, lowest):
    assert lowest_inside(threshold, np.dtype(dtype)) == lowest


@pytest.mark.parametrize("close_border", [False, True])
@pytest.mark.parametrize("stride", [(1, 1, 1), (2, 3, 1), (4, 5, 2), (8, 2, 3), (3, 7, 1)])
@pytest.mark.parametrize("dtype", ["u1", ">i2", "f4"])
def test_the_bits_are_those_of_the_samples_compared_one_by_one(stride, close_border, dtype):
    values = np.random.default_rng(1).integers(0, 200, (7, 12, 136)).astype(dtype)
    grid = make_grid(values, stride, close_border)
    bits = np.zeros((grid.z.count + 1, grid.y.count + 1, grid.words), np.uint64)
    for low in range(0, grid.z.count, 2):
        inside_bits(grid, 90.5, low, min(low + 2, grid.z.count), bits)
    samples = values[np.ix_(grid.z.index, grid.y.index, grid.x.index)] >= 90.5
    if close_border:
        samples[[0, -1]] = samples[:, [0, -1]] = samples[:, :, [0, -1]] = False
    expected = np.pad(samples, ((0, 1), (0, 1), (0, 0)), mode="edge")  # what is repeated beyond the last
    unpacked = np.unpackbits(bits.view(np.uint8), axis=2, bitorder="little")
    np.testing.assert_array_equal(unpacked[:, :, : grid.x.count], expected)
    assert not unpacked[:, :, grid.x.count :].any()


@pytest.mark.parametrize("close_border", [False, True])
@pytest.mark.parametrize(("columns", "upper"), [(128, None), (128, 1), (100, None)])
def test_of_a_mask_all_that_is_not_zero_is_inside(columns, upper, close_border):
    values = np.random.default_rng(2).choice(np.array([0, 0, 1, 2, 255], np.uint8), (5, 9, columns))
    grid = make_grid(values, (1, 1, 1), close_border, upper=upper)
    bits = np.zeros((grid.z.count + 1, grid.y.count + 1, grid.words), np.uint64)
    inside_bits(grid, 0.5, 0, grid.z.count, bits)
    samples = np.isin(values, (1, 2, 255) if upper is None else (1,))
    if close_border:
        samples = np.pad(samples, 1)
    unpacked = np.unpackbits(bits.view(np.uint8), axis=2, bitorder="little")[:-1, :-1]
    np.testing.assert_array_equal(unpacked[:, :, : samples.shape[2]], samples)
    assert not unpacked[:, :, samples.shape[2] :].any()
