# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals from the gray values: central differences, interpolated to the vertex.

Su and Ma, eq. 2 to 4. One departure: under a stride the differences are those of the volume's own
neighboring voxels, not of the enlarged voxel's corners as equation 4 read literally would have it.
The wider difference would blur the shading for nothing.

In index space; field_pieces.py carries normals to millimeters by affine.py. Example: on an edge along x from sample 4
to 6 with the crossing at 4.4, the gradient is that of the values at columns 4 and 5, interpolated by 0.4.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from ..mesh.face_normals import vertex_normals_steps
from ..progress import Step, Steps

NOWHERE = np.zeros(0, np.intp)  # No flat indices.


class Sampler:
    """Values of a volume at scattered samples, from any memory layout and byte order, without a copy of it.

    Parameters
    ----------
    values : (slices, rows, columns)
        Seen as one flat array, in which column x, row y, slice z stands at the flat index
        ``x * steps[0] + y * steps[1] + z * steps[2]``, counted from the first value in memory.
    first_slice, slices : int
        First slice of the values, and number of slices of the volume; by default the values are all.
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
        """Return the flat indices of the values at column x, row y and slice z."""
        return x * self.steps[0] + y * self.steps[1] + (z * self.steps[2] + self._first)

    def gather(self, flat: NDArray[np.intp], shift: int = 0) -> NDArray[Any]:
        """The values at flat indices, or as much further as `shift` says, in the working type; any beyond the ends."""
        last = len(self._flat) - 1
        if not self._contiguous:
            return self._flat[np.clip(flat + shift, 0, last)].astype(self.working_type)
        # A shifted view costs less than shifted indices.
        values = self._flat[min(shift, last) :] if shift > 0 else self._flat
        return values.take(flat + shift if shift < 0 else flat, mode="clip").astype(self.working_type)

    def difference(
        self, flat: NDArray[np.intp], axis: int, first: NDArray[np.intp], last: NDArray[np.intp], shift: int = 0
    ) -> NDArray[Any]:
        """Central differences along an axis (0, 1, 2 for x, y, z), a voxel apart, at `shift` from the flat indices.

        `first` and `last` are those of the places that lie in the volume's first and last plane along that axis: their
        differences are one-sided.
        """
        step = self.steps[axis]
        rise = self.gather(flat, shift + step)
        rise -= self.gather(flat, shift - step)
        rise *= 0.5
        for border, low, high in ((first, 0, step), (last, -step, 0)):
            if border.size:
                here = flat[border] + shift
                rise[border] = self.gather(here + high) - self.gather(here + low)
        return rise

    def edge_differences(
        self,
        flat: NDArray[np.intp],
        axis: int,
        ends: tuple[NDArray[Any], NDArray[Any]],
        first: NDArray[np.intp],
        last: NDArray[np.intp],
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return central differences at the low and high ends of edges along an axis, whose values are given.

        `first` and `last` are the edges that begin in the volume's first plane, and that end in its last one.
        """
        low, high = ends
        step = self.steps[axis]
        below = high - self.gather(flat, -step)
        above = self.gather(flat, 2 * step) - low
        for rise, border in ((below, first), (above, last)):
            rise *= 0.5
            rise[border] = high[border] - low[border]
        return below, above


def fill_normals(
    sampler: Sampler,
    places: Callable[[int, int], NDArray[np.intp]],
    flat: NDArray[np.intp],
    ends: tuple[NDArray[Any], NDArray[Any]],
    axis: int,
    share: NDArray[Any],
    out: NDArray[np.float32],
) -> None:
    """Outward unit normals at points between neighboring values along one axis.

    Parameters
    ----------
    places : callable
        Given an axis and an index, the points whose values just below have that column, row or slice.
    flat : (n,) intp
        The sampler's flat index of the values just below the points.
    ends : two (n,) float
        The values just below and just above the points, in the sampler's working type.
    axis : int
        0, 1, 2 for points between values along x, y, z.
    share : (n,) float
        Position of each point between the two values, 0 to 1, in the sampler's working type.
    out : (n, 3) float32
        Zero where the gradient vanishes, or a voxel it is taken from is NaN or infinite.
    """
    gradient = []
    for along, size in enumerate(sampler.size):
        if along == axis:
            below, change = sampler.edge_differences(flat, axis, ends, places(axis, 0), places(axis, size - 2))
        else:
            first, last = places(along, 0), places(along, size - 1)
            below = sampler.difference(flat, along, first, last)
            change = sampler.difference(flat, along, first, last, sampler.steps[axis])
        change -= below
        change *= share
        below += change
        gradient.append(below)
    length = np.sqrt((gradient[0] * gradient[0] + gradient[1] * gradient[1]) + gradient[2] * gradient[2])
    length[np.flatnonzero(length == 0)] = 1.0
    unknown = ~np.isfinite(length) if sampler.may_be_nan else NOWHERE  # a NaN or infinite voxel beside it
    length[unknown] = 1.0
    scale = -1.0 / length
    for along in range(3):
        np.multiply(gradient[along], scale, out=out[:, along], casting="same_kind")
    out[unknown] = 0.0


def complete_normals_steps(
    normals: NDArray[np.float32], positions: NDArray[np.float32], faces: NDArray[np.int32]
) -> Steps[None]:
    """Give the mesh's own normal to every vertex that has no gradient or that lies on a cap."""
    zero = np.flatnonzero(normals[:, 0] == 0)
    zero = zero[normals[zero, 1] == 0]
    zero = zero[normals[zero, 2] == 0]
    if zero.size:
        missing = np.zeros(len(normals), bool)
        missing[zero] = True
        touched = missing.take(faces[:, 0]) | missing.take(faces[:, 1]) | missing.take(faces[:, 2])
        normals[missing] = (yield from vertex_normals_steps(positions, faces[touched]))[missing]
    yield Step(1.0)
