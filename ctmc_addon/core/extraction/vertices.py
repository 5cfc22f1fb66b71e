# SPDX-License-Identifier: GPL-3.0-or-later
"""Third pass: one vertex on every edge that the threshold crosses.

Positions are in index space (x = column, y = row, z = slice). Su and Ma, eq. 5 to 7. order.py says where each vertex
stands; those inside voxels are interior_vertices.py's.

Example: gray values 100 and 200 at the samples x = 4 and x = 6 of a stride of 2, a threshold of 120: t = 0.2, so the
linear crossing (alpha 1) is at x = 4.4 and the midpoint (alpha 0) at x = 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import VolumeError
from ..mesh.triangle_mesh import blend
from .active_voxels import BYTE, Slab
from .case_table import NEAREST
from .classify import highest_inside
from .gradients import NOWHERE, Sampler, fill_normals
from .grid import Axis, Grid
from .order import Pieces, Runs

EDGES_AT_ONCE = 1 << 16  # Fill in this many edges at once: their arrays stay in the cache.


@dataclass(frozen=True, eq=False)
class VertexArrays:
    """The vertices to be filled in.

    Parameters
    ----------
    alphas : tuple of float or None
        None is the linear crossing itself, which blending by 1 may miss by its last bit.
    positions : one (V, 3) float32 for each of `alphas`
    normals : (V, 3) float32 or None
        None where none are asked for.
    """

    alphas: tuple[float | None, ...]
    positions: tuple[NDArray[np.float32], ...]
    normals: NDArray[np.float32] | None


class _ByteSamples(NamedTuple):
    """The first samples of the bytes of a slab; along y and z all samples of a byte are at the same place."""

    sample: tuple[NDArray[np.intp], ...]  # three (m,): number along x, y, z
    position: tuple[NDArray[np.float32], ...]  # two (m,): along y, z
    flat: NDArray[np.intp]  # (m,): the sampler's flat indices at column 0.
    reach: tuple[tuple[int, int], ...]  # Lowest and highest index of the values at both ends of edges, along x, y, z.


def fill_edge_vertices(
    grid: Grid, sampler: Sampler, threshold: float, slab: Slab, runs: Sequence[Runs], out: VertexArrays
) -> None:
    """Fill in a slab's vertices on edges along x, y and z, of which `runs` say where in `out` they stand."""
    if not len(slab.byte):
        return
    x, y, z = sample = slab.byte_samples()
    position = (grid.y.position.take(y), grid.z.position.take(z))
    flat = sampler.flat_index(np.zeros(1, np.intp), grid.y.index.take(y), grid.z.index.take(z))
    reach = (_reach(grid.x, x, BYTE), _reach(grid.y, y, 1), _reach(grid.z, z, 1))
    first = _ByteSamples(sample, position, flat, reach)
    for axis, (slots, of_axis) in enumerate(zip(slab.edge_slots, runs, strict=False)):
        for start in range(0, len(slots), EDGES_AT_ONCE):
            slot = slots[start : start + EDGES_AT_ONCE]
            _fill_edges(grid, sampler, threshold, axis, first, slot, of_axis.pieces(start, len(slot)), out)


def _reach(along: Axis, sample: NDArray[np.intp], further: int) -> tuple[int, int]:
    """Lowest and highest index of the values from some samples to `further` samples behind them."""
    return int(along.index[sample.min()]), int(along.index[min(int(sample.max()) + further, along.count - 1)])


def _fill_edges(
    grid: Grid,
    sampler: Sampler,
    threshold: float,
    axis: int,
    first: _ByteSamples,
    slot: NDArray[np.intp],
    pieces: Pieces,
    out: VertexArrays,
) -> None:
    """Fill in the vertices on edges along x, y or z whose owners are at `slot`; they stand in `pieces` of `out`."""
    axes = (grid.x, grid.y, grid.z)
    along, step = axes[axis], sampler.steps[axis]
    rank = slot >> 3
    x = first.sample[0].take(rank)
    x += slot & 7
    flat = first.flat.take(rank)
    flat += (grid.x.index * sampler.steps[0]).take(x)
    position = [grid.x.position.take(x), *(of_byte.take(rank) for of_byte in first.position)]
    unit = along.stride == 1 and not along.closed  # the edges lie between neighboring values

    def sample(axis: int) -> NDArray[np.intp]:
        return first.sample[axis].take(rank) if axis else x

    low = sampler.gather(flat)
    if unit:
        high = sampler.gather(flat, step)
    else:
        high = sampler.gather(flat + (np.diff(along.index, append=0) * step).take(sample(axis)))
    above = NOWHERE  # the edges with an end above the upper limit, which are crossed there
    level: Any = threshold
    if grid.upper is not None:
        above = np.flatnonzero(np.maximum(low, high) > float(highest_inside(grid.upper, grid.values.dtype)))
        level = np.full(len(slot), threshold, low.dtype)
        level[above] = grid.upper
    rise = high - low
    # The outside sample of a closed border repeats its neighbor's value: no rise, so the cap lies half-way.
    if sampler.may_be_nan and not np.isfinite(rise).all():
        raise VolumeError("there are NaN or infinite values beside the surface; replace them with nan_as")
    on_cap = np.flatnonzero(rise == 0)
    rise[on_cap] = 1.0
    t = level - low
    t /= rise
    t[on_cap] = 0.5
    np.minimum(np.maximum(t, NEAREST, out=t), 1 - NEAREST, out=t)  # as `np.clip` with less overhead

    begin = position[axis]
    side = np.float32(1) if unit else np.diff(along.position, append=np.float32(0)).take(sample(axis))
    middle = begin + np.float32(0.5) * side
    linear = (begin + t * side).astype(np.float32, copy=False)
    for alpha, points in zip(out.alphas, out.positions, strict=True):
        position[axis] = linear if alpha is None else blend(middle, linear, alpha)
        for items, rows in pieces:
            for column, coordinate in enumerate(position):
                points[rows, column] = coordinate[items]
    if out.normals is None:
        return
    below: NDArray[Any] = begin  # index of the value just below each point
    if not unit:  # not the one at the enlarged voxel's corner
        below = np.minimum(linear.astype(np.intp), sampler.size[axis] - 2)
        flat += (below - along.index.take(sample(axis))) * step
        low, high = sampler.gather(flat), sampler.gather(flat, step)

    def places(axis_: int, index: int) -> NDArray[np.intp]:
        """Return the points just above values of this index along an axis, at the border of the volume."""
        lowest, highest = first.reach[axis_]
        if not lowest <= index <= highest:
            return NOWHERE
        return np.flatnonzero((below if axis_ == axis else axes[axis_].index.take(sample(axis_))) == index)

    share = (linear - below).astype(sampler.working_type, copy=False)
    normals = out.normals[pieces[0][1]] if len(pieces) == 1 else np.empty((len(slot), 3), np.float32)
    fill_normals(sampler, places, flat, (low, high), axis, share, normals)
    normals[on_cap] = 0.0
    if above.size:
        normals[above] *= -1.0  # values rise outwards there
    if len(pieces) > 1:
        for items, rows in pieces:
            out.normals[rows] = normals[items]
