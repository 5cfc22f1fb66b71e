# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertices inside ambiguous voxels."""

from itertools import pairwise

import numpy as np
import pytest

from ctmc_addon.core import marching_cubes
from ctmc_addon.core.extraction.active_voxels import find_active
from ctmc_addon.core.extraction.classify import inside_bits
from ctmc_addon.core.extraction.gradients import Sampler
from ctmc_addon.core.extraction.grid import make_grid
from ctmc_addon.core.extraction.trilinear import interior_vertices
from ctmc_addon.core.extraction.trilinear.interior_vertices import corner_values, with_trilinear_topology


def sphere(radius, spacing=1.0, size=None):
    """Signed distance to a sphere about the middle, positive inside, and the middle."""
    size = size or int(2 * radius / spacing) + 7
    middle = (size - 1) / 2
    return radius - spacing * np.sqrt(((np.indices((size,) * 3) - middle) ** 2).sum(axis=0)), middle


@pytest.mark.parametrize("threads", [1, 3])
def test_interior_vertices_do_not_depend_on_threads_and_classic_cases_are_untouched(threads):
    values = np.random.default_rng(4).normal(size=(40, 130, 70))
    one = marching_cubes(values, 0.0, threads=1, topology="trilinear")
    many = marching_cubes(values, 0.0, threads=threads, topology="trilinear")
    assert one.vertices.tobytes() == many.vertices.tobytes()
    assert one.faces.tobytes() == many.faces.tobytes()
    smooth, _ = sphere(9.0)
    classic, exact = marching_cubes(smooth, 0.0), marching_cubes(smooth, 0.0, topology="trilinear")
    assert classic.faces.tobytes() == exact.faces.tobytes()


def test_corner_values_are_those_of_the_voxels_eight_samples():
    values = np.random.default_rng(3).normal(size=(6, 7, 8))
    grid = make_grid(values, (3, 2, 1))
    samples = np.array([[0, 2], [1, 0], [4, 3]])
    found = corner_values(tuple(samples), grid, Sampler(values))
    for voxel, (x, y, z) in enumerate(samples.T):
        z, y, x = grid.z.index[z : z + 2], grid.y.index[y : y + 2], grid.x.index[x : x + 2]
        np.testing.assert_array_equal(found[voxel], values[np.ix_(z, y, x)].ravel())


@pytest.mark.parametrize("at_once", [1, 1 << 16])
@pytest.mark.parametrize("close_border", [False, True])
def test_slabs_that_are_decided_at_once_become_what_each_becomes_alone(close_border, at_once, monkeypatch):
    monkeypatch.setattr(interior_vertices, "DECIDED_AT_ONCE", at_once)
    values = np.random.default_rng(5).normal(size=(9, 12, 11))
    values[3:6] = 1.0  # a slab without an ambiguous voxel is among them
    grid = make_grid(values, close_border=close_border)
    bits = np.zeros((grid.z.count + 1, grid.y.count + 1, grid.words), np.uint64)
    inside_bits(grid, 0.0, 0, grid.z.count, bits)
    cuts = [0, 3, 5, grid.z.count]
    slabs = [find_active(grid, bits, low, high) for low, high in pairwise(cuts)]
    sampler = Sampler(values)
    together = with_trilinear_topology(slabs, grid, sampler, 0.0)
    alone = [with_trilinear_topology([slab], grid, sampler, 0.0)[0] for slab in slabs]
    assert [len(slab.with_interior) > 0 for slab in together] == [True, False, True]
    for both in zip(together, alone, strict=True):
        for name in ("configuration", "with_interior", "corner_values"):
            np.testing.assert_array_equal(*(getattr(slab, name) for slab in both))
