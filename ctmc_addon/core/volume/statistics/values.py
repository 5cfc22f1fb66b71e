# SPDX-License-Identifier: GPL-3.0-or-later
"""Statistics of a volume's values: range, histogram, labels, and a fingerprint to recognize the volume."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ...errors import ThresholdError
from ...progress import Stages, Step, Steps, finish
from ..labels.extents import label_extents_steps
from ..value_kind import ValueKind
from ..volume import Box, SampleGrid, Volume

BINS = 1024  # Bins for floats, and for integers over too wide a range to count each value.
MOST_INTEGERS = 2**17
SLAB_VALUES = 2**20


def slabs_of(values: NDArray[Any] | Volume) -> Iterator[NDArray[Any]]:
    """Yield runs of slices, about a million values each, as views or as they are fetched."""
    slices, rows, columns = values.shape
    step = max(1, SLAB_VALUES // max(1, rows * columns))
    for start in range(0, slices, step):
        end = min(start + step, slices)
        yield values[start:end] if isinstance(values, np.ndarray) else values.slab(start, end)


class ValueFacts(NamedTuple):
    """Lowest and highest finite value, NaN without one, and the number of values that are not finite."""

    low: float
    high: float
    not_finite: int


def value_facts_steps(values: NDArray[Any] | Volume) -> Steps[ValueFacts]:
    """Look at all values once.

    Examples
    --------
    >>> finish(value_facts_steps(np.array([[[np.nan, 2.0], [-1.0, np.inf]]])))
    ValueFacts(low=-1.0, high=2.0, not_finite=2)
    """
    lows, highs, broken, done = [], [], 0, 0
    for slab in slabs_of(values):
        yield Step(done / values.shape[0], "Checking values")
        done += len(slab)
        finite = slab if slab.dtype.kind != "f" else slab[np.isfinite(slab)]
        broken += slab.size - finite.size
        if finite.size:
            lows.append(float(finite.min()))
            highs.append(float(finite.max()))
    return ValueFacts(min(lows, default=math.nan), max(highs, default=math.nan), broken)


def value_range(values: NDArray[Any] | Volume) -> tuple[float, float]:
    """Return the lowest and the highest finite value, or NaN twice.

    Examples
    --------
    >>> value_range(np.array([[[np.nan, 2.0], [-1.0, np.inf]]]))
    (-1.0, 2.0)
    """
    return finish(value_facts_steps(values))[:2]


Histogram = tuple[NDArray[np.int64], float, float]
"""Counts, the first bin's lower end, the width of a bin."""


def histogram(values: NDArray[Any]) -> Histogram:
    """Return counts of the finite values in even bins, the first bin's lower end and the bins' width.

    Integers get a bin each, half a unit to either side, unless they spread over more than 131,072;
    everything else gets 1024 bins between the lowest and the highest value.
    """
    return finish(_histogram_steps(values))


def _histogram_steps(values: NDArray[Any] | Volume) -> Steps[Histogram]:
    """Do what `histogram` does, in steps."""
    if values.dtype.kind in "bui" and values.dtype.itemsize <= 2:
        return (yield from _narrow_histogram_steps(values))
    low, high = value_range(values)
    if not low <= high:
        raise ThresholdError("the volume holds no finite value; no threshold can be found")
    exact = max(abs(low), abs(high)) < 2**53
    whole = _is_whole(values) and exact and high - low < MOST_INTEGERS
    bins = int(high - low) + 1 if whole else BINS
    width = 1.0 if whole else (high - low) / BINS or 1.0
    counts = np.zeros(bins, np.int64)
    done = 0
    for slab in slabs_of(values):
        yield Step(done / values.shape[0], "Computing histogram")
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


def _is_whole(values: NDArray[Any] | Volume) -> bool:
    return values.dtype.kind in "bui" if isinstance(values, np.ndarray) else values.reader.is_whole


def _narrow_histogram_steps(values: NDArray[Any] | Volume) -> Steps[Histogram]:
    """`histogram` of integers of up to 16 bits, fetched once."""
    lowest = 0 if values.dtype.kind in "bu" else int(np.iinfo(values.dtype).min)
    counts = np.zeros(1 << 8 * values.dtype.itemsize, np.int64)
    done = 0
    for slab in slabs_of(values):
        yield Step(done / values.shape[0], "Computing histogram")
        done += len(slab)
        counts += np.bincount(slab.ravel().astype(np.intp) - lowest, minlength=len(counts))
    filled = np.flatnonzero(counts)
    return counts[filled[0] : filled[-1] + 1].copy(), lowest + float(filled[0]) - 0.5, 1.0


_histograms: WeakKeyDictionary[Volume, Histogram] = WeakKeyDictionary()  # The histograms of whole volumes.


def box_histogram_steps(volume: Volume, box: Box) -> Steps[Histogram]:
    """`histogram` of the samples in a box; that of a whole volume is counted once."""
    whole = is_whole(volume, box)
    if whole and volume in _histograms:
        return _histograms[volume]
    result = yield from _histogram_steps(volume.part(box))
    if whole:
        _histograms[volume] = result
    return result


def is_counted(volume: Volume, box: Box) -> bool:
    """Return whether `box_histogram_steps` has its answer at once."""
    return volume in _histograms and is_whole(volume, box)


def is_whole(volume: SampleGrid, box: Box) -> bool:
    """Return whether a box holds all samples of a volume."""
    return all(ends == (0, size) for ends, size in zip(box, volume.size, strict=True))


