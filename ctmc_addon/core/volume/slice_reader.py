# SPDX-License-Identifier: GPL-3.0-or-later
"""Read a volume's values from a file or from memory, some slices at a time."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_left
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..progress import Step, Steps

STEP_BYTES = 1 << 22  # Unpack this many bytes in a step, in 0.02 s.


class SliceReader(ABC):
    """Fetches values of a file; rising slices are the fastest, as a packed file cannot go back.

    Ask a reader what it can do; do not guess from its class.
    """

    shape: tuple[int, int, int]
    """(slices, rows, columns)."""
    dtype: np.dtype[Any]
    """The type of the values, in the machine's byte order."""
    chunk_slices: int = 1
    """How many slices it decodes at once, however few of them are asked for; the first chunk begins at slice 0."""
    thread_safe: bool = False
    """Whether several threads may call `fill` at the same time."""
    value_step: float = 0.0
    """The distance between neighboring values of a file that stores integers with a scale, if it is not whole."""

    @abstractmethod
    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Write the values into `out`, C order and of the reader's type; the ranges rise and lie within the shape."""

    @property
    def is_whole(self) -> bool:
        """Whether every value is known to be a whole number, because of the type or because it is made one."""
        return self.dtype.kind != "f"

    @property
    def notes(self) -> tuple[str, ...]:
        """Changes of the values read so far, in sentences for the user."""
        return ()

    @property
    def at_once(self) -> int:
        """Slices read between two steps."""
        return max(1, STEP_BYTES // max(1, self.shape[1] * self.shape[2] * self.dtype.itemsize))

    @property
    def own_bytes(self) -> int:
        """Bytes that reading all values adds to the memory in use."""
        slices, rows, columns = self.shape
        return slices * rows * columns * self.dtype.itemsize

    @property
    def everything(self) -> tuple[range, range, range]:
        """All slices, rows and columns."""
        slices, rows, columns = self.shape
        return range(slices), range(rows), range(columns)

    def read(self, slices: range, rows: range, columns: range) -> NDArray[Any]:
        """Return values (slices, rows, columns): a copy in C order, or a view of values in memory."""
        out = np.empty((len(slices), len(rows), len(columns)), self.dtype)
        self.fill(out, slices, rows, columns)
        return out

    def values_steps(self, slices: range, rows: range, columns: range) -> Steps[NDArray[Any]]:
        """Do what `read` does, as steps."""
        out = np.empty((len(slices), len(rows), len(columns)), self.dtype)
        for start in range(0, len(slices), self.at_once):
            yield Step(start / len(slices), "Reading slices")
            part = slice(start, start + self.at_once)
            self.fill(out[part], slices[part], rows, columns)
        return out

    def runs_steps(self, visit: Callable[[NDArray[Any]], bool]) -> Steps[None]:
        """Hand all values to `visit`, some slices at a time, until it returns True."""
        slices, rows, columns = self.everything
        for start in range(0, len(slices), self.at_once):
            yield Step(start / len(slices), "Checking values")
            if visit(self.read(slices[start : start + self.at_once], rows, columns)):
                return


class ValuesInMemory(SliceReader):
    """Reads slices from an array (slices, rows, columns) in memory."""

    thread_safe = True

    def __init__(self, values: NDArray[Any], value_step: float = 0.0, is_whole: bool = False) -> None:
        self.values, self.value_step, self._is_whole = values, value_step, is_whole
        self.shape = (values.shape[0], values.shape[1], values.shape[2])
        self.dtype = values.dtype.newbyteorder("=")

    @property
    def is_whole(self) -> bool:
        """Whether the type has whole numbers only, or the values are known to be such."""
        return self._is_whole or super().is_whole

    @property
    def own_bytes(self) -> int:
        """Always 0, as the values are in memory already."""
        return 0

    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Copy the values."""
        out[...] = self._part(slices, rows, columns)

    def read(self, slices: range, rows: range, columns: range) -> NDArray[Any]:
        """Return a view in the array's own order; a copy where the machine's byte order is another."""
        return self._part(slices, rows, columns).astype(self.dtype, copy=False)

    def values_steps(self, slices: range, rows: range, columns: range) -> Steps[NDArray[Any]]:
        """Return the array itself, in its own order, where all of it is asked for; else a copy."""
        if (slices, rows, columns) == self.everything and self.values.dtype.isnative:
            return self.values
        return (yield from super().values_steps(slices, rows, columns))

    def _part(self, slices: range, rows: range, columns: range) -> NDArray[Any]:
        return self.values[as_slice(slices), as_slice(rows), as_slice(columns)]


LONGEST = 1 << 62  # The most samples along an axis, whatever a header says.


def as_slice(numbers: range) -> slice:
    """Return the slice that selects the numbers of a rising range."""
    return slice(numbers.start, numbers.stop, numbers.step)


def fitting_stride(shape: Sequence[int], voxel_bytes: int, limit_bytes: int) -> tuple[int, int, int] | None:
    """Return the smallest stride (x, y, z), the same along all axes that are long enough, whose samples fit.

    Parameters
    ----------
    shape : (slices, rows, columns)

    Examples
    --------
    >>> fitting_stride((1000, 2000, 2000), 1, 2**29)
    (2, 2, 2)
    >>> fitting_stride((2, 9, 9), 2, 15) is None
    True
    """

    def steps(side: int) -> list[int]:
        return [max(1, min(side, size - 1)) for size in shape]

    def fits(side: int) -> bool:
        samples = math.prod(-(-size // step) for size, step in zip(shape, steps(side), strict=True))
        return samples * voxel_bytes <= limit_bytes

    sides = range(1, min(max(shape), LONGEST))  # a larger one never has more samples
    at = bisect_left(sides, True, key=fits)
    if at == len(sides):
        return None
    z, y, x = steps(sides[at])
    return x, y, z
