# SPDX-License-Identifier: GPL-3.0-or-later
"""Check that values fit their type, scale them, and find out what they mean, for all readers."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import Budget, Step, Steps, amount, require_memory
from ..core.volume import (
    NotWholeError,
    SliceReader,
    ValueKind,
    ValuesInMemory,
    WholeLabels,
    WholeNumbers,
    fitting_stride,
)

LABEL_WORDS = ("segmentation", "seg", "label", "labels", "labelmap", "mask", "masks")
MASK_VALUES = (1, 255)  # Inside of a mask whose outside is 0.
MOST_LABELS = 128  # TotalSegmentator has 117 labels; 8 bit gray values use nearly all of their 256.
AIR_HU = -100.0  # Only air, lung and fat lie below it, and every CT has air.


def require_volume_memory(shape: Sequence[int], voxel_bytes: int, what: str, budget: Budget) -> None:
    """Refuse a volume that would not fit in memory, before anything is read.

    Parameters
    ----------
    shape : (slices, rows, columns) int
    voxel_bytes : int
    what : str
        What is read, for the message.
    budget : Budget

    Raises
    ------
    MemoryLimitError
        With a stride that would fit.
    """
    shape = [int(side) for side in shape]

    def remedy(available_bytes: int) -> str:
        stride = fitting_stride(shape, voxel_bytes, available_bytes)
        if stride is None:
            return "read fewer or smaller slices, or close other programs"
        samples = math.prod(-(-size // side) for size, side in zip(shape, stride[::-1], strict=True))
        sides = " ".join(map(str, stride))
        return f"read with a stride of {sides} it takes {amount(samples * voxel_bytes)} and fits"

    sides = " x ".join(map(str, reversed(shape)))
    budget.require(math.prod(shape) * voxel_bytes, f"reading {what} ({sides})", remedy)


def require_text_memory(shape: Sequence[int], voxel_bytes: int, name: str) -> None:
    """Refuse values written as text, which are read as a whole, that would not fit in memory.

    Parameters
    ----------
    shape : (slices, rows, columns) int
    voxel_bytes : int
    name : str
        Of the file.

    Raises
    ------
    MemoryLimitError
        Before anything is read.
    """
    sides = " x ".join(str(int(side)) for side in reversed(shape))
    remedy = "text is read as a whole, so save it compressed or raw, which is read slice by slice"
    require_memory(math.prod(int(side) for side in shape) * voxel_bytes, f"reading {name} ({sides})", remedy)


def scaled_steps(
    stored: SliceReader, slope: float, intercept: float, whole: bool, what: str, budget: Budget
) -> Steps[SliceReader]:
    """Return values `stored * slope + intercept` as int16, int32 or float32, the first that holds all, else float32.

    Parameters
    ----------
    stored : SliceReader
        (slices, rows, columns).
    slope : float
    intercept : float
        Integers stay integers where both are whole numbers.
    whole : bool
        Whether all values will be needed; they are then read once, into memory.
    what : str
        What is read, for messages.
    budget : Budget

    Raises
    ------
    MemoryLimitError
        If values that are read do not fit.
    """
    if (slope, intercept) == (1.0, 0.0):
        return stored
    if stored.dtype.kind not in "iu" or not (slope.is_integer() and intercept.is_integer()):
        return _ScaledSlices(stored, slope, intercept, np.dtype(np.float32))
    limits = np.iinfo(stored.dtype)
    if _scaled_integer(limits.min, limits.max, slope, intercept) == np.int16:
        return _ScaledSlices(stored, slope, intercept, np.dtype(np.int16))
    if whole:
        require_volume_memory(stored.shape, stored.dtype.itemsize, what, budget)
        stored = ValuesInMemory((yield from stored.values_steps(*stored.everything)))
    low, high = yield from _range_steps(stored)
    return _ScaledSlices(stored, slope, intercept, _scaled_integer(low, high, slope, intercept))


def _scaled_integer(low: float, high: float, slope: float, intercept: float) -> np.dtype[Any]:
    """Return the smallest type for scaled integers from `low` to `high`."""
    ends = [int(end) * int(slope) + int(intercept) for end in (low, high)]
    return np.dtype(_smallest_integer(min(ends), max(ends)) or np.float32)


def step_of_scale(stored: np.dtype[Any], slope: float, intercept: float) -> float:
    """Return the `value_step` of scaled values: 0 where floats are stored, or whole numbers stay whole.

    Examples
    --------
    >>> step_of_scale(np.dtype(np.uint8), -0.5, 0.0), step_of_scale(np.dtype(np.uint8), 2.0, 1.0)
    (0.5, 0.0)
    """
    is_whole = stored.kind not in "iu" or (float(slope).is_integer() and float(intercept).is_integer())
    return 0.0 if is_whole else abs(float(slope))


class _ScaledSlices(SliceReader):
    """Values `stored * slope + intercept`."""

    def __init__(self, stored: SliceReader, slope: float, intercept: float, dtype: np.dtype[Any]) -> None:
        self.stored, self.slope, self.intercept = stored, slope, intercept
        self.shape, self.dtype = stored.shape, dtype
        self.chunk_slices, self.thread_safe = stored.chunk_slices, stored.thread_safe
        self.value_step = step_of_scale(stored.dtype, slope, intercept)

    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Fill `out` with scaled values, as many slices at a time as the stored ones are best read."""
        for start in range(0, len(slices), self.at_once):
            planes = self.stored.read(slices[start : start + self.at_once], rows, columns)
            for plane, target in zip(planes, out[start : start + self.at_once], strict=True):
                target[...] = plane.astype(np.float64) * self.slope + self.intercept

    @property
    def at_once(self) -> int:
        """Return the limit of the stored values, which several threads may decode."""
        return self.stored.at_once

    @property
    def own_bytes(self) -> int:
        """Return the bytes that reading all values adds; 0 if values in memory are scaled in place."""
        in_place = isinstance(self.stored, ValuesInMemory) and self.dtype.itemsize == self.stored.dtype.itemsize
        return 0 if in_place else super().own_bytes

    def values_steps(self, slices: range, rows: range, columns: range) -> Steps[NDArray[Any]]:
        """Scale values in memory in their place, where all are wanted and the type is as wide."""
        if self.own_bytes or (slices, rows, columns) != self.everything:
            return (yield from super().values_steps(slices, rows, columns))
        assert isinstance(self.stored, ValuesInMemory), "nothing else is without bytes of its own"
        out = self.stored.values.view(self.dtype)
        for start in range(0, len(slices), self.at_once):
            yield Step(start / len(slices), "Scaling values")
            window = slice(start, start + self.at_once)
            self.fill(out[window], slices[window], rows, columns)
        return out


