# SPDX-License-Identifier: GPL-3.0-or-later
"""Decide ambiguous voxels by the trilinear interpolant, and place the vertices inside them.

active_voxels.py gives every voxel its case, decider.py decides by gray values; this is where the two meet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...mesh.triangle_mesh import blend
from ..active_voxels import Slab
from ..gradients import Sampler
from ..grid import Grid
from ..order import Runs
from ..vertices import VertexArrays
from .decider import NEEDS_DECISION, crossings, decide, interior_points, trilinear_tables

DECIDED_AT_ONCE = 1 << 16  # Decide this many ambiguous voxels at once, for little memory: noise has 30,000 in a slab.
HIGH = np.array([[corner >> axis & 1 for axis in range(3)] for corner in range(8)])
"""(8, 3) whether a corner is the high one along x, y, z."""


def with_trilinear_topology(slabs: Sequence[Slab], grid: Grid, sampler: Sampler, threshold: float) -> list[Slab]:
    """Return the slabs with the trilinear interpolant's surface in every ambiguous voxel.

    Most slabs have few of them, so several slabs are decided at once: it is a hundred calls either way.
    """
    of_slabs = [_ambiguous_voxels(slab) for slab in slabs]
    before = np.cumsum([0, *map(len, of_slabs[:-1])])
    cuts = [0, *(np.flatnonzero(np.diff(before // DECIDED_AT_ONCE)) + 1).tolist(), len(slabs)]
    new_slabs = []
    for low, high in pairwise(cuts):
        new_slabs += _decided(slabs[low:high], of_slabs[low:high], grid, sampler, threshold)
    return new_slabs


def _decided(
    slabs: Sequence[Slab], of_slabs: Sequence[NDArray[np.intp]], grid: Grid, sampler: Sampler, threshold: float
) -> list[Slab]:
    """Return the slabs with their ambiguous voxels `of_slabs` decided at once."""
    samples = zip(*(slab.samples(voxels) for slab, voxels in zip(slabs, of_slabs, strict=True)), strict=True)
    x, y, z = map(np.concatenate, samples)
    values = corner_values((x, y, z), grid, sampler)
    if grid.upper is not None:  # as far above the threshold as below the upper limit: one threshold for both
        values = np.minimum(values, threshold + (grid.upper - values))
    cases = [slab.configuration.take(voxels) for slab, voxels in zip(slabs, of_slabs, strict=True)]
    decided = decide(values, threshold, np.concatenate(cases).astype(np.uint8))
    has_interior = trilinear_tables().interior_count.take(decided) > 0
    new_slabs, end = [], 0
    for slab, voxels in zip(slabs, of_slabs, strict=True):
        own = slice(end, end := end + len(voxels))
        configuration = slab.configuration.copy()
        configuration[voxels] = decided[own]
        inside = np.flatnonzero(has_interior[own])
        new_slabs.append(
            replace(
                slab,
                configuration=configuration,
                with_interior=voxels[inside],
                corner_values=values[own][inside],
                tables=trilinear_tables(),
            )
        )
    return new_slabs


def _ambiguous_voxels(slab: Slab) -> NDArray[np.intp]:
    """Return the voxels with more than one possible surface, without ghost cells."""
    needs_decision = NEEDS_DECISION.take(slab.configuration)
    needs_decision[slab.ghosts] = False
    return np.flatnonzero(needs_decision)


def corner_values(samples: tuple[NDArray[np.intp], ...], grid: Grid, sampler: Sampler) -> NDArray[np.float64]:
    """Gray values at the corners, (n, 8), of the voxels whose lowest is at the samples along x, y and z.

    Outside samples of a closed border repeat their neighbor's value.
    """
    x, y, z = (
        np.stack([along.index[:-1], along.index[1:]]).take(at, axis=1)  # (2, n)
        for along, at in zip((grid.x, grid.y, grid.z), samples, strict=True)
    )
    flat = sampler.flat_index(x, y[:, None], z[:, None, None])  # (2, 2, 2, n)
    return sampler.gather(flat).astype(np.float64).reshape(8, -1).T


def fill_interior_vertices(
    grid: Grid, threshold: float, slabs: Sequence[Slab], runs: Sequence[Runs], out: VertexArrays
) -> None:
    """Fill in the vertices inside voxels of some slabs, of which `runs` say where in `out` they stand.

    As normals they get the trilinear interpolant's own gradient. A slab has so few that most of the time would be that
    of beginning the calls.
    """
    counts = [slab.interior_counts for slab in slabs]
    # Of every vertex its voxel, counted in the slabs' `with_interior`, and which of that voxel's it is, 0 to 2.
    voxel, interior_number = np.nonzero(np.arange(3) < np.concatenate(counts)[:, None])
    if not voxel.size:
        return
    configuration = np.concatenate([slab.configuration.take(slab.with_interior) for slab in slabs]).take(voxel)
    values = np.concatenate([slab.corner_values for slab in slabs]).take(voxel, axis=0)
    samples = zip(*(slab.samples(slab.with_interior) for slab in slabs), strict=True)
    begin, end = np.empty((2, len(voxel), 3), np.float32)
    for axis, (along, of_slabs) in enumerate(zip((grid.x, grid.y, grid.z), samples, strict=True)):
        sample = np.concatenate(of_slabs).take(voxel)
        begin[:, axis], end[:, axis] = along.position.take(sample), along.position.take(sample + 1)
    side = end - begin

    share = crossings(values, threshold)
    points = interior_points(configuration, interior_number, share)
    linear = (begin + points * side).astype(np.float32)
    middle = (begin + trilinear_tables().interior_middle[configuration, interior_number] * side).astype(np.float32)
    positions = [linear if alpha is None else blend(middle, linear, alpha) for alpha in out.alphas]
    arrays: list[tuple[NDArray[np.float32], NDArray[Any]]] = [*zip(out.positions, positions, strict=True)]
    if out.normals is not None:
        arrays.append((out.normals, _outward_normals(values, points, side)))
    first = 0
    for of_slab, count in zip(runs, counts, strict=True):
        own = int(count.sum())
        for items, rows in of_slab.pieces(0, own):
            for target, source in arrays:
                target[rows] = source[first + items.start : first + items.stop]
        first += own


def _outward_normals(
    values: NDArray[np.float64], points: NDArray[np.float64], side: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Unit vectors against the trilinear interpolant's gradient, (n, 3); zero where it vanishes or is unknown.

    Parameters
    ----------
    values : (n, 8)
    points : (n, 3)
        A place in each voxel's unit cube.
    side : (n, 3)
        Sides of the voxels, in index space.
    """
    weight = np.stack([1.0 - points.T, points.T])  # of the low and the high corners along x, y, z: (2, 3, n)
    weights = weight[HIGH, np.arange(3)]  # (8, 3, n)
    slopes = np.where(HIGH, 1.0, -1.0)[:, :, None] * (weights[:, [1, 2, 0]] * weights[:, [2, 0, 1]])
    slopes *= values.T[:, None]
    gradient = np.zeros((3, len(points)))
    for slope in slopes:
        gradient += slope
    gradient /= side.T
    length = np.sqrt((gradient[0] ** 2 + gradient[1] ** 2) + gradient[2] ** 2)
    has_gradient = (length > 0) & np.isfinite(length)  # not where a corner is NaN or infinite
    return np.where(has_gradient, gradient * (-1.0 / np.where(has_gradient, length, 1.0)), 0.0).T
