"""Decide ambiguous voxels by the trilinear interpolant, and place the vertices inside them.

What `active` finds by cases, `trilinear` decides by grey values; this is where the two meet.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .active import Slab
from .mesh import Target, blend
from .normals import Sampler
from .sampling import Grid
from .trilinear import NEEDS, crossings, own_points, resolve, tables


def resolved(slab: Slab, grid: Grid, sampler: Sampler, threshold: float) -> Slab:
    """The slab with the row of the trilinear interpolant's surface for every ambiguous voxel."""
    ambiguous = np.flatnonzero(NEEDS.take(slab.row) & slab.whole)
    row = slab.row.copy()
    case = slab.row[ambiguous].astype(np.uint8)
    row[ambiguous] = resolve(corner_values(slab, ambiguous, grid, sampler), threshold, case)
    inner = ambiguous[tables().own_count[row[ambiguous]] > 0]
    return replace(slab, row=row, inner=inner, tables=tables())


def corner_values(slab: Slab, voxels: NDArray[np.intp], grid: Grid, sampler: Sampler) -> NDArray[np.float64]:
    """Grey values at the eight corners of some voxels, (n, 8); outside samples of a closed border repeat theirs."""
    samples = [sample.astype(np.intp) for sample in slab.samples(slab.place.take(voxels))]
    ends = [
        (along.index.take(at), along.index.take(at + 1))
        for along, at in zip((grid.x, grid.y, grid.z), samples, strict=True)
    ]
    values = np.empty((len(voxels), 8))
    for corner in range(8):
        x, y, z = (ends[axis][corner >> axis & 1] for axis in range(3))
        values[:, corner] = sampler.take(sampler.place(x, y, z))
    return values


def fill_inner(
    slab: Slab,
    grid: Grid,
    sampler: Sampler,
    threshold: float,
    targets: list[Target],
    directions: NDArray[np.float32] | None,
) -> None:
    """Fill in the vertices inside the slab's voxels, and as normals the trilinear interpolant's own gradient."""
    row = slab.row[slab.inner].astype(np.intp)
    values = corner_values(slab, slab.inner, grid, sampler)
    share = crossings(values, threshold)
    exists = np.arange(3) < tables().own_count[row][:, None]  # (voxels, 3)
    samples = slab.samples(slab.place.take(slab.inner))
    ends = [
        (along.position[at], along.position[at + 1])
        for along, at in zip((grid.x, grid.y, grid.z), samples, strict=True)
    ]

    def placed(points: NDArray[np.float64]) -> NDArray[np.float32]:
        moved = [begin[:, None] + points[:, :, axis] * (end - begin)[:, None] for axis, (begin, end) in enumerate(ends)]
        return np.stack(moved, axis=2)[exists].astype(np.float32)

    at_linear = own_points(row, share)  # (voxels, 3, 3)
    linear = placed(at_linear)
    middle = placed(own_points(row, np.full_like(share, 0.5)))
    for alpha, position in targets:
        position[:] = linear if alpha is None else blend(middle, linear, alpha)
    if directions is not None:
        sides = np.stack([end - begin for begin, end in ends], axis=1).astype(np.float64)
        directions[:] = _outward(values, at_linear, sides)[exists]


def _outward(
    values: NDArray[np.float64], points: NDArray[np.float64], sides: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Unit vectors against the trilinear interpolant's gradient, (n, 3, 3); zero where it vanishes or is unknown.

    Parameters
    ----------
    values : (n, 8)
    points : (n, 3, 3)
        Three places in each voxel's unit cube.
    sides : (n, 3)
        Sides of the voxels, in voxel indices.
    """
    gradient = np.zeros_like(points)
    for corner in range(8):
        weights = [points[:, :, axis] if corner >> axis & 1 else 1.0 - points[:, :, axis] for axis in range(3)]
        for axis in range(3):
            sign = 1.0 if corner >> axis & 1 else -1.0
            across = weights[(axis + 1) % 3] * weights[(axis + 2) % 3]
            gradient[:, :, axis] += sign * across * values[:, corner, None]
    gradient /= sides[:, None, :]
    length = np.sqrt((gradient[..., 0] ** 2 + gradient[..., 1] ** 2) + gradient[..., 2] ** 2)
    known = (length > 0) & np.isfinite(length)  # unknown where a corner is NaN or infinite
    return np.where(known[..., None], gradient * (-1.0 / np.where(known, length, 1.0))[..., None], 0.0)
