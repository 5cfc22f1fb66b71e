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

from ..errors import VolumeError
from ..progress import PAUSE, Steps
from .statistics.values import slabs_of
from .volume import Box, Volume

SLICES = 16  # A label is compared with this many slices at once, so rounding takes memory only for these.


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
        """Return whether all slices may be fetched at once because their source is in memory."""

    @property
    def own_bytes(self) -> int:
        """Bytes of all slices, where they are fetched at once and are no view of the volume's values; else 0."""

    @property
    def skips_slices(self) -> bool:
        """Whether slices that are not sampled need not be fetched."""

    @property
    def mixes_samples(self) -> bool:
        """Return whether a value depends on samples around its own, which may lie beyond the window."""

    @property
    def wrong_side(self) -> int:
        """Samples of a label, in the slices fetched so far, that smoothing has put on the other side of the level."""

    def count_within(self, first: int, stop: int) -> None:
        """Count samples on the wrong side in the slices from `first` to `stop` only, if they are still counted."""

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
        Box in it in which no value may be NaN or infinite, unless they are replaced.
    nan_as : float, optional
        Number that replaces NaN and infinite values.
    """

    own_bytes = wrong_side = 0
    mixes_samples = False

    def __init__(self, volume: Volume, needed: Box, nan_as: float | None) -> None:
        self.volume, self.needed, self.nan_as = volume, needed, nan_as
        self.shape = volume.shape
        self.dtype = np.dtype(np.uint8) if volume.dtype == bool else volume.dtype
        self.held = volume.reader.own_bytes == 0 and (nan_as is None or self.dtype.kind != "f")
        self.skips_slices = self.dtype.kind != "f"

    def count_within(self, first: int, stop: int) -> None:
        """Count nothing: the wrong side of all slices is known."""

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
                raise VolumeError(_not_finite_text(count))
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
    mixes_samples = False

    def __init__(self, volume: Volume, label: int) -> None:
        self.volume, self.label = volume, label
        self.shape, self.dtype = volume.shape, np.dtype(np.uint8)
        self.held = volume.reader.own_bytes == 0
        self.own_bytes = math.prod(self.shape) if self.held else 0

    def count_within(self, first: int, stop: int) -> None:
        """Count nothing: the wrong side of all slices is known."""

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
    mixes_samples : bool
    """

    held = skips_slices = True

    def __init__(self, values: NDArray[Any], wrong_side: int = 0, mixes_samples: bool = False) -> None:
        self.values, self.wrong_side, self.mixes_samples = values, wrong_side, mixes_samples
        slices, rows, columns = values.shape
        self.shape, self.dtype, self.own_bytes = (slices, rows, columns), values.dtype, values.nbytes

    def count_within(self, first: int, stop: int) -> None:
        """Count nothing: the wrong side of all slices is known."""

    def again(self) -> HeldValues:
        """The same values, to be fetched from the first slice."""
        return self

    def slices_steps(self, numbers: Sequence[int]) -> Steps[NDArray[Any]]:
        """Fetch the values of slices with rising numbers, (slices, rows, columns)."""
        yield PAUSE
        run = len(numbers) > 0 and len(numbers) == numbers[-1] - numbers[0] + 1
        return self.values[numbers[0] : numbers[-1] + 1] if run else self.values[list(numbers)]


def fetched_steps(volume: Volume, numbers: Sequence[int]) -> Steps[NDArray[Any]]:
    """Fetch the slices of a volume with rising numbers, (slices, rows, columns): a view where that is possible."""
    rows, columns = range(volume.shape[1]), range(volume.shape[2])
    parts = []
    for run in _runs_of(list(numbers)):
        yield PAUSE
        parts.append(volume.samples(run, rows, columns))
    if not parts:
        return np.empty((0, len(rows), len(columns)), volume.dtype)
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _runs_of(numbers: list[int]) -> Iterator[range]:
    """Rising numbers as ranges.

    Examples
    --------
    >>> list(_runs_of([0, 4, 8, 10]))
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


def _not_finite_text(count: int) -> str:
    """Return the problem with values that are not finite, and the remedy."""
    return f"{count} voxels are NaN or infinite; replace them with nan_as, such as -1024 in HU"
