# SPDX-License-Identifier: GPL-3.0-or-later
"""What all readers ask of gray values: do they fit, what scale have they, what do they mean."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import Step, Steps, require_memory

HU, GRAY, LABEL = "HU", "grey value", "label"
LABEL_WORDS = ("segmentation", "seg", "label", "labels", "labelmap", "mask", "masks")
MOST_LABELS = 128  # TotalSegmentator has 117; 8 bit gray values nearly use up their 256
AIR_HU = -100.0  # only air, lung and fat lie below it, and every CT has air
PLANES = 8  # looked at between two steps


def require_volume_memory(shape: Sequence[int], voxel_bytes: int, what: str) -> None:
    """Say before anything is read that a volume (slices, rows, columns) would not fit in memory."""
    size = math.prod(int(side) for side in shape) * voxel_bytes
    sides = " x ".join(str(int(side)) for side in reversed(shape))
    require_memory(size, f"reading {what} ({sides})", "read fewer or smaller slices, or close other programs")


def native_steps(values: NDArray[Any]) -> Steps[NDArray[Any]]:
    """The same values in the machine's byte order, swapped in place; later stages run faster."""
    if values.dtype.isnative:
        return values
    planes = values if values.flags.c_contiguous else values.T
    for at in range(0, len(planes), PLANES):
        yield Step(at / len(planes), "Swapping bytes")
        planes[at : at + PLANES].byteswap(inplace=True)
    return values.view(values.dtype.newbyteorder("="))


def scaled_integers_steps(values: NDArray[Any], slope: int, intercept: int) -> Steps[NDArray[Any]]:
    """Integers `values * slope + intercept` as int16, int32 or float32, the first that holds them."""
    low, high = yield from range_steps(values)
    ends = (int(low) * slope + intercept, int(high) * slope + intercept)
    dtype: Any = smallest_integer(min(ends), max(ends)) or np.float32
    itemsize = np.dtype(dtype).itemsize
    if itemsize == values.dtype.itemsize:
        out = values.view(dtype)
    else:
        require_volume_memory(values.shape, itemsize, "scaled values")  # beside those that were read
        out = np.empty(values.shape, dtype)
    for at, (plane, target) in enumerate(zip(values, out, strict=True)):
        if at % PLANES == 0:
            yield Step(at / len(values), "Scaling values")
        target[...] = plane.astype(np.float64) * slope + intercept
    return out


def smallest_integer(low: int, high: int) -> type[np.signedinteger[Any]] | None:
    """int16 or int32, whichever first holds `low` to `high`; None where neither does."""
    for dtype in (np.int16, np.int32):
        limits = np.iinfo(dtype)
        if limits.min <= low and high <= limits.max:
            return dtype
    return None


def range_steps(values: NDArray[Any]) -> Steps[tuple[float, float]]:
    """Lowest and highest value, NaN left out."""
    low, high = math.inf, -math.inf
    for at in range(0, len(values), PLANES):
        yield Step(at / len(values), "Looking at the values")
        low = min(low, float(np.fmin.reduce(values[at : at + PLANES], axis=None)))
        high = max(high, float(np.fmax.reduce(values[at : at + PLANES], axis=None)))
    return low, high


def is_label_name(name: str) -> bool:
    """Whether a file's stem is one that label files have.

    Examples
    --------
    >>> [is_label_name(name) for name in ("segmentation-3", "case 7_seg", "volume-3", "segmented")]
    [True, True, False, False]
    """
    words = [word for word in re.split(r"[^a-z]+", name.lower()) if word]
    return bool(words) and (words[0] in LABEL_WORDS or words[-1] in LABEL_WORDS)


def kind_steps(values: NDArray[Any], name: str, has_label_names: bool, may_be_hu: bool) -> Steps[str]:
    """What the values mean, where the file does not say it.

    Labels: the file names them; or its name begins or ends like a label file's and all values are whole
    numbers; or it may hold HU but all are whole numbers from 0 to 255, few of them different.
    HU: the format holds physical values, and some are as low as air. Else they are gray values.
    """
    is_integer = values.dtype.kind in "bui"
    if has_label_names or (is_label_name(name) and (is_integer or (yield from whole_steps(values)))):
        return LABEL
    if not may_be_hu:
        return GRAY
    low, high = yield from range_steps(values)
    if is_integer and low >= 0 and high <= 255:
        return LABEL if (yield from different_steps(values)) <= MOST_LABELS else GRAY
    return HU if low < AIR_HU else GRAY


def whole_steps(values: NDArray[Any]) -> Steps[bool]:
    """Whether all values are whole numbers."""
    for at, plane in enumerate(values):
        if at % PLANES == 0:
            yield Step(at / len(values), "Looking at the values")
        if (plane != np.floor(plane)).any():
            return False
    return True


def different_steps(values: NDArray[Any]) -> Steps[int]:
    """How many different values there are among whole numbers from 0 to 255."""
    seen = np.zeros(256, bool)
    for at, plane in enumerate(values):
        if at % PLANES == 0:
            yield Step(at / len(values), "Looking at the values")
        seen[plane.astype(np.uint8).ravel()] = True
    return int(seen.sum())
