# SPDX-License-Identifier: GPL-3.0-or-later
"""Which values of a volume are the corners of voxels: its samples.

Voxels have sides of `stride` pixels; the last one along an axis is cut short at the border, so a
coarse surface is never cut off (Su and Ma, 3.1, figures 3 to 5). With a closed border one more
sample, always outside, stands a pixel outside at either end: no copy of the volume is padded.

A sample number counts along one axis. `Axis.index` leads from it to the volume's values, `Axis.position` to index
space. Example: 6 values along x, a stride of 2, a closed border:

    sample number    0   1   2   3   4   5
    index            0   0   2   4   5   5     the outside samples repeat their neighbors
    position        -1   0   2   4   5   6
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SettingsError

WORD = 64
UNIT_SAMPLES = 1 << 22  # A unit (order.py) has this many samples, or those of one layer.
WIDER = 8


@dataclass(frozen=True)
class Axis:
    """The samples along one axis.

    Parameters
    ----------
    position : (n,) float32
        Positions of the samples, in index space.
    index : (n,) intp
        Indices of the samples in the volume; a closed border's outside samples repeat the outermost.
    start, stop, stride : int
        The volume's indices that are sampled: range(start, stop, stride), then `stop - 1`.
    closed : bool
        Whether there is an outside sample at either end.
    """

    position: NDArray[np.float32]
    index: NDArray[np.intp]
    start: int
    stop: int
    stride: int
    closed: bool

    @property
    def count(self) -> int:
        """Number of samples, the outside ones among them."""
        return len(self.index)

    @property
    def voxels(self) -> int:
        """Number of voxels between the samples that are values of the volume."""
        return self.count - 1 - 2 * self.closed

    @property
    def valued(self) -> tuple[int, int]:
        """Numbers (first, end) of the samples that are values of the volume, not outside ones."""
        return int(self.position[0] < self.start), self.count - int(self.position[-1] >= self.stop)

    def part(self, low: int, high: int) -> Axis:
        """Return the samples `low` to `high`, `high` left out; positions and indices stay those of the whole."""
        return replace(self, position=self.position[low:high], index=self.index[low:high])


def sample_axis(start: int, stop: int, stride: int, closed: bool) -> Axis:
    """Samples at start, start + stride, ..., and at stop - 1 in any case.

    Examples
    --------
    >>> sample_axis(0, 6, 2, closed=False).index.tolist()
    [0, 2, 4, 5]
    >>> sample_axis(0, 6, 2, closed=True).position.tolist()
    [-1.0, 0.0, 2.0, 4.0, 5.0, 6.0]
    """
    index = [*range(start, stop - 1, stride), stop - 1]
    position = [start - 1, *index, stop] if closed else index
    index = [start, *index, stop - 1] if closed else index
    return Axis(np.array(position, np.float32), np.array(index, np.intp), start, stop, stride, closed)


@dataclass(frozen=True, eq=False)
class Grid:
    """A volume's values and the samples taken of them along x, y and z.

    Parameters
    ----------
    values : (slices, rows, columns)
        All slices of the volume, or some that follow one another.
    x, y, z : Axis
    first_slice : int
        First slice of the values in the volume.
    slices : int, optional
        Number of slices of the volume; by default that of the values.
    continues : bool
        Whether the last layer of samples is only the upper side of voxels, as more layers follow in the volume.
    upper : float, optional
        Values above it are outside; by default none is too high.
    """

    values: NDArray[Any]
    x: Axis
    y: Axis
    z: Axis
    first_slice: int = 0
    slices: int | None = None
    continues: bool = False
    upper: float | None = None

    @property
    def layers(self) -> int:
        """Number of layers of samples that are the lower side of voxels, ghost cells among them."""
        return self.z.count - self.continues

    @property
    def window_values(self) -> NDArray[Any]:
        """The values between the outermost samples, (slices, rows, columns); a view."""
        return self.values[tuple(slice(axis.start, axis.stop) for axis in (self.z, self.y, self.x))]

    @property
    def voxels(self) -> int:
        """Number of voxels between the samples of the volume, active or not."""
        return self.x.voxels * self.y.voxels * self.z.voxels

    @property
    def unit(self) -> int:
        """Return the number of layers of samples in a unit of the order of vertices and triangles."""
        return layers_in_unit(self.x, self.y, self.z)

    @property
    def words(self) -> int:
        """Number of 64 bit words a row of samples takes."""
        return -(-self.x.count // WORD)


def layers_in_unit(x: Axis, y: Axis, z: Axis) -> int:
    """Return how many layers of samples are a unit of the order of vertices and triangles.

    Under a stride a unit may span `WIDER` times as many values.

    Examples
    --------
    >>> def unit(size, stride):
    ...     along = sample_axis(0, size, stride, closed=False)
    ...     return layers_in_unit(along, along, along)
    >>> unit(512, 1), unit(100, 1), unit(4096, 1), unit(512, 4)
    (16, 419, 1, 32)
    """
    values = (x.stop - x.start) * (y.stop - y.start) * z.stride
    return max(1, UNIT_SAMPLES // max(x.count * y.count, values // WIDER))


def check_stride(stride: int | tuple[int, int, int], window: Sequence[tuple[int, int]]) -> tuple[int, int, int]:
    """Return the stride along x, y and z, or raise a `SettingsError` if it does not fit the window.

    Examples
    --------
    >>> check_stride(2, ((0, 6), (0, 6), (0, 6)))
    (2, 2, 2)
    """
    strides = (stride,) * 3 if isinstance(stride, int | np.integer) else tuple(stride)
    if len(strides) != 3:
        raise SettingsError(f"stride takes 3 numbers, x, y and z, not {len(strides)}: {strides}")
    for name, (start, stop), step in zip("xyz", window, strides, strict=True):
        if step != int(step) or not 1 <= step < stop - start:
            raise SettingsError(
                f"stride {step} along {name} must be a whole number from 1 to {stop - start - 1}, "
                f"since there are {stop - start} samples along {name}"
            )
    x, y, z = (int(step) for step in strides)
    return x, y, z


def make_grid(
    values: NDArray[Any],
    stride: int | tuple[int, int, int] = (1, 1, 1),
    close_border: bool = False,
    window: tuple[tuple[int, int], tuple[int, int], tuple[int, int]] | None = None,
    upper: float | None = None,
) -> Grid:
    """Return the samples of `values` (slices, rows, columns) inside `window` ((x, stop), (y, stop), (z, stop)).

    Values above `upper` will be outside.

    Raises
    ------
    SettingsError
        If a stride is below 1 or larger than the window, or there are not three.
    """
    ranges = window or tuple((0, size) for size in values.shape[::-1])
    x, y, z = make_axes(ranges, stride, close_border)
    return Grid(values.view(np.uint8) if values.dtype == bool else values, x, y, z, upper=upper)


def make_axes(
    window: Sequence[tuple[int, int]], stride: int | tuple[int, int, int], close_border: bool
) -> tuple[Axis, Axis, Axis]:
    """Return the samples along x, y and z inside a window ((x, stop), (y, stop), (z, stop))."""
    strides = check_stride(stride, window)
    x, y, z = (
        sample_axis(start, stop, step, close_border) for (start, stop), step in zip(window, strides, strict=True)
    )
    return x, y, z
