# SPDX-License-Identifier: GPL-3.0-or-later
"""The active voxels and their cases, against every voxel in turn."""

import numpy as np
import pytest

from ctmc_addon.core import finish
from ctmc_addon.core.extraction.active_voxels import find_active
from ctmc_addon.core.extraction.classify import inside_bits
from ctmc_addon.core.extraction.grid import make_grid
from ctmc_addon.core.extraction.marching_cubes import count_steps, extract_steps


def noise(shape, seed=0, dtype=np.uint8):
    return np.random.default_rng(seed).integers(0, 255, shape).astype(dtype)


def test_the_counts_are_those_of_the_surface():
    values = noise((20, 21, 66))
    for stride, closed in (((1, 1, 1), False), ((2, 3, 1), True)):
        grid = make_grid(values, stride, closed)
        counts = finish(count_steps(grid, 127.5))
        surface = finish(extract_steps(grid, 127.5))
        assert (counts.vertices, counts.faces) == (len(surface.midpoints), len(surface.faces))
    counts = finish(count_steps(make_grid(values), 127.5))
    inside = sum((values[z : 19 + z, y : 20 + y, x : 65 + x] > 127.5).astype(int) for x, y, z in np.ndindex(2, 2, 2))
    assert counts.voxels == 19 * 20 * 65
    assert counts.active == ((inside > 0) & (inside < 8)).sum()


def slab_of(values, threshold, low, high):
    grid = make_grid(values)
    bits = np.zeros((grid.z.count + 1, grid.y.count + 1, grid.words), np.uint64)
    inside_bits(grid, threshold, 0, grid.z.count, bits)
    return find_active(grid, bits, low, high)


@pytest.mark.parametrize("columns", [2, 63, 64, 65, 70, 129])
@pytest.mark.parametrize(("low", "high"), [(0, 3), (1, 4), (2, 5), (0, 5)])
def test_every_active_voxel_is_found_with_its_case_and_its_edges(columns, low, high):
    values = noise((5, 4, columns), seed=columns)
    values[:, :, columns // 3 : columns // 2] = 255
    slab = slab_of(values, 127.5, low, high)
    inside = np.pad(values > 127.5, ((0, 1), (0, 1), (0, 1)), mode="edge")  # ghost cells stand in the high borders
    case = sum(
        inside[z : z + 5, y : y + 4, x : x + columns].astype(int) << bit
        for bit, (z, y, x) in enumerate(np.ndindex(2, 2, 2))
    )[low:high]
    z, y, x = np.nonzero((case > 0) & (case < 255))
    np.testing.assert_array_equal(slab.samples(np.arange(len(slab.slot))), (x, y, z + low))
    np.testing.assert_array_equal(slab.configuration, case[z, y, x])
    np.testing.assert_array_equal(slab.ghosts, np.flatnonzero((x == columns - 1) | (y == 3) | (z + low == 4)))
    for axis, bit in enumerate((1, 2, 4)):
        crossed = (case[z, y, x] & 1) != (case[z, y, x] >> bit & 1)
        np.testing.assert_array_equal(slab.edge_slots[axis], slab.slot[crossed])


def test_a_voxel_is_found_where_the_files_head_says():
    values = np.zeros((3, 4, 70), np.uint8)
    values[1, 2, 9] = 1
    slab = slab_of(values, 0.5, 0, 3)
    voxel = np.flatnonzero(slab.configuration == 1)[0]
    rank = int(np.flatnonzero(slab.byte == (1 * 5 + 2) * 16 + 1)[0])
    assert slab.slot[voxel] == 8 * rank + 1
