# SPDX-License-Identifier: GPL-3.0-or-later
"""Third pass: one vertex on every edge that the threshold crosses.

Positions are in index space (x = column, y = row, z = slice). Su and Ma, eq. 5 to 7. A slab's vertices stand in the
order in which faces.py numbers them: those on edges along x, then y, then z, each in the order of their voxels, then
those inside voxels (interior_vertices.py).

Example: gray values 100 and 200 at the samples x = 4 and x = 6 of a stride of 2, a threshold of 120: t = 0.2, so the
linear crossing (alpha 1) is at x = 4.4 and the midpoint (alpha 0) at x = 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import VolumeError
from ..mesh.triangle_mesh import blend
from .active_voxels import Slab
from .case_table import NEAREST
from .gradients import Sampler, edge_normals
from .grid import Grid


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

    def part(self, low: int, high: int) -> VertexArrays:
        """Views of the vertices `low` to `high`."""
        normals = None if self.normals is None else self.normals[low:high]
        return VertexArrays(self.alphas, tuple(position[low:high] for position in self.positions), normals)


def fill_edge_vertices(grid: Grid, sampler: Sampler, threshold: float, slab: Slab, out: VertexArrays) -> None:
    """Fill in a slab's vertices on edges, all of `out`."""
    axes = (grid.x, grid.y, grid.z)
    ends = np.cumsum([0] + [len(voxels) for voxels in slab.edge_owners])
    along_axis = [slice(ends[axis], ends[axis + 1]) for axis in range(3)]  # the edges along x, along y, along z
    slot = slab.slot.take(np.concatenate(slab.edge_owners))
    rank = slot >> 3
    first_x, y, z = slab.byte_samples()
    x = first_x.take(rank)
    x += slot & 7

    def at_edges(axis: int, by_sample: NDArray[Any], edges: slice = slice(None)) -> NDArray[Any]:
        """What belongs to the edges' low ends; along y and z all samples of a byte are the same."""
        return by_sample.take(x[edges]) if axis == 0 else by_sample.take((y, z)[axis - 1]).take(rank[edges])

    flat = sampler.flat_index(np.zeros(1, np.intp), grid.y.index.take(y), grid.z.index.take(z)).take(rank)
    flat += at_edges(0, grid.x.index * sampler.steps[0])
    flat_end = flat.copy()
    coordinates = [at_edges(axis, along.position) for axis, along in enumerate(axes)]
    begin, side = np.empty(len(slot), np.float32), np.empty(len(slot), np.float32)
    for axis, (along, edges) in enumerate(zip(axes, along_axis, strict=True)):
        flat_end[edges] += at_edges(axis, np.diff(along.index, append=0) * sampler.steps[axis], edges)
        begin[edges] = coordinates[axis][edges]
        side[edges] = at_edges(axis, np.diff(along.position, append=np.float32(0)), edges)
    low = sampler.gather(flat)
    rise = sampler.gather(flat_end) - low
    # The outside sample of a closed border repeats its neighbor's value: no rise, so the cap lies half-way.
    if sampler.may_be_nan and not np.isfinite(rise).all():
        raise VolumeError("there are NaN or infinite values beside the surface; read them as a number with nan_as")
    on_cap = rise == 0
    rise[on_cap] = 1.0
    t = (threshold - low) / rise
    t[on_cap] = 0.5
    np.clip(t, NEAREST, 1 - NEAREST, out=t)

    middle = begin + np.float32(0.5) * side
    linear = (begin + t * side).astype(np.float32)
    for alpha, position in zip(out.alphas, out.positions, strict=True):
        mixed = linear if alpha is None else blend(middle, linear, alpha)
        for axis, edges in enumerate(along_axis):
            coordinates[axis][edges] = mixed[edges]
            position[:, axis] = coordinates[axis]
    if out.normals is not None:
        index = [at_edges(axis, along.index) for axis, along in enumerate(axes)]
        edge_normals(sampler, index, flat, along_axis, linear, out.normals)
        out.normals[on_cap] = 0.0
