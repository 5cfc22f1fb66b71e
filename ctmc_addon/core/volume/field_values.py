# SPDX-License-Identifier: GPL-3.0-or-later
"""The values that a surface is extracted from, some slices at a time: gray values, a label's 0 and 1, or others.

Slices are counted from the first of the box that the values are of.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..budget import Budget
from ..errors import VolumeError
from ..parallel import map_steps
from ..progress import PAUSE, Steps
from .smoothing.gaussian import smoothed_middle, smoothed_plane, weights
from .statistics import slabs_of
from .volume import Box, Volume

SMOOTHING = "Smoothing"
SLICES = 16  # A label is compared with so many at once: what is rounded as it is read takes memory for these alone.


class FieldValues(Protocol):
    """Values (slices, rows, columns) that are fetched in the order of the slices."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """(slices, rows, columns)."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of the values."""

    @property
    def held(self) -> bool:
        """Whether all slices may be fetched at once, as what they are made of is in memory."""

    @property
    def own_bytes(self) -> int:
        """Bytes of all slices, where they are fetched at once and are no view of the volume's values; else 0."""

    @property
    def skips_slices(self) -> bool:
        """Whether slices that are not sampled need not be fetched."""

    @property
    def wrong_side(self) -> int:
        """Samples of a label, in the slices fetched so far, that smoothing has put on the other side of the level."""

    def again(self) -> FieldValues:
        """The same values, to be fetched from the first slice."""

    def slices_steps(self, numbers: Sequence[int]) -> Steps[NDArray[Any]]:
        """Fetch the values of slices with rising numbers, (slices, rows, columns)."""


class GrayValues:
    """Gray values of a volume, NaN replaced or refused.

    Parameters
    ----------
    volume : Volume
        The box that is extracted.
    needed : Box
        Where in it no value may be NaN or infinite, unless they are replaced.
    nan_as : float, optional
        What replaces NaN and infinite values.
    """

    own_bytes = wrong_side = 0

    def __init__(self, volume: Volume, needed: Box, nan_as: float | None) -> None:
        self.volume, self.needed, self.nan_as = volume, needed, nan_as
        self.shape = volume.shape
        self.dtype = np.dtype(np.uint8) if volume.dtype == bool else volume.dtype
        self.held = volume.reader.own_bytes == 0 and (nan_as is None or self.dtype.kind != "f")
        self.skips_slices = self.dtype.kind != "f"

    def again(self) -> GrayValues:
        """The same values, to be fetched from the first slice."""
        return GrayValues(self.volume, self.needed, self.nan_as)

    def slices_steps(self, numbers: Sequence[int]) -> Steps[NDArray[Any]]:
        """Fetch the values of slices with rising numbers, (slices, rows, columns)."""
        values = yield from fetched_steps(self.volume, numbers)
        if values.dtype == bool:
            return values.view(np.uint8)
        return self._finite(values, numbers) if values.dtype.kind == "f" else values

    def _finite(self, values: NDArray[Any], numbers: Sequence[int]) -> NDArray[Any]:
        if all(np.isfinite(layer).all() for layer in values):
            return values
        if self.nan_as is not None:
            return np.where(np.isfinite(values), values, values.dtype.type(self.nan_as))
        x, y, z = self.needed
        for layer, number in zip(values, numbers, strict=True):
            if z[0] <= number < z[1] and not np.isfinite(layer[slice(*y), slice(*x)]).all():
                needed = self.volume.part(self.needed)
                count = sum(int(slab.size - np.count_nonzero(np.isfinite(slab))) for slab in slabs_of(needed))
                raise VolumeError(not_finite_text(count))
        return values


class LabelMask:
    """A label's 0 and 1.

    Parameters
    ----------
    volume : Volume
        The box that is extracted.
    label : int
    """

    wrong_side = 0
    skips_slices = True

    def __init__(self, volume: Volume, label: int) -> None:
        self.volume, self.label = volume, label
        self.shape, self.dtype = volume.shape, np.dtype(np.uint8)
        self.held = volume.reader.own_bytes == 0
        self.own_bytes = math.prod(self.shape) if self.held else 0

    def again(self) -> LabelMask:
        """The same values, to be fetched from the first slice."""
        return LabelMask(self.volume, self.label)

    def slices_steps(self, numbers: Sequence[int]) -> Steps[NDArray[Any]]:
        """Fetch the values of slices with rising numbers, (slices, rows, columns)."""
        out = np.empty((len(numbers), *self.shape[1:]), bool)
        for start in range(0, len(numbers), SLICES):
            part = slice(start, start + SLICES)
            np.equal((yield from fetched_steps(self.volume, numbers[part])), self.label, out=out[part])
        return out.view(np.uint8)


class HeldValues:
    """Values that are in memory.

    Parameters
    ----------
    values : (slices, rows, columns)
    wrong_side : int
    """

    held = skips_slices = True

    def __init__(self, values: NDArray[Any], wrong_side: int = 0) -> None:
        self.values, self.wrong_side = values, wrong_side
        slices, rows, columns = values.shape
        self.shape, self.dtype, self.own_bytes = (slices, rows, columns), values.dtype, values.nbytes

    def again(self) -> HeldValues:
        """The same values, to be fetched from the first slice."""
        return self

    def slices_steps(self, numbers: Sequence[int]) -> Steps[NDArray[Any]]:
        """Fetch the values of slices with rising numbers, (slices, rows, columns)."""
        yield PAUSE
        run = len(numbers) > 0 and len(numbers) == numbers[-1] - numbers[0] + 1
        return self.values[numbers[0] : numbers[-1] + 1] if run else self.values[list(numbers)]


