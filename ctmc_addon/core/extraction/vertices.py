"""Place one vertex on every edge that the threshold crosses, and those that a voxel has inside.

Positions are in index space (x = column, y = row, z = slice). Su and Ma, eq. 5 to 7.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import VolumeError
from ..mesh.triangle_mesh import blend
from .active_voxels import Slab
from .case_table import NEAREST
from .gradients import Sampler, edge_normals
from .grid import Grid
from .interior_vertices import Target, fill_inner


def fill_vertices(
    grid: Grid,
    sampler: Sampler,
    threshold: float,
    slab: Slab,
    targets: list[Target],
    directions: NDArray[np.float32] | None,
) -> None:
    """Fill in a slab's vertices: those on edges along x, then y, then z, then those inside voxels."""
    on_edges = sum(len(voxels) for voxels in slab.owned)
    # What is NaN or infinite is refused, or left to the mesh's own normals; NumPy need not warn of it.
    with np.errstate(all="ignore"):
        _fill_edges(
            grid,
            sampler,
            threshold,
            slab,
            [(alpha, position[:on_edges]) for alpha, position in targets],
            None if directions is None else directions[:on_edges],
        )
        if on_edges < slab.vertices:
            fill_inner(
                slab,
                grid,
                threshold,
                [(alpha, position[on_edges:]) for alpha, position in targets],
                None if directions is None else directions[on_edges:],
            )


def _fill_edges(
    grid: Grid,
    sampler: Sampler,
    threshold: float,
    slab: Slab,
    targets: list[Target],
    directions: NDArray[np.float32] | None,
) -> None:
    axes = (grid.x, grid.y, grid.z)
    ends = np.cumsum([0] + [len(voxels) for voxels in slab.owned])
    parts = [slice(ends[axis], ends[axis + 1]) for axis in range(3)]
    cell = slab.cell.take(np.concatenate(slab.owned))
    eight = cell >> 3
    first_x, y, z = slab.eight_samples()
    x = first_x.take(eight)
    x += cell & 7

    def at_edges(axis: int, by_sample: NDArray[Any], part: slice = slice(None)) -> NDArray[Any]:
        """What belongs to the edges' low ends; along y and z all samples of an eight are the same."""
        return by_sample.take(x[part]) if axis == 0 else by_sample.take((y, z)[axis - 1]).take(eight[part])

    place = sampler.place(np.zeros(1, np.intp), grid.y.index.take(y), grid.z.index.take(z)).take(eight)
    place += at_edges(0, grid.x.index * sampler.steps[0])
    beyond = place.copy()
    coordinates = [at_edges(axis, along.position) for axis, along in enumerate(axes)]
    begin, side = np.empty(len(cell), np.float32), np.empty(len(cell), np.float32)
    for axis, (along, part) in enumerate(zip(axes, parts, strict=True)):
        beyond[part] += at_edges(axis, np.diff(along.index, append=0) * sampler.steps[axis], part)
        begin[part] = coordinates[axis][part]
        side[part] = at_edges(axis, np.diff(along.position, append=np.float32(0)), part)
    low = sampler.take(place)
    rise = sampler.take(beyond) - low
    # The outside sample of a closed border repeats its neighbour's value: no rise, so the cap lies half-way.
    if sampler.may_be_nan and not np.isfinite(rise).all():
        raise VolumeError("there are NaN or infinite values beside the surface; read them as a number with nan_as")
    on_cap = rise == 0
    rise[on_cap] = 1.0
    t = (threshold - low) / rise
    t[on_cap] = 0.5
    np.clip(t, NEAREST, 1 - NEAREST, out=t)

    middle = begin + np.float32(0.5) * side
    linear = (begin + t * side).astype(np.float32)
    for alpha, position in targets:
        mixed = linear if alpha is None else blend(middle, linear, alpha)
        for axis, part in enumerate(parts):
            coordinates[axis][part] = mixed[part]
            position[:, axis] = coordinates[axis]
    if directions is not None:
        index = [at_edges(axis, along.index) for axis, along in enumerate(axes)]
        edge_normals(sampler, index, place, parts, linear, directions)
        directions[on_cap] = 0.0
