# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels as whole numbers: the one place that says which whole number a stored value stands for.

Programs store labels as floats, or as integers with a scale: nibabel writes 1, 6 and 117 as int16 that are read as
0.99977, 6.0004 and 117. A value stands for its nearest whole number if it lies within a thousandth of its own size, or
within half a step of the file's scale. A step of 1 or more does not tell whole numbers apart, so it counts for nothing.
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import LabelError
from ...progress import Step, Steps
from ..slice_reader import SliceReader, ValuesInMemory

NEAR = 0.001  # A value may lie this share of its size from a whole number.
HALF_STEP = 0.50005  # Scaled values are rounded to float32, so half a step is taken a little wider.
LARGEST = (1 << 53) - 1  # From 2**53 on float64 does not hold every whole number.


class NotWholeError(LabelError):
    """A value that stands for no whole number; `value_text` is the number, `why` explains the problem."""

    def __init__(self, sentence: str = "", value_text: str = "", why: str = "") -> None:
        super().__init__(sentence)
        self.value_text, self.why = value_text, why


def _refusal(name: str, value: float, why: str) -> NotWholeError:
    text = f"{value:.6g}"
    return NotWholeError(
        f"{name} cannot be read as labels: its value {text} {why}; give a threshold, or save its labels as integers "
        "without a scale",
        text,
        why,
    )


class WholeNumbers:
    """Turns values into labels, and keeps notes for the user. Threads may share it.

    Parameters
    ----------
    value_step : float
        As `SliceReader.value_step`.
    name : str
        Name of the volume, for errors.

    Examples
    --------
    >>> numbers = WholeNumbers(117 / 255, "organs")
    >>> numbers.of(np.array([0, 0.918, 5.965, 117])).tolist()
    [0.0, 1.0, 6.0, 117.0]
    >>> numbers.notes
    ('Values that are not whole were read as the nearest label, such as 0.918 as 1.',)
    """

    def __init__(self, value_step: float, name: str) -> None:
        self._name = name
        self._tolerance = value_step * HALF_STEP if value_step < 1 else 0.0
        self._farthest = (0.0, 0.0, 0)  # distance, minus the value, label
        self._has_nan = False
        self._lock = threading.Lock()

    @property
    def notes(self) -> tuple[str, ...]:
        """Changes of the values so far; independent of their order."""
        distance, negative, label = self._farthest
        texts = (f"{-negative:.{digits}g}" for digits in (7, 9, 17))
        text = next((text for text in texts if text != str(label)), "")
        rounded = f"Values that are not whole were read as the nearest label, such as {text} as {label}."
        missing = "Voxels whose value is NaN were read as having no label."
        return (*([rounded] if distance else []), *([missing] if self._has_nan else []))

    def of(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the whole numbers that some values stand for, 0 for NaN; the same array where they are whole.

        Raises
        ------
        NotWholeError
            For the first value that stands for no whole number.
        """
        if values.dtype.kind != "f" or not values.size:
            return values
        nearest = np.rint(values)
        odd = nearest != values
        is_whole = not odd.any()
        if not is_whole:
            nearest[odd] = self._rounded(values[odd].astype(np.float64), nearest[odd].astype(np.float64))
        if max(-float(nearest.min()), float(nearest.max())) > LARGEST:
            value = float(nearest[np.abs(nearest) > LARGEST][0])
            raise _refusal(self._name, value, f"is beyond {LARGEST}, the largest label")
        return values if is_whole else nearest

    def _rounded(self, values: NDArray[np.float64], nearest: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values that are not whole as they are read, and keep the farthest for the notes."""
        missing = np.isnan(values)
        if missing.any():
            with self._lock:
                self._has_nan = True
            values, nearest = np.where(missing, 0.0, values), np.where(missing, 0.0, nearest)
        distance = np.abs(values - nearest)
        allowed = np.maximum(np.abs(values) * NEAR, self._tolerance)
        refused = (distance > allowed) | (distance >= 0.5)
        if refused.any():
            at = int(refused.argmax())
            limit = min(float(allowed[at]), 0.5)
            raise _refusal(self._name, float(values[at]), f"is not within {limit:.3g} of a whole number")
        value = values[distance == distance.max()].min()
        farthest = (float(distance.max()), -float(value), int(np.rint(value)))
        with self._lock:
            self._farthest = max(self._farthest, farthest)
        return nearest


class WholeLabels(SliceReader):
    """Labels of another reader, whose values are floats, as whole numbers of the same type.

    Parameters
    ----------
    reader : SliceReader
    numbers : WholeNumbers
        Turns its values into labels.
    """

    is_whole = True

    def __init__(self, reader: SliceReader, numbers: WholeNumbers) -> None:
        self.reader, self.numbers = reader, numbers
        self.shape, self.dtype = reader.shape, reader.dtype
        self.chunk_slices, self.thread_safe = reader.chunk_slices, reader.thread_safe

    @property
    def notes(self) -> tuple[str, ...]:
        """Changes of the values read so far."""
        return self.numbers.notes

    @property
    def own_bytes(self) -> int:
        """Return the bytes of the other reader: labels of values in memory are read a few slices at a time."""
        return self.reader.own_bytes

    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Write whole numbers."""
        self.reader.fill(out, slices, rows, columns)
        for start in range(0, len(out), self.at_once):
            self._round(out[start : start + self.at_once])

    def in_memory_steps(self) -> Steps[ValuesInMemory]:
        """Return all labels, rounding values that are in memory in place."""
        values = yield from self.reader.values_steps(*self.everything)
        out = values if values.flags.writeable else values.copy()
        for start in range(0, len(out), self.at_once):
            yield Step(start / len(out), "Checking values")
            self._round(out[start : start + self.at_once])
        return ValuesInMemory(out, is_whole=True)

    def _round(self, values: NDArray[Any]) -> None:
        whole = self.numbers.of(values)
        if whole is not values:
            values[...] = whole
