# SPDX-License-Identifier: GPL-3.0-or-later
"""Choose the threshold: the setting, Otsu's threshold of the region, or half of a label.

Panel, preview, slice tint, cost estimate and reconstruction all ask `used_threshold_steps` or `quick_threshold`.
Otsu 1979, doi:10.1109/TSMC.1979.4310076.
"""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ...errors import ThresholdError
from ...progress import Steps, finish
from ...settings import ReconstructionSettings
from ..region import region_box
from ..value_kind import ValueKind
from ..volume import Box, Volume
from .values import Histogram, box_histogram_steps, histogram, is_counted, value_range

WHOLE_VOLUME = "this volume"
HALF_LABEL = 0.5  # A label is extracted from 0 (outside) and 1 (inside).
QUICK_VALUES = 1 << 22  # This many values are counted in less than 0.1 s.
_otsu: WeakKeyDictionary[Volume, dict[Box, float]] = WeakKeyDictionary()


def used_threshold_steps(volume: Volume, settings: ReconstructionSettings) -> Steps[float]:
    """Return the threshold that a reconstruction of `volume` with `settings` uses.

    The setting where there is one; half of 0 and 1 for a label; else Otsu's threshold of the finite values in the
    region, which is found once for each region.

    Raises
    ------
    SettingsError
        If fewer than two samples along an axis lie in the region.
    ThresholdError
        If Otsu's threshold is needed and all values in the region are equal or none is finite.
    """
    if settings.label is not None:
        return HALF_LABEL
    if settings.threshold is not None:
        return settings.threshold
    box = region_box(volume, settings)
    of_box = _otsu.setdefault(volume, {})
    if box not in of_box:
        of_box[box] = _otsu_of_histogram((yield from box_histogram_steps(volume, box)))
    return of_box[box]


def quick_threshold(volume: Volume, settings: ReconstructionSettings) -> float | None:
    """Return the threshold of `used_threshold_steps` if that takes less than 0.1 s, else None.

    Raises
    ------
    SettingsError, ThresholdError
        As `used_threshold_steps`.
    """
    if settings.label is None and settings.threshold is None:
        box = region_box(volume, settings)
        samples = int(np.prod([stop - start for start, stop in box]))
        if samples > QUICK_VALUES and box not in _otsu.get(volume, {}) and not is_counted(volume, box):
            return None
    return finish(used_threshold_steps(volume, settings))


def otsu(values: NDArray[Any]) -> float:
    """Return Otsu's threshold: `value >= threshold` separates the two classes with the largest variance between them.

    Parameters
    ----------
    values : (slices, rows, columns) numbers
        NaN and infinite values are left out, and so is a padding value: the lowest or highest value, where it is
        more than a twentieth of the range away from all others.

    Returns
    -------
    float
        The middle of all thresholds that separate the values alike; for integers never a value itself.

    Raises
    ------
    ThresholdError
        If all values are equal or none is finite.

    Examples
    --------
    >>> otsu(np.array([[[0, 0, 255], [0, 255, 255]]], np.uint8))
    127.5
    """
    return _otsu_of_histogram(histogram(values))


def _otsu_of_histogram(histogram: Histogram) -> float:
    counts, start, width = histogram
    counts = _without_padding(counts)
    filled = np.flatnonzero(counts)
    if len(filled) < 2:
        value = start + width * (0.5 if len(counts) == 1 else float(filled[0]))  # the middle of a single bin
        raise ThresholdError(f"all values of this volume are {value:g}; there is no surface to find")
    counts = counts[: filled[-1] + 1]
    bins = np.arange(len(counts), dtype=np.int64)
    below, sum_below = np.cumsum(counts)[:-1], np.cumsum(counts * bins)[:-1]
    above, sum_above = int(counts.sum()) - below, int((counts * bins).sum()) - sum_below
    between = np.zeros(len(below))  # variance between the classes
    both = (below > 0) & (above > 0)
    n, m = below[both].astype(np.float64), above[both].astype(np.float64)
    means = sum_above[both] / m - sum_below[both] / n
    between[both] = n * m * (means * means)
    # Empty bins leave every number as it was, so their ties are exact.
    best = np.flatnonzero(between == between.max())
    first = int(best[0])
    last = first + int(np.argmax(np.append(np.diff(best) != 1, True)))
    return float(start + width * (1 + (first + last) / 2))


def _without_padding(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the counts without an isolated first or last bin, which means 'outside the scan'."""
    for end in (0, -1):
        filled = np.flatnonzero(counts)
        if len(filled) < 34:
            break
        outer, inner = filled[end], filled[1 if end == 0 else -2]
        if abs(int(outer) - int(inner)) * 20 > len(counts):
            counts = counts.copy()
            counts[outer] = 0
    return counts


def check_threshold(
    threshold: float,
    values: NDArray[Any] | Volume,
    kind: ValueKind = ValueKind.GRAY,
    place: str = WHOLE_VOLUME,
    upper: float | None = None,
) -> None:
    """Raise `ThresholdError` where no value or every value is at or above the threshold, and not above `upper`.

    Parameters
    ----------
    values : (slices, rows, columns)
        NaN and infinite values are ignored.
    kind : ValueKind
        Meaning of the values, as in `Volume`.
    place : str
        Owner of the values, for the message.
    """
    low, high = value_range(values)
    if upper is not None and threshold > upper:  # Otsu's threshold; settings that contradict each other are refused
        raise ThresholdError(f"threshold {threshold:g} is above the upper limit {upper:g}; change one of them")
    if low < threshold <= high and (upper is None or upper >= low):
        return
    if not low <= high:
        raise ThresholdError("no voxel has a finite value, so there is no surface; check the file")
    if upper is not None and threshold <= low:
        if low <= upper < high:
            return
        where = "below the minimum" if upper < low else "at or above the maximum"
        raise ThresholdError(
            f"upper limit {upper:g} is {where} of {place} (range {low:g} to {high:g}); choose one inside that range"
        )
    if threshold > high:
        beyond = f"above the maximum {high:g} of {place}"
    else:
        beyond = f"not above the minimum {low:g} of {place}, so every voxel would be inside"
    hint = "choose one inside that range"
    if kind == ValueKind.GRAY and place == WHOLE_VOLUME and low >= 0 and high <= 255:
        hint = f"these look like 8 bit slices, not HU: {hint}"
    raise ThresholdError(f"threshold {threshold:g} is {beyond} (range {low:g} to {high:g}); {hint}")