def _smallest_integer(low: int, high: int) -> type[np.signedinteger[Any]] | None:
    """Return int16 or int32, whichever first holds `low` to `high`; None if neither does."""
    for dtype in (np.int16, np.int32):
        limits = np.iinfo(dtype)
        if limits.min <= low and high <= limits.max:
            return dtype
    return None


def _range_steps(reader: SliceReader) -> Steps[tuple[float, float]]:
    """Return the lowest and the highest value without NaN."""
    seen = Seen(reader.dtype)
    yield from reader.runs_steps(seen.add)
    return seen.low, seen.high


class Seen:
    """The range of values that come some slices at a time, and which small whole numbers occur."""

    def __init__(self, dtype: np.dtype[Any]) -> None:
        self.low, self.high = math.inf, -math.inf
        self.whole = dtype.kind in "buif"  # as far as it is known
        self.small = np.zeros(256, bool)  # which whole numbers from 0 to 255 occur

    @property
    def few(self) -> bool:
        """Return whether the values may be labels: few whole numbers from 0 to 255."""
        in_range = self.low > -0.5 and self.high < 255.5  # of floats that are nearly whole
        return self.whole and in_range and int(self.small.sum()) <= MOST_LABELS

    def add(self, values: NDArray[Any]) -> bool:
        """Take more values into account, and return False, as every value has to be seen."""
        self.low = min(self.low, float(np.fmin.reduce(values, axis=None)))
        self.high = max(self.high, float(np.fmax.reduce(values, axis=None)))
        return False


