# SPDX-License-Identifier: GPL-3.0-or-later
"""The histogram as a control shows it: bars, ticks at round numbers, tissues, and limits that are moved."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..value_kind import ValueKind
from .tissues import TISSUES
from .values import VolumeStatistics

HU_SHOWN = (-1100.0, 3100.0)  # Only padding and metal lie beyond.


class ThresholdLimits(NamedTuple):
    """Threshold and upper limit: inside is threshold <= value <= upper; None is no upper limit."""

    threshold: float
    upper: float | None


class TissueRange(NamedTuple):
    """Range of the axis, `low` to `high`, in which a surface is named after a tissue."""

    name: str
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Bars:
    """Bars of one width, side by side.

    Parameters
    ----------
    heights : (n,) float64
        0 to 1, on a logarithmic scale.
    start, width : float
        Lower end of the first bar, and the width of each, in values of the volume.
    """

    heights: NDArray[np.float64]
    start: float
    width: float


def shown_range(statistics: VolumeStatistics, kind: str, *values: float | None) -> tuple[float, float]:
    """Return the ends of the axis: all values of the volume, in HU those of a body, and always `values`."""
    low, high = statistics.low, statistics.high
    if not low <= high:
        low, high = 0.0, 1.0
    if kind == ValueKind.HU and low < HU_SHOWN[1] and high > HU_SHOWN[0]:
        low, high = max(low, HU_SHOWN[0]), min(high, HU_SHOWN[1])
    finite = [value for value in values if value is not None and math.isfinite(value)]
    low, high = min([low, *finite]), max([high, *finite])
    return (low, high) if low < high else (low - 0.5, high + 0.5)


def histogram_bars(statistics: VolumeStatistics, low: float, high: float, most: int) -> Bars:
    """Return the histogram from `low` to `high` in at most `most` bars.

    Each bar holds the same number of bins, so that even counts make even bars.
    """
    if statistics.histogram is None:
        return Bars(np.zeros(1), low, high - low)
    counts, start, width = statistics.histogram
    first = max(0, math.floor((low - start) / width))
    last = min(len(counts), math.ceil((high - start) / width))
    inside = counts[first:last]
    if not len(inside):
        return Bars(np.zeros(1), low, high - low)
    bins = math.ceil(len(inside) / max(1, most))
    sums = np.add.reduceat(inside, np.arange(0, len(inside), bins))
    heights = np.log1p(sums.astype(np.float64))
    return Bars(heights / (heights.max() or 1.0), start + first * width, bins * width)


def round_ticks(low: float, high: float, most: int) -> list[float]:
    """Return at most `most` numbers from `low` to `high`, 1, 2 or 5 times a power of ten apart.

    Examples
    --------
    >>> round_ticks(-1024.0, 3071.0, 6)
    [-1000.0, 0.0, 1000.0, 2000.0, 3000.0]
    >>> round_ticks(0.0, 1.0, 6)
    [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    """
    if not high > low or most < 1:
        return []
    power = math.floor(math.log10((high - low) / most))
    for step, exponent in ((1, power), (2, power), (5, power), (1, power + 1), (2, power + 1), (5, power + 1)):
        # Written as a division where it can be, so that 0.2 is 0.2 and not 0.2 and a little.
        up, down = (step * 10**exponent, 1) if exponent >= 0 else (step, 10**-exponent)
        first, last = math.ceil(low * down / up), math.floor(high * down / up)
        if last - first + 1 <= most:
            return [number * up / down for number in range(first, last + 1)]
    return []


def tissue_bands(low: float, high: float) -> list[TissueRange]:
    """Return where a threshold in HU gives a surface its name: to the next tissue, or to the tissue's own upper limit.

    Examples
    --------
    >>> tissue_bands(-1000.0, -100.0)
    [TissueRange(name='Lung', low=-950.0, high=-600.0), TissueRange(name='Skin', low=-300.0, high=-100.0)]
    """
    rising = sorted(TISSUES.values(), key=lambda tissue: tissue.threshold)
    ends = [tissue.threshold for tissue in rising[1:]] + [math.inf]
    bands = [
        TissueRange(tissue.name, max(low, tissue.threshold), min(high, end if tissue.upper is None else tissue.upper))
        for tissue, end in zip(rising, ends, strict=True)
    ]
    return [band for band in bands if band.low < band.high]


def rounded_to(value: float, precision: float) -> float:
    """Return the value at the power of ten that is `precision` or a little finer.

    Examples
    --------
    >>> rounded_to(226.4, 2.7), rounded_to(0.123456, 0.0006)
    (226.0, 0.1235)
    """
    return round(value, -math.floor(math.log10(precision)))


def moved_limit(limits: ThresholdLimits, is_upper: bool, value: float, low: float, high: float) -> ThresholdLimits:
    """Return the limits after one was moved: neither passes the other, and an upper limit at the end is none.

    Examples
    --------
    >>> moved_limit(ThresholdLimits(200.0, None), True, 500.0, -1000.0, 3000.0)
    ThresholdLimits(threshold=200.0, upper=500.0)
    >>> moved_limit(ThresholdLimits(200.0, 500.0), True, 3000.0, -1000.0, 3000.0)
    ThresholdLimits(threshold=200.0, upper=None)
    >>> moved_limit(ThresholdLimits(200.0, 500.0), False, 900.0, -1000.0, 3000.0)
    ThresholdLimits(threshold=500.0, upper=500.0)
    """
    value = min(max(value, low), high)
    if is_upper:
        return ThresholdLimits(limits.threshold, None if value >= high else max(value, limits.threshold))
    return ThresholdLimits(value if limits.upper is None else min(value, limits.upper), limits.upper)


def grabbed_limit(limits: ThresholdLimits, value: float, high: float, reach: float) -> bool:
    """Return whether a press at `value` takes the upper limit: the nearer one within `reach`, else the threshold.

    A press above the upper limit takes that; without a limit, it is at the end, `high`.
    """
    upper = high if limits.upper is None else limits.upper
    if abs(value - upper) <= reach or abs(value - limits.threshold) <= reach:
        return abs(value - upper) < abs(value - limits.threshold)
    return value > upper
