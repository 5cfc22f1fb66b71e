# SPDX-License-Identifier: GPL-3.0-or-later
"""Decode the frames of a DICOM volume in order, in one type, and resample an uneven stack.

The type and the value of padding depend on all frames. Reading the whole volume finds them on the way; for a part, the
headers show them or all frames are decoded first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from ....core import Budget, ReadError, Step, Steps, finish
from ....core.volume import SliceReader, ValuesInMemory, as_slice
from ...value_kind import require_volume_memory, step_of_scale
from ..header import Slice
from ..series.stack_geometry import Stack
from .pixel_format import value_range
from .pixels import DoesNotFit, SliceRead, fill_slice, output_types, padding_mark, plain_type, real_ends
from .stored import StoredPixels

PLANES = 8  # Slices cleared of padding between two steps.


class _DicomSlices(SliceReader):
    """Slices of a volume in the type `dtype`.

    Parameters
    ----------
    slices : sequence of Slice
        Ordered as the stack is.
    lowest : float or None
        New value of padding; by default `padding_mark`.
    """

    def __init__(self, slices: Sequence[Slice], stack: Stack, dtype: Any, lowest: float | None = None) -> None:
        image = slices[0].image
        self.slices, self.stack, self.lowest = slices, stack, lowest
        self.shape, self.dtype = (len(stack.below), image.rows, image.columns), np.dtype(dtype)
        if self.dtype.kind == "f" and not any(each.image.pixels.floating for each in slices):
            scales = {(each.geometry.slope, each.geometry.intercept) for each in slices}
            self.value_step = min(step_of_scale(np.dtype(np.int32), *scale) for scale in scales)
        self._fits = _fit_by_headers(slices, dtype) and all(plain_type(each.image) is not None for each in slices)
        self._pixels = StoredPixels(slices)
        finalize(self, self._pixels.close)

    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Decode the frames that these slices are made from."""
        finish(self.filled_steps(out, slices, rows, columns))

    def values_steps(self, slices: range, rows: range, columns: range) -> Steps[NDArray[Any]]:
        """Read the values with a step for each frame, opening each file once."""
        out = np.empty((len(slices), len(rows), len(columns)), self.dtype)
        yield from self.filled_steps(out, slices, rows, columns)
        return out

    def close(self) -> None:
        """End the decoding process, if there is one; it is started again when it is needed."""
        self._pixels.close()

    def filled_steps(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> Steps[SliceRead]:
        """Fill `out`, and return the lowest real value and the number of padding pixels.

        An uneven stack is interpolated linearly along the normal, with two slices held at a time. No threads: plain
        pixels are there before a thread would be, and compressed ones come from another process.
        """
        below, weight = self.stack.below[as_slice(slices)], self.stack.weight[as_slice(slices)]
        above = below + (weight > 0)
        everything = len(slices) == self.shape[0]
        needed = range(len(self.slices)) if everything else np.union1d(below, above).tolist()
        lowest, padded, done = math.inf, 0, 0
        low, high = np.empty((2, *out.shape[1:]), self.dtype) if self.stack.resampled else (out[0], out[0])
        for at, number in enumerate(needed):
            stored = yield from self._pixels.slice_steps(number, Step(at / len(needed), "Decoding slices"))
            stored = stored[as_slice(rows), as_slice(columns)]
            low, high = high, low if self.stack.resampled else out[at]
            image, geometry = self.slices[number].image, self.slices[number].geometry
            seen = fill_slice(stored, geometry, image.pixels.padding, high, self._fits)
            lowest, padded = min(lowest, seen.lowest), padded + seen.padded
            while self.stack.resampled and done < len(out) and above[done] <= number:
                if below[done] == number:
                    out[done] = high
                else:
                    between(low, high, float(weight[done]), out[done])
                done += 1
            yield Step((at + 1) / len(needed), "Decoding slices")
        if padded and self.lowest is not None:
            out[out == padding_mark(self.dtype)] = self.lowest
        return SliceRead(lowest, padded)


def values_steps(
    slices: Sequence[Slice], stack: Stack, whole: bool, budget: Budget
) -> Steps[tuple[SliceReader, list[str]]]:
    """Return the values in the smallest type that holds them, and notes about padding.

    Parameters
    ----------
    slices : sequence of Slice
        In the order of the volume.
    stack : Stack
        Their positions; an uneven one is resampled.
    whole : bool
        Whether to read all values into memory now.
    budget : Budget
        The memory that they may take.

    Returns
    -------
    The reader of (slices, rows, columns) int16, int32 or float32, and notes

    Raises
    ------
    MemoryLimitError
        If they do not fit.
    """
    types = output_types([each.geometry for each in slices], any(each.image.is_float for each in slices))
    if not whole:
        dtype, seen = yield from _type_steps(slices, types)
        return _DicomSlices(slices, stack, dtype, seen.lowest), padding_notes(seen)
    for dtype in types:
        reader = _DicomSlices(slices, stack, dtype)
        require_volume_memory(reader.shape, reader.dtype.itemsize, "this series", budget)
        values = np.empty(reader.shape, dtype)
        try:
            seen = yield from reader.filled_steps(values, *reader.everything)
        except DoesNotFit:
            del values
            continue
        finally:
            reader.close()
        notes = padding_notes(seen)
        if notes:
            yield from _clear_padding_steps(values, seen.lowest)
        return ValuesInMemory(values, reader.value_step), notes
    raise AssertionError("float32 holds every value")


def _type_steps(slices: Sequence[Slice], types: Sequence[Any]) -> Steps[tuple[Any, SliceRead]]:
    """Return the first type that holds all slices, and their padding, by their headers or by decoding each."""
    if _fit_by_headers(slices, types[0]):
        return types[0], SliceRead(math.inf, 0)
    low, high, padded = math.inf, -math.inf, 0
    with StoredPixels(slices) as pixels:
        for number, each in enumerate(slices):
            step = Step(number / len(slices), "Checking values")
            stored = yield from pixels.slice_steps(number, step)
            lowest, highest, mask = real_ends(stored, each.geometry, each.image.pixels.padding)
            low, high = min(low, lowest), max(high, highest)
            padded += 0 if mask is None else int(mask.sum())
            yield step
    return next(dtype for dtype in types if fits(low, high, dtype)), SliceRead(low, padded)


def _fit_by_headers(slices: Sequence[Slice], dtype: Any) -> bool:
    """Return whether the headers say that all values fit into a type, and that none of them is padding."""
    if any(each.image.pixels.padding is not None for each in slices):
        return False
    if any(each.image.pixels.floating for each in slices):
        return np.dtype(dtype).kind == "f"
    scales = {(value_range(each.image.pixels), each.geometry.slope, each.geometry.intercept) for each in slices}
    ends = [end * slope + intercept for both, slope, intercept in scales for end in both]
    return fits(min(ends), max(ends), dtype)


def fits(low: float, high: float, dtype: Any) -> bool:
    """Return whether a type holds values from `low` to `high`."""
    if np.dtype(dtype).kind == "f" or low > high:
        return True
    return bool(np.iinfo(dtype).min <= low and high <= np.iinfo(dtype).max)


def between(low: NDArray[Any], high: NDArray[Any], weight: float, out: NDArray[Any]) -> None:
    """Write the linear mean of two slices, rounded where `out` is integer.

    Where one of them is padding, the value is that of the nearer slice.

    Parameters
    ----------
    low : (rows, columns)
    high : (rows, columns)
    weight : float
        Share of `high`, 0 to 1.
    out : (rows, columns)
        Is filled.
    """
    mean = low.astype(np.float64) * (1.0 - weight) + high.astype(np.float64) * weight
    out[...] = np.rint(mean) if out.dtype.kind in "iu" else mean
    mark = padding_mark(out.dtype)
    near_padding = (low == mark) | (high == mark)
    if near_padding.any():
        out[near_padding] = (low if weight < 0.5 else high)[near_padding]


def padding_notes(seen: SliceRead) -> list[str]:
    """Return the note about the new value of padding, if there is any."""
    if not seen.padded:
        return []
    if seen.lowest == math.inf:
        raise ReadError(f"all {seen.padded} pixels of the series are padding; choose another series")
    return [f"{seen.padded} padding pixels were set to the lowest value, {seen.lowest:g}"]


def _clear_padding_steps(values: NDArray[Any], lowest: float) -> Steps[None]:
    """Give padding the lowest real value, so that no surface surrounds it."""
    mark = padding_mark(values.dtype)
    for at in range(0, len(values), PLANES):
        yield Step(1.0, "Removing padding")
        slices = values[at : at + PLANES]
        slices[slices == mark] = lowest
