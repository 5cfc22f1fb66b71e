# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals from the gray values: central differences, interpolated to the vertex.

Su and Ma, eq. 2 to 4. One departure: under a stride the differences are those of the volume's own
neighboring voxels, not of the enlarged voxel's corners as equation 4 read literally would have it.
The wider difference would blur the shading for nothing.

In index space; pipeline.py carries normals to millimeters by affine.py. Example: on an edge along x from sample 4
to 6 with the crossing at 4.4, the gradient is that of the values at columns 4 and 5, interpolated by 0.4.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from ..mesh.face_normals import vertex_normals_steps
from ..progress import Steps

EDGES_AT_ONCE = 1 << 13  # whose normals are worked out together: their arrays stay in the cache


class Sampler:
    """Values of a volume at scattered places, from any memory layout and byte order, without a copy of it.

    Parameters
    ----------
    values : (slices, rows, columns)
        Seen as one flat array, in which column x, row y, slice z stands at the flat index
        ``x * steps[0] + y * steps[1] + z * steps[2]``, counted from the first value in memory.
    first_slice, slices : int
        Which slice of the volume the values begin with, and how many it has; by default the values are all.
    """

    def __init__(self, values: NDArray[Any], first_slice: int = 0, slices: int | None = None) -> None:
        item = values.dtype.itemsize
        unit = item if all(step % item == 0 for step in values.strides) else math.gcd(*values.strides)
        # A view that runs upwards in memory, whatever axes are turned.
        upwards = values[tuple(slice(None, None, -1 if step < 0 else 1) for step in values.strides)]
        reach = sum((size - 1) * step for size, step in zip(upwards.shape, upwards.strides, strict=True))
        self.size = (*values.shape[:0:-1], slices or values.shape[0])
        self.steps = tuple(step // unit for step in values.strides[::-1])
        self.may_be_nan = values.dtype.kind == "f"
        self._flat = as_strided(upwards, (reach // unit + 1,), (unit,), writeable=False)
        self._contiguous = unit == item
        sizes = values.shape[::-1]
        self._first = sum((1 - size) * step for size, step in zip(sizes, self.steps, strict=True) if step < 0)
        self._first -= first_slice * self.steps[2]
        # Differences of values of up to 16 bits are exact in float32.
        narrow = values.dtype.kind in "bui" and item <= 2
        self.working_type = np.dtype(np.float32 if narrow else np.float64)

    def flat_index(self, x: NDArray[np.intp], y: NDArray[np.intp], z: NDArray[np.intp]) -> NDArray[np.intp]:
        """Where the values at column x, row y, slice z stand."""
        return x * self.steps[0] + y * self.steps[1] + (z * self.steps[2] + self._first)

    def gather(self, flat: NDArray[np.intp]) -> NDArray[Any]:
        """The values at flat indices, in the working type."""
        # Indices are always within; "clip" spares NumPy a second look at each.
        values = self._flat.take(flat, mode="clip") if self._contiguous else self._flat[flat]
        return values.astype(self.working_type)

    def difference(self, flat: NDArray[np.intp], coordinate: NDArray[np.intp], axis: int) -> NDArray[Any]:
        """Central difference along an axis (0, 1, 2 for x, y, z) at flat indices, a voxel apart; one-sided at borders.

        `coordinate` is the column, row or slice that the flat indices have along that axis.
        """
        step = self.steps[axis]
        first, last = np.flatnonzero(coordinate == 0), np.flatnonzero(coordinate == self.size[axis] - 1)
        above, below = flat + step, flat - step
        above[last] -= step
        below[first] += step
        rise = self.gather(above) - self.gather(below)
        rise *= 0.5
        rise[first] *= 2.0
        rise[last] *= 2.0
        return rise


def edge_normals(
    sampler: Sampler,
    index: list[NDArray[np.intp]],
    flat: NDArray[np.intp],
    along_axis: list[slice],
    position: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """Outward unit normals at points on the edges of voxels.

    Parameters
    ----------
    index : three (n,) intp
        Column, row and slice of the edges' low ends; overwritten.
    flat : (n,) intp
        The sampler's flat index of them; overwritten.
    along_axis : three slices
        Which of the edges run along x, along y, along z.
    position : (n,) float32
        Coordinate of each point along its edge, in index space.
    out : (n, 3) float32
        Zero where the gradient vanishes, or a voxel it is taken from is NaN or infinite.
    """
    for axis, edges in enumerate(along_axis):
        for start in range(edges.start, edges.stop, EDGES_AT_ONCE):
            block = slice(start, min(start + EDGES_AT_ONCE, edges.stop))
            _fill_normals(sampler, [along[block] for along in index], flat[block], axis, position[block], out[block])


def _fill_normals(
    sampler: Sampler,
    index: list[NDArray[np.intp]],
    flat: NDArray[np.intp],
    axis: int,
    position: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """`edge_normals` of edges along one axis."""
    # From the enlarged voxel's corner to the value just below the point.
    below = np.minimum(position.astype(np.intp), sampler.size[axis] - 2)
    share = (position - below).astype(sampler.working_type)
    flat += (below - index[axis]) * sampler.steps[axis]
    index[axis] = below
    gradient = [sampler.difference(flat, index[along], along) for along in range(3)]
    flat += sampler.steps[axis]
    index[axis] += 1
    for along in range(3):
        gradient[along] += share * (sampler.difference(flat, index[along], along) - gradient[along])
    length = np.sqrt((gradient[0] * gradient[0] + gradient[1] * gradient[1]) + gradient[2] * gradient[2])
    unknown = ~np.isfinite(length)  # a NaN or infinite voxel beside it
    length[(length == 0) | unknown] = 1.0
    scale = -1.0 / length
    for along in range(3):
        out[:, along] = gradient[along] * scale
    if unknown.any():
        out[unknown] = 0.0


def complete_normals_steps(
    normals: NDArray[np.float32], positions: NDArray[np.float32], faces: NDArray[np.int32]
) -> Steps[None]:
    """Give the mesh's own normal to every vertex that has no gradient or that lies on a cap."""
    missing = (normals[:, 0] == 0) & (normals[:, 1] == 0) & (normals[:, 2] == 0)
    if missing.any():
        touched = missing.take(faces[:, 0]) | missing.take(faces[:, 1]) | missing.take(faces[:, 2])
        normals[missing] = (yield from vertex_normals_steps(positions, faces[touched]))[missing]