def _is_label_name(name: str) -> bool:
    """Return whether a file's stem is one that label files have.

    Examples
    --------
    >>> [_is_label_name(name) for name in ("segmentation-3", "case 7_seg", "volume-3", "segmented")]
    [True, True, False, False]
    """
    words = [word for word in re.split(r"[^a-z]+", name.lower()) if word]
    return bool(words) and (words[0] in LABEL_WORDS or words[-1] in LABEL_WORDS)


class Meaning(NamedTuple):
    """The meaning of values, a reader that gives labels as whole numbers, and notes for the user."""

    kind: ValueKind
    reader: SliceReader
    notes: tuple[str, ...] = ()


def kind_steps(reader: SliceReader, name: str, is_label: bool, may_be_hu: bool) -> Steps[Meaning]:
    """Find out what values mean if the file does not say it, or says that floats are labels.

    Labels: the file says so (`is_label`); or its name begins or ends like a label file's and all values are whole
    numbers; or it may hold HU but all are whole numbers from 0 to 255, few of them different. Floats that stand for
    whole numbers are whole numbers; if any does not, none is a label. They are rounded in place if they are in memory.
    HU: the format holds physical values, and some are as low as air. Else they are gray values.
    No more is read than settles it: of HU mostly a few slices, of labels all.
    """
    may_be_label = is_label or _is_label_name(name)
    if may_be_label and reader.is_whole:
        return Meaning(ValueKind.LABEL, reader)
    if not (may_be_label or may_be_hu):
        return Meaning(ValueKind.GRAY, reader)
    seen, numbers = Seen(reader.dtype), WholeNumbers(reader.value_step, name)
    may_be_negative = reader.dtype.kind in "if"
    notes: tuple[str, ...] = ()

    def look(values: NDArray[Any]) -> bool:
        """Take more values into account, and return whether the kind is known."""
        nonlocal may_be_label, notes
        seen.add(values)
        if may_be_label or seen.few:
            try:
                values = numbers.of(values)
            except NotWholeError as error:
                text = f"The file says that it has labels, but its value {error.value_text} {error.why}: gray values."
                notes = (text,) if is_label else ()
                may_be_label = seen.whole = False
        if seen.few:
            for plane in values:
                flat = plane.astype(np.uint8, copy=False).ravel()
                ends = np.flatnonzero(flat[1:] != flat[:-1])  # of runs of equal values, of which labels have few
                seen.small[flat[ends]] = seen.small[flat[-1:]] = True
        settled = not may_be_hu or seen.low < AIR_HU or not (seen.few or may_be_negative)
        return settled and not may_be_label

    yield from reader.runs_steps(look)
    if seen.low <= seen.high and (may_be_label or (may_be_hu and seen.few)):
        if not reader.is_whole:
            labels = WholeLabels(reader, numbers)  # whose notes are those of this look
            reader = labels if reader.own_bytes else (yield from labels.in_memory_steps())
        return Meaning(ValueKind.LABEL, reader, numbers.notes)
    return Meaning(ValueKind.HU if may_be_hu and seen.low < AIR_HU else ValueKind.GRAY, reader, notes)


class NotAMask(Exception):
    """Values of more than one structure; the text names them."""


def two_values(values: NDArray[Any]) -> set[float]:
    """Return the lowest and the highest value, which are the only ones.

    Parameters
    ----------
    values : array of numbers

    Raises
    ------
    NotAMask
        If there are others.
    """
    low, high = values.min(), values.max()
    if low == high:
        return {float(low)}
    between = (values != low) & (values != high)
    if between.any():
        raise NotAMask(f"the values {low:g}, {values[between][0]:g} and {high:g}")
    return {float(low), float(high)}


def is_mask_steps(reader: SliceReader) -> Steps[int]:
    """Return the inner value of a mask of only 0 and 1, or 0 and 255, else 0; few slices settle it."""
    seen: set[float] = set()
    numbers = WholeNumbers(reader.value_step, "")
    slices, rows, columns = reader.everything
    for number in slices:
        try:
            seen.update(two_values(numbers.of(reader.read(range(number, number + 1), rows, columns))))
        except (NotAMask, NotWholeError):
            return 0
        if len(seen) > 2 or not seen <= {0.0, *map(float, MASK_VALUES)}:
            return 0
        yield Step((number + 1) / len(slices), "Checking values")
    return next((value for value in MASK_VALUES if seen == {0.0, float(value)}), 0)
