"""Range and Otsu's threshold of a volume of any type and size, read slab by slab.

Otsu 1979, doi:10.1109/TSMC.1979.4310076.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ThresholdError
from ..progress import Step, Steps, finish

BINS = 1024  # for floats and for integers that spread too widely to count each
MOST_INTEGERS = 2**17
SLAB_VALUES = 2**20


def slabs(values: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Runs of slices, about a million values each; views."""
    step = max(1, SLAB_VALUES // max(1, values[0].size))
    for start in range(0, len(values), step):
        yield values[start : start + step]


def value_range(values: NDArray[Any]) -> tuple[float, float]:
    """Lowest and highest finite value; NaN twice where there is none.

    Examples
    --------
    >>> value_range(np.array([[[np.nan, 2.0], [-1.0, np.inf]]]))
    (-1.0, 2.0)
    """
    lows, highs = [], []
    for slab in slabs(values):
        finite = slab if slab.dtype.kind != "f" else slab[np.isfinite(slab)]
        if finite.size:
            lows.append(finite.min())
            highs.append(finite.max())
    return (float(min(lows)), float(max(highs))) if lows else (float("nan"), float("nan"))


Histogram = tuple[NDArray[np.int64], float, float]
"""Counts, the first bin's lower end, the bins' width."""


def histogram(values: NDArray[Any]) -> Histogram:
    """Counts of the finite values in even bins, the first bin's lower end and the bins' width.

    Integers get a bin each, half a unit to either side, unless they spread over more than 131,072;
    everything else gets 1024 bins between the lowest and the highest value.
    """
    return finish(histogram_steps(values))


def histogram_steps(values: NDArray[Any]) -> Steps[Histogram]:
    """`histogram` as steps."""
    low, high = value_range(values)
    if not low <= high:
        raise ThresholdError("the volume holds no finite value; no threshold can be found")
    exact = max(abs(low), abs(high)) < 2**53
    whole = values.dtype.kind in "bui" and exact and high - low < MOST_INTEGERS
    bins = int(high - low) + 1 if whole else BINS
    width = 1.0 if whole else (high - low) / BINS or 1.0
    counts = np.zeros(bins, np.int64)
    done = 0
    for slab in slabs(values):
        yield Step(done / len(values), "Counting the values")
        done += len(slab)
        if whole:
            index = slab.astype(np.int64).ravel() - int(low)
        else:
            wide = slab.astype(np.float64).ravel()
            if slab.dtype.kind == "f":
                wide = wide[np.isfinite(wide)]
            index = np.minimum(((wide - low) / width).astype(np.int64), bins - 1)
        counts += np.bincount(index, minlength=bins)
    return counts, low - 0.5 if whole else low, width


def otsu(values: NDArray[Any]) -> float:
    """Otsu's threshold: `value >= threshold` parts the values into the two classes farthest apart.

    Parameters
    ----------
    values : (slices, rows, columns) numbers
        NaN and infinite values are left out, and so is a padding value: the lowest or highest one, where
        it stands alone, more than a twentieth of the range away from a well-filled rest.

    Returns
    -------
    float
        Where several thresholds part the values alike, the middle of them; for integers never one of them.

    Raises
    ------
    ThresholdError
        If all values are equal or none is finite.

    Examples
    --------
    >>> otsu(np.array([[[0, 0, 255], [0, 255, 255]]], np.uint8))
    127.5
    """
    return otsu_of(histogram(values))


def otsu_of(found: Histogram) -> float:
    """Otsu's threshold of a histogram."""
    counts, start, width = found
    counts = without_padding(counts)
    filled = np.flatnonzero(counts)
    if len(filled) < 2:
        only = start + width * (0.5 if len(counts) == 1 else float(filled[0]))  # one bin: a whole number, in its middle
        raise ThresholdError(f"all values of this volume are {only:g}; there is no surface to find")
    counts = counts[: filled[-1] + 1]
    bins = np.arange(len(counts), dtype=np.int64)
    below, sum_below = np.cumsum(counts)[:-1], np.cumsum(counts * bins)[:-1]
    above, sum_above = int(counts.sum()) - below, int((counts * bins).sum()) - sum_below
    apart = np.zeros(len(below))
    both = (below > 0) & (above > 0)
    n, m = below[both].astype(np.float64), above[both].astype(np.float64)
    means = sum_above[both] / m - sum_below[both] / n
    apart[both] = n * m * (means * means)
    # Empty bins leave every number as it was, so their ties are exact.
    best = np.flatnonzero(apart == apart.max())
    first = int(best[0])
    last = first + int(np.argmax(np.append(np.diff(best) != 1, True)))
    return float(start + width * (1 + (first + last) / 2))


def without_padding(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """The counts without a lonely first or last bin that says 'outside the scan' and no grey value."""
    for end in (0, -1):
        filled = np.flatnonzero(counts)
        if len(filled) < 34:
            break
        outer, inner = filled[end], filled[1 if end == 0 else -2]
        if abs(int(outer) - int(inner)) * 20 > len(counts):
            counts = counts.copy()
            counts[outer] = 0
    return counts


def check_threshold(threshold: float, values: NDArray[Any], kind: str = "grey value") -> None:
    """Raise `ThresholdError` where no value or every value is at or above the threshold.

    Parameters
    ----------
    values : (slices, rows, columns)
        NaN and infinite ones are passed over.
    kind : str
        As in `Volume`: what the values mean.
    """
    low, high = value_range(values)
    if low < threshold <= high:
        return
    if not low <= high:
        raise ThresholdError("no voxel has a finite value, so there is no surface; check the file")
    if threshold > high:
        beyond = f"above this volume's maximum {high:g}"
    else:
        beyond = f"not above this volume's minimum {low:g}, so every voxel would be inside"
    hint = "choose one inside that range"
    if kind != "HU" and low >= 0 and high <= 255:
        hint = f"these look like 8 bit slices, not HU: {hint}"
    raise ThresholdError(f"threshold {threshold:g} is {beyond} (range {low:g} to {high:g}); {hint}")