class GaussianValues:
    """Other values, smoothed by a Gaussian, the border repeated; the sums are those of the whole box.

    Parameters
    ----------
    values : GrayValues or LabelMask
    spacing_mm : (x, y, z) float
    sigma_mm : float
    counted : Box, optional
        Where samples of a label on the wrong side are counted: a label's.
    level : float
        Inside is ``value >= level``.
    budget : Budget
    """

    held = skips_slices = False
    own_bytes = 0

    def __init__(
        self,
        values: GrayValues | LabelMask,
        spacing_mm: Sequence[float],
        sigma_mm: float,
        counted: Box | None,
        level: float,
        budget: Budget,
    ) -> None:
        self.values, self.spacing_mm, self.sigma_mm = values, spacing_mm, sigma_mm
        self.counted, self.level, self.budget = counted, level, budget
        self.shape, self.dtype = values.shape, np.dtype(np.float32)
        self.wrong_side = 0
        self._kernels = [weights(sigma_mm / side) for side in spacing_mm]
        self._planes: dict[int, NDArray[np.float32]] = {}  # slices that are smoothed along x and y
        self._masks: dict[int, NDArray[np.uint8]] = {}
        self._next, self._end = 0, self.shape[0]  # slices whose wrong side is still to be counted

    def again(self) -> GaussianValues:
        """The same values, to be fetched from the first slice."""
        again = self.values.again()
        return GaussianValues(again, self.spacing_mm, self.sigma_mm, self.counted, self.level, self.budget)

    def slices_steps(self, numbers: Sequence[int]) -> Steps[NDArray[Any]]:
        """Fetch the values of slices with rising numbers, (slices, rows, columns)."""
        if not len(numbers):
            return np.empty((0, *self.shape[1:]), self.dtype)
        along_x, along_y, along_z = self._kernels
        threads = self.budget.thread_count
        reach, last = len(along_z) - 1, self.shape[0] - 1
        low, high = max(0, numbers[0] - reach), min(last, numbers[-1] + reach) + 1
        self._planes = {number: plane for number, plane in self._planes.items() if number >= low}
        missing = [number for number in range(low, high) if number not in self._planes]
        fetched = yield from self.values.slices_steps(missing)
        planes = yield from map_steps(
            lambda plane: smoothed_plane(plane, along_x, along_y), list(fetched), threads, SMOOTHING
        )
        self._planes |= dict(zip(missing, planes, strict=True))

        def across(number: int) -> NDArray[np.float32]:
            around = range(number - reach, number + reach + 1)
            return smoothed_middle([self._planes[min(max(at, 0), last)] for at in around], along_z)

        smoothed = np.stack((yield from map_steps(across, numbers, threads, SMOOTHING)))
        if self.counted is not None:
            self._masks = {number: mask for number, mask in self._masks.items() if number >= numbers[0]}
            self._masks |= dict(zip(missing, fetched, strict=True))
            self._count(smoothed, numbers, self.counted)
        return smoothed

    def count_within(self, first: int, stop: int) -> None:
        """Count samples on the wrong side in the slices from `first` to `stop` alone."""
        self._next, self._end = first, stop

    def _count(self, smoothed: NDArray[np.float32], numbers: Sequence[int], counted: Box) -> None:
        x, y, z = counted
        for values, number in zip(smoothed, numbers, strict=True):
            if max(z[0], self._next) <= number < min(z[1], self._end):
                inside = values[slice(*y), slice(*x)] >= self.level
                self.wrong_side += int(np.count_nonzero(inside != self._masks[number][slice(*y), slice(*x)]))
                self._next = number + 1


def fetched_steps(volume: Volume, numbers: Sequence[int]) -> Steps[NDArray[Any]]:
    """Fetch the slices of a volume with rising numbers, (slices, rows, columns): a view where that is possible."""
    rows, columns = range(volume.shape[1]), range(volume.shape[2])
    parts = []
    for run in runs_of(list(numbers)):
        yield PAUSE
        parts.append(volume.samples(run, rows, columns))
    if not parts:
        return np.empty((0, len(rows), len(columns)), volume.dtype)
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def runs_of(numbers: list[int]) -> Iterator[range]:
    """Rising numbers as ranges.

    Examples
    --------
    >>> list(runs_of([0, 4, 8, 10]))
    [range(0, 9, 4), range(10, 11)]
    """
    start = 0
    while start < len(numbers):
        step = numbers[start + 1] - numbers[start] if start + 1 < len(numbers) else 1
        end = start + 1
        while end < len(numbers) and numbers[end] - numbers[end - 1] == step:
            end += 1
        yield range(numbers[start], numbers[end - 1] + 1, step)
        start = end


def not_finite_text(count: int) -> str:
    """Return what is wrong with values that are not finite, and the remedy."""
    return f"{count} voxels are NaN or infinite; replace them with nan_as, such as -1024 in HU"
