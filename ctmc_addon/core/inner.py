"""Decide ambiguous voxels by the trilinear interpolant, and place the vertices inside them.

What `active` finds by cases, `trilinear` decides by grey values; this is where the two meet.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .active import Slab
from .normals import Sampler
from .sampling import Grid
from .trilinear import NEEDS, crossings, own_points, resolve, tables


def resolved(slab: Slab, grid: Grid, sampler: Sampler, threshold: float) -> Slab:
    """The slab with the row of the trilinear interpolant's surface for every ambiguous voxel."""
    ambiguous = np.flatnonzero(NEEDS[slab.row] & slab.whole)
    row = slab.row.copy()
    case = slab.row[ambiguous].astype(np.uint8)
    row[ambiguous] = resolve(corner_values(slab, ambiguous, grid, sampler), threshold, case)
    inner = np.flatnonzero(tables().own_count[row] > 0)
    return replace(slab, row=row, inner=inner, tables=tables())


def corner_values(slab: Slab, voxels: NDArray[np.intp], grid: Grid, sampler: Sampler) -> NDArray[np.float64]:
    """Grey values at the eight corners of some voxels, (n, 8); outside samples of a closed border repeat theirs."""
    x, y, z = slab.samples(slab.place.take(voxels))
    values = np.empty((len(voxels), 8))
    for corner in range(8):
        place = sampler.place(
            grid.x.index[x + (corner & 1)], grid.y.index[y + (corner >> 1 & 1)], grid.z.index[z + (corner >> 2)]
        )
        values[:, corner] = sampler.take(place)
    return values


def inner_points(
    slab: Slab, grid: Grid, sampler: Sampler, threshold: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Places of the vertices inside the slab's voxels at alpha 0 and alpha 1, (n, 3) each, in index space."""
    row = slab.row[slab.inner]
    share = crossings(corner_values(slab, slab.inner, grid, sampler), threshold)
    exists = np.arange(3) < tables().own_count[row][:, None]  # (voxels, 3)
    samples = slab.samples(slab.place.take(slab.inner))

    def placed(shares: NDArray[Any]) -> NDArray[np.float32]:
        points = own_points(row.astype(np.intp), shares)  # (voxels, 3, 3)
        for axis, along in enumerate((grid.x, grid.y, grid.z)):
            begin, end = along.position[samples[axis]], along.position[samples[axis] + 1]
            points[:, :, axis] = begin[:, None] + points[:, :, axis] * (end - begin)[:, None]
        return points[exists].astype(np.float32)

    return placed(np.full_like(share, 0.5)), placed(share)
