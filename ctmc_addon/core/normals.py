"""Normals from the grey values: central differences, interpolated to the vertex.

Su and Ma, eq. 2 to 4. One departure: under a stride the differences are those of the volume's own
neighbouring voxels, not of the enlarged voxel's corners as equation 4 read literally would have it.
The wider difference would blur the shading for nothing.

In index space; volume.py carries normals to millimetres.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray


class Sampler:
    """Values of a volume at scattered places, from any memory layout and byte order, without a copy of it."""

    def __init__(self, values: NDArray[Any]) -> None:
        """Take `values` (slices, rows, columns)."""
        item = values.dtype.itemsize
        unit = item if all(step % item == 0 for step in values.strides) else math.gcd(*values.strides)
        # A view that runs upwards in memory, and the one number that leads from it to any value.
        upwards = values[tuple(slice(None, None, -1 if step < 0 else 1) for step in values.strides)]
        reach = sum((size - 1) * step for size, step in zip(upwards.shape, upwards.strides, strict=True))
        self.shape = values.shape
        self._flat = as_strided(upwards, (reach // unit + 1,), (unit,), writeable=False)
        self._steps = tuple(step // unit for step in values.strides)
        self._first = sum((1 - size) * step for size, step in zip(values.shape, self._steps, strict=True) if step < 0)
        # Sums and differences of two values are exact in the narrower type up to 16 bits.
        narrow = values.dtype.kind in "bui" and item <= 2
        self.working_type = np.dtype(np.float32 if narrow else np.float64)

    def place(self, x: NDArray[np.intp], y: NDArray[np.intp], z: NDArray[np.intp]) -> NDArray[np.intp]:
        """Place of the values at column x, row y, slice z."""
        return x * self._steps[2] + (y * self._steps[1] + (z * self._steps[0] + self._first))

    def take(self, place: NDArray[np.intp]) -> NDArray[Any]:
        """The values at `place`, in the working type."""
        return self._flat[place].astype(self.working_type)

    def at(self, x: NDArray[np.intp], y: NDArray[np.intp], z: NDArray[np.intp]) -> NDArray[Any]:
        """The values at column x, row y, slice z, in the working type."""
        return self.take(self.place(x, y, z))

    def slope(self, place: NDArray[np.intp], coordinate: NDArray[np.intp], axis: int) -> NDArray[Any]:
        """Difference of the values along an axis for one voxel, central, at the border one-sided."""
        size, step = self.shape[2 - axis], self._steps[2 - axis]
        above, below = coordinate < size - 1, coordinate > 0
        rise = self.take(place + above * step) - self.take(place - below * step)
        return rise / (above.astype(self.working_type) + below.astype(self.working_type))


def edge_normals(
    sampler: Sampler,
    axis: int,
    index: list[NDArray[np.intp]],
    position: NDArray[np.float32],
    on_cap: NDArray[np.bool_],
) -> NDArray[np.float32]:
    """Outward unit normals at places on edges along one axis.

    Parameters
    ----------
    axis : int
        0, 1, 2 for edges along x, y, z.
    index : three (n,) intp
        Column, row and slice of the edge's low end.
    position : (n,) float32
        Where on the edge, in voxel indices along the axis.
    on_cap : (n,) bool
        Vertices of the cap that closes a border: the grey values have no gradient there.

    Returns
    -------
    (n, 3) float32
        Zero on caps and where the gradient vanishes.
    """
    low = np.clip(position.astype(np.intp), 0, sampler.shape[2 - axis] - 2)
    share = (position - low.astype(np.float32)).astype(sampler.working_type)
    slopes = []
    for end in range(2):
        at = [low + end if each == axis else index[each] for each in range(3)]
        place = sampler.place(*at)
        slopes.append([sampler.slope(place, at[each], each) for each in range(3)])
    gradient = [first + share * (second - first) for first, second in zip(*slopes, strict=True)]
    length = np.sqrt((gradient[0] * gradient[0] + gradient[1] * gradient[1]) + gradient[2] * gradient[2])
    scale = np.where(on_cap | (length == 0), 0.0, -1.0 / np.where(length == 0, 1.0, length))
    return np.stack([part * scale for part in gradient], axis=1).astype(np.float32)
