# SPDX-License-Identifier: GPL-3.0-or-later
"""Clicks in structures and in their surroundings compete for the voxels around them.

Each voxel goes to the click from which it is nearest by a time that counts millimeters and differences of smoothed
values: the geodesic distance of Criminisi et al. 2008 (doi:10.1007/978-3-540-88682-2_9), by plane sweeps
(`geodesic`). From a click in a structure the time is cut off where the cut is sharpest: where the difference of values
across the border of what it has, on average over the border, is the largest (after Hojjatoleslami and Kittler 1998,
doi:10.1109/83.701170). So one click makes a structure, and clicks in the surroundings are needed for leaks alone.

Coarse to fine: times are found on blocks of voxels, and only voxels near a border of the result are looked at one by
one. Nothing is read or touched farther from the clicks than `max_mm`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import SettingsError
from ...progress import Stages, Step, Steps, equal_part
from ...volume.smoothing.gaussian import convolved, weights
from ...volume.value_kind import ValueKind
from ...volume.volume import Volume
from ..distance import Mask, Spacing, Window
from ..points import Sample, sample_in, window_around
from .coarse import Coarse, Factors, block_means, blocks_any, drawn_steps, sharpest_cuts
from .geodesic import BLOCKED, NEVER, cost_of, heights_of, sweep_steps

Labels = NDArray[np.uint8]
Floats = NDArray[np.float32]
MOST_CLICKS = 255
HU_PER_MM = 2.0
MAX_MM = 65.0
MOST_COARSE = 1 << 20  # blocks of voxels
COARSE_MM = 1.4  # blocks are not made larger than twice this while there are few enough of them
SIGMA_MM = 2.0
BALL_MM = 3.0  # around a click what is like it belongs to it
ALIKE_MM = 20.0  # of time by difference alone
SMALLEST = 3.0  # times the ball of a click, against noise
SOFT_HU, MIDDLE_HU = 150.0, 50.0  # differences count in full near soft tissue, less in bone and air
TABLE_HU = (-1024, 3072)
GRAY_HU = 120.0  # between the lowest and the highest percent of values that are not HU
STAGES = {"Looking at the values": 4, "Competing": 4, "Drawing the border": 3}
FAR_SHARE = 0.4  # of the sharpness that is taken off at the longest time, so that a near cut wins over a leak


class Click(NamedTuple):
    """A sample (slice, row, column) that belongs to a structure, numbered from 1; to the surroundings if that is 0."""

    sample: Sample
    structure: int


def compete_steps(
    volume: Volume,
    clicks: Sequence[Click],
    allowed: Mask | None = None,
    hu_per_mm: float = HU_PER_MM,
    max_mm: float = MAX_MM,
) -> Steps[Labels]:
    """Give the voxels around clicks to structures.

    Parameters
    ----------
    volume : Volume
        HU; other gray values are scaled so that 98 % of them lie within 120 HU.
    clicks : sequence of Click
        At most 255.
    allowed : (slices, rows, columns) bool, optional
        Such as a range: other voxels belong to no structure.
    hu_per_mm : float
        How many HU count as much as a millimeter; fewer make the border follow the values more closely.
    max_mm : float
        Longest time from a click; nothing farther from it as the crow flies belongs to a structure.

    Returns
    -------
    (slices, rows, columns) uint8
        Numbers of structures, 0 elsewhere.

    Raises
    ------
    SettingsError
        If there is no click in a structure, more than 255, one that is not allowed, or a number is not above zero.
    """
    if not (0 < hu_per_mm < math.inf and 0 < max_mm < math.inf):
        raise SettingsError(f"hu_per_mm and max_mm are numbers above 0, not {hu_per_mm:g} and {max_mm:g}; raise them")
    if len(clicks) > MOST_CLICKS:
        raise SettingsError(f"{len(clicks)} clicks compete, and at most {MOST_CLICKS} can; draw in several regions")
    own = [click for click in clicks if click.structure]
    if not own:
        raise SettingsError("no click lies in a structure; give one, the surroundings come after it")
    if allowed is not None and not all(allowed[click.sample] for click in own):
        raise SettingsError("a click in a structure lies outside of the range; widen the range, or click elsewhere")
    stages = Stages(STAGES)
    finding, competing, drawing = STAGES
    window = window_around([click.sample for click in own], max_mm, volume.spacing, volume.shape)
    near = [Click(sample_in(click.sample, window), click.structure) for click in clicks if _is_in(click.sample, window)]
    permitted = None if allowed is None else allowed[window]
    tissue = yield from stages.run(finding, _tissue_steps(volume, window))
    blocks = factors_of(tissue.shape, volume.spacing)
    coarse = yield from stages.run(competing, _coarse_steps(tissue, permitted, near, volume, blocks, hu_per_mm, max_mm))
    labels = np.zeros(volume.shape, np.uint8)
    labels[window] = yield from stages.run(drawing, drawn_steps(tissue, permitted, coarse))
    for click in clicks:
        labels[click.sample] = click.structure
    return labels


def factors_of(shape: Sequence[int], spacing_mm: Spacing) -> Factors:
    """Return how many voxels along z, y and x are one block: shorter sides first, until there are few enough blocks.

    Examples
    --------
    >>> factors_of((256, 256, 256), (0.8, 0.8, 0.8)), factors_of((64, 64, 64), (3.0, 3.0, 3.0))
    ((3, 3, 3), (1, 1, 1))
    """
    factors, sides = [1, 1, 1], list(reversed(spacing_mm))

    def blocks() -> int:
        return math.prod(-(-count // factor) for count, factor in zip(shape, factors, strict=True))

    while True:
        lengths = [side * factor for side, factor in zip(sides, factors, strict=True)]
        shortest = min(lengths)
        if shortest >= COARSE_MM and blocks() <= MOST_COARSE:
            return factors[0], factors[1], factors[2]
        for axis, length in enumerate(lengths):
            if length < shortest * 1.01:
                factors[axis] += 1


def _tissue_steps(volume: Volume, window: Window) -> Steps[Floats]:
    """Return the values in a window on a scale where a difference of soft tissues counts in full, float32."""
    z, y, x = window
    shape = tuple(side.stop - side.start for side in window)
    tissue = np.empty(shape, np.float32)
    low, high = TABLE_HU
    hu = np.arange(low, high + 1, dtype=np.float64)
    # Rounded, so that the last bit of a machine's logarithm does not matter.
    table = (np.rint(SOFT_HU * np.arcsinh((hu - MIDDLE_HU) / SOFT_HU) * 16) / 16).astype(np.float32)
    first, share = 0.0, 1.0
    if volume.kind != ValueKind.HU:
        table = (hu - low).astype(np.float32)
        sample = volume.samples(
            *(range(side.start, side.stop, max(1, (side.stop - side.start) // 48)) for side in window)
        )
        ends = np.percentile(sample[np.isfinite(sample)], (1.0, 99.0)) if np.isfinite(sample).any() else (0.0, 1.0)
        first, share = float(ends[0]), GRAY_HU / max(float(ends[1]) - float(ends[0]), 1e-12)
    layers = max(1, (1 << 20) // (shape[1] * shape[2]))
    for start in range(z.start, z.stop, layers):
        stop = min(z.stop, start + layers)
        values: NDArray[Any] = volume.samples(range(start, stop), range(y.start, y.stop), range(x.start, x.stop))
        if volume.kind != ValueKind.HU:
            values = (values - first) * share + low
        if values.dtype.kind == "f":
            values = np.nan_to_num(values, nan=low, posinf=high, neginf=low).clip(low, high).round()
        at = np.clip(values, low, high).astype(np.int16) - np.int16(low)
        np.take(table, at, out=tissue[start - z.start : stop - z.start])
        yield Step((stop - z.start) / shape[0])
    return tissue


def _coarse_steps(
    tissue: Floats,
    permitted: Mask | None,
    clicks: Sequence[Click],
    volume: Volume,
    blocks: Factors,
    hu_per_mm: float,
    max_mm: float,
) -> Steps[Coarse]:
    """Let the clicks compete on blocks of voxels."""
    x, y, z = (side * factor for side, factor in zip(volume.spacing, reversed(blocks), strict=True))
    means = block_means(tissue, blocks)
    for axis, side in enumerate((z, y, x)):
        means = convolved(means, weights(SIGMA_MM / side), axis)
        yield Step(0.05 * (axis + 1))
    heights = heights_of(means, hu_per_mm)
    times = np.full(means.shape, NEVER, np.uint32)
    balls = []
    for number, click in enumerate(clicks):
        cell = tuple(at // factor for at, factor in zip(click.sample, blocks, strict=True))
        near, away_mm = _ball(means.shape, cell, (z, y, x))
        alike = np.abs(heights[near] - heights[cell]) <= cost_of(ALIKE_MM)
        own = alike & (away_mm <= BALL_MM * (1 + 1e-6))
        times[near][own] = number
        balls.append(int((away_mm <= BALL_MM * (1 + 1e-6)).sum()))
    if permitted is not None:
        heights[~blocks_any(permitted, blocks)] += BLOCKED
    times = yield from equal_part(sweep_steps(times, heights, (x, y, z)), 1, 2)
    structures = np.array([click.structure for click in clicks], np.uint8)
    smallest = [SMALLEST * ball for ball in balls]
    # Times begin at the border of a ball around the middle of a block, and the click may be at the block's corner.
    corner_mm = math.hypot(*(side * (1 - 1 / factor) / 2 for side, factor in zip((z, y, x), blocks, strict=True)))
    longest = cost_of(max(max_mm - BALL_MM - corner_mm, max_mm / 10))
    cuts = sharpest_cuts(times, means, structures, smallest, longest, FAR_SHARE)
    return Coarse(times, heights, structures, cuts, blocks, volume.spacing, hu_per_mm)


def _ball(
    shape: Sequence[int], center: Sequence[int], sides_mm: Sequence[float]
) -> tuple[tuple[slice, ...], NDArray[np.float64]]:
    """Return the window that a click's ball lies in, and how far its samples are from the middle, mm."""
    window, squares = [], []
    for count, at, side in zip(shape, center, sides_mm, strict=True):
        reach = math.ceil(BALL_MM / side)
        window.append(slice(max(0, at - reach), min(count, at + reach + 1)))
        squares.append(((np.arange(window[-1].start, window[-1].stop) - at) * side) ** 2)
    z, y, x = squares
    return tuple(window), np.sqrt(z[:, None, None] + y[:, None] + x)


def _is_in(sample: Sample, window: Window) -> bool:
    return all(side.start <= at < side.stop for at, side in zip(sample, window, strict=True))
