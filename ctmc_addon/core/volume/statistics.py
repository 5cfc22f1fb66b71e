"""What a volume holds, in one look: range, histogram, labels, and a fingerprint to know it again by."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ThresholdError
from ..progress import Step, Steps, within
from .thresholding import Histogram, histogram_steps, otsu_of, slabs
from .volume import Volume


@dataclass(frozen=True, eq=False)
class Survey:
    """What a volume holds.

    Parameters
    ----------
    low, high : float
        Lowest and highest finite value.
    histogram : (counts, start, width) or None
        As `histogram.histogram` gives it; None where no value is finite.
    broken : int
        Voxels that are NaN or infinite.
    labels : tuple of (value, voxels)
        Of a label volume, without 0, in the order of their values.
    fingerprint : str
        The same for the same values at the same place.
    """

    low: float
    high: float
    histogram: Histogram | None
    broken: int
    labels: tuple[tuple[int, int], ...]
    fingerprint: str

    @property
    def otsu(self) -> float | None:
        """Otsu's threshold of the whole volume; None where all values are equal."""
        if self.histogram is None:
            return None
        try:
            return otsu_of(self.histogram)
        except ThresholdError:
            return None

    def heights(self, bars: int) -> NDArray[np.float64]:
        """The histogram in `bars` even bars from `low` to `high`, as heights from 0 to 1 on a logarithmic scale."""
        if self.histogram is None:
            return np.zeros(bars)
        counts, start, width = self.histogram
        filled = np.flatnonzero(counts)
        middle = start + width * (filled + 0.5)
        share = (middle - self.low) / ((self.high - self.low) or 1.0)
        bar = np.clip((share * bars).astype(np.int64), 0, bars - 1)
        tall = np.log1p(np.bincount(bar, counts[filled], bars))
        return np.asarray(tall / (tall.max() or 1.0))


def survey_steps(volume: Volume) -> Steps[Survey]:
    """Look through a volume once or twice, as steps.

    Examples
    --------
    >>> from ctmc_addon.core.progress import finish
    >>> values = np.array([[[0, 0], [2, 0]], [[0, 5], [5, 5]]], np.uint8)
    >>> finish(survey_steps(Volume(values, np.eye(4), kind="label"))).labels
    ((2, 1), (5, 3))
    """
    values = volume.values
    try:
        found: Histogram | None = yield from within(histogram_steps(values), 0.0, 0.7)
    except ThresholdError:
        found = None
    low, high, broken = float("nan"), float("nan"), values.size
    if found is not None:
        counts, start, width = found
        filled = np.flatnonzero(counts)
        whole = width == 1.0 and values.dtype.kind in "bui"
        low = start + width * (filled[0] + (0.5 if whole else 0.0))
        high = start + width * (filled[-1] + (0.5 if whole else 1.0))
        broken = values.size - int(counts.sum())
    labels: tuple[tuple[int, int], ...] = ()
    if volume.kind == "label" and found is not None:
        labels = yield from within(label_steps(values, found), 0.7, 1.0)
    return Survey(low, high, found, broken, labels, fingerprint(volume, found))


def label_steps(values: NDArray[Any], found: Histogram) -> Steps[tuple[tuple[int, int], ...]]:
    """Every label but 0 and its number of voxels, labels that are no whole numbers left out."""
    if values.dtype.kind in "bui" and found[2] == 1.0:
        counts, start, _ = found
        first = int(start + 0.5)
        return tuple((first + int(at), int(counts[at])) for at in np.flatnonzero(counts) if first + at)
    voxels: dict[int, int] = {}
    for number, slab in enumerate(slabs(values)):
        yield Step(number / len(values), "Counting the labels")
        for value, count in zip(*(one.tolist() for one in np.unique(slab, return_counts=True)), strict=True):
            if value and value == value // 1:
                voxels[int(value)] = voxels.get(int(value), 0) + count
    return tuple(sorted(voxels.items()))


def fingerprint(volume: Volume, found: Histogram | None) -> str:
    """Twelve letters made from a volume's size, place and how often it holds each value."""
    digest = hashlib.sha256(repr((volume.size, volume.kind)).encode())
    # Rounded: another version of a library may place the volume a last bit further.
    digest.update((np.round(volume.affine, 4) + 0.0).tobytes())
    if found is not None:
        digest.update(np.ascontiguousarray(found[0], "<i8").tobytes())
        digest.update(np.array(found[1:], "<f8").tobytes())
    return digest.hexdigest()[:12]


BACK, BELOW, ABOVE, LINE = (0.10, 0.10, 0.11), (0.36, 0.36, 0.38), (0.86, 0.55, 0.24), (1.0, 1.0, 1.0)


def histogram_picture(survey: Survey, threshold: float | None, width: int, height: int) -> NDArray[np.float32]:
    """The histogram as a picture, (height, width, 4) float32 from the bottom up, with the threshold as a line in it.

    What is at or above the threshold, inside the surface, has a colour.
    """
    tall = np.ceil(survey.heights(width) * (height - 2))
    filled = np.arange(height)[:, None] < tall  # (height, width)
    span = (survey.high - survey.low) or 1.0
    share = 1.0 if threshold is None else (threshold - survey.low) / span
    column = int(np.clip(share * width, 0, width - 1)) if np.isfinite(share) else width - 1
    above = np.arange(width) >= column
    out = np.empty((height, width, 4), np.float32)
    out[..., :3], out[..., 3] = BACK, 1.0
    out[..., :3][filled & ~above] = BELOW
    if threshold is not None:
        out[..., :3][filled & above] = ABOVE
        out[:, column, :3] = LINE
    return out