@dataclass(frozen=True, eq=False)
class VolumeStatistics:
    """Statistics of a volume's values.

    Parameters
    ----------
    low, high : float
        Lowest and highest finite value, or NaN.
    histogram : (counts, start, width) or None
        As `histogram` returns it; None where no value is finite.
    non_finite : int
        Voxels that are NaN or infinite.
    labels : tuple of (value, voxels)
        Labels of a label volume, without 0, in the order of their values.
    fingerprint : str
        The same for the same values at the same position.
    """

    low: float
    high: float
    histogram: Histogram | None
    non_finite: int
    labels: tuple[tuple[int, int], ...]
    fingerprint: str

    def bar_heights(self, bars: int) -> NDArray[np.float64]:
        """Return the histogram in `bars` even bars from `low` to `high`: 0 to 1, on a logarithmic scale."""
        if self.histogram is None:
            return np.zeros(bars)
        counts, start, width = self.histogram
        filled = np.flatnonzero(counts)
        middle = start + width * (filled + 0.5)
        share = (middle - self.low) / ((self.high - self.low) or 1.0)
        bar = np.clip((share * bars).astype(np.int64), 0, bars - 1)
        heights = np.log1p(np.bincount(bar, counts[filled], bars))
        return np.asarray(heights / (heights.max() or 1.0))


def volume_statistics_steps(volume: Volume) -> Steps[VolumeStatistics]:
    """Look through a volume once, and a label volume once more for its labels.

    Examples
    --------
    >>> from ctmc_addon.core.progress import finish
    >>> values = np.array([[[0, 0], [2, 0]], [[0, 5], [5, 5]]], np.uint8)
    >>> finish(volume_statistics_steps(Volume(values, np.eye(4), kind="label"))).labels
    ((2, 1), (5, 3))
    """
    values = volume.values
    stages = Stages({"Computing histogram": 7, "Counting the labels": 3})
    x, y, z = volume.size
    try:
        counting = box_histogram_steps(volume, ((0, x), (0, y), (0, z)))
        histogram: Histogram | None = yield from stages.run("Computing histogram", counting)
    except ThresholdError:
        histogram = None
    low, high, non_finite = float("nan"), float("nan"), values.size
    labels: tuple[tuple[int, int], ...] = ()
    if histogram is not None:
        counts, start, width = histogram
        filled = np.flatnonzero(counts)
        one_by_one = width == 1.0 and _is_whole(volume)
        low = start + width * (filled[0] + (0.5 if one_by_one else 0.0))
        high = start + width * (filled[-1] + (0.5 if one_by_one else 1.0))
        non_finite = values.size - int(counts.sum())
        if volume.kind == ValueKind.LABEL:
            extents = yield from stages.run("Counting the labels", label_extents_steps(volume))
            labels = tuple((label, extent.voxels) for label, extent in extents.items())
    overlapping = labels if volume.layers else ()
    return VolumeStatistics(low, high, histogram, non_finite, labels, fingerprint(volume, histogram, overlapping))


def fingerprint(volume: Volume, histogram: Histogram | None, labels: tuple[tuple[int, int], ...] = ()) -> str:
    """Return twelve letters made from a volume's size, affine and histogram, and from labels that overlap."""
    # Surfaces in files of version 0.2 name their CT by this text, which has the older spelling.
    kind = "grey value" if volume.kind == ValueKind.GRAY else str(volume.kind)
    digest = hashlib.sha256(repr((volume.size, kind)).encode())
    # Rounded: another version of a library may place the volume a last bit further.
    digest.update((np.round(volume.affine, 4) + 0.0).tobytes())
    if histogram is not None:
        digest.update(np.ascontiguousarray(histogram[0], "<i8").tobytes())
        digest.update(np.array(histogram[1:], "<f8").tobytes())
    if labels:
        digest.update(np.array(labels, "<i8").tobytes())
    return digest.hexdigest()[:12]


BACKGROUND, OUTSIDE, INSIDE, LINE = (0.10, 0.10, 0.11), (0.36, 0.36, 0.38), (0.86, 0.55, 0.24), (1.0, 1.0, 1.0)


def histogram_picture(
    statistics: VolumeStatistics, limits: tuple[float | None, float | None], width: int, height: int
) -> NDArray[np.float32]:
    """Return the histogram as a picture, (height, width, 4) float32 from the bottom up, the limits as lines.

    Bars from the threshold to the upper limit, inside the surface, have a color. Without a threshold none has.
    """
    heights = np.ceil(statistics.bar_heights(width) * (height - 2))
    filled = np.arange(height)[:, None] < heights  # (height, width)
    span = (statistics.high - statistics.low) or 1.0
    shares = [None if value is None else (value - statistics.low) / span for value in limits]
    first, last = (
        None if share is None or not np.isfinite(share) else int(np.clip(share * width, 0, width - 1))
        for share in shares
    )
    columns = np.arange(width)
    inside = (
        np.zeros(width, bool) if first is None else (columns >= first) & (columns <= (width if last is None else last))
    )
    out = np.empty((height, width, 4), np.float32)
    out[..., :3], out[..., 3] = BACKGROUND, 1.0
    out[..., :3][filled & ~inside] = OUTSIDE
    out[..., :3][filled & inside] = INSIDE
    for column in (first, last):
        if first is not None and column is not None:
            out[:, column, :3] = LINE
    return out
