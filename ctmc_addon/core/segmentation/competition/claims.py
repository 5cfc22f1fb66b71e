# SPDX-License-Identifier: GPL-3.0-or-later
"""Clicks claim blocks of voxels, one after the other.

A block belongs to the click from which it is nearest by time. A click in a structure claims up to the time at which the
cut is sharpest: where the difference of values across the border of what it has, on average over the border, is the
largest (after Hojjatoleslami and Kittler 1998, doi:10.1109/83.701170). The first click takes a smaller structure, such
as a tumor in a liver, where all around a near cut is brighter, or all is darker, and behind it nothing is.
A later click corrects what the earlier ones came to, so it reaches only a few times as far as it lies from what is
right, and less far in a small structure: a click beside the border changes the border there, and no click undoes what
another has done elsewhere. Nor does it lead through values that are unlike those of the structure and its own. In a
bone a correction may go on behind the next sharp border, which may be that of its marrow.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags, Floats, Ints
from ...progress import Steps
from ..distance import Window
from ..points import Sample, sample_in, window_around
from .geodesic import BLOCKED, NEVER, Times, cost_of, sweep_steps

Sides = tuple[float, float, float]
BINS = 128  # Bins of times, for the sharpest cut.
# Shares of the sharpness that are taken off at the longest time, so that a near cut wins over a leak.
FAR, FAR_CORRECTION, FAR_BONE = 0.4, 0.6, 0.1
BONE_SHARE = 0.1  # At least this share of a bone has bone's values: the rest may be marrow.
COHERENT = 0.9  # Around a structure in a larger one this share of the sharpness is only a rise or only a fall.
VALLEY, FLAT = 0.5, 0.25  # Sharpness and rise behind a structure's cut, as shares of the rise there.
LEAST_RISE = 4.0  # A rise from block to block in units of the values, against noise.
LONGER = 1.5  # The first click's longest time is this many times its reach, for what differences of values cost.
BEYOND = 1.5  # The border lies at most this many times the cut away.
BALL_MM = 3.0  # Similar values this near to a click belong to it.
ALIKE_MM = 20.0  # Values that differ from the click's by at most this time are like it.
SMALLEST = 3  # A claim is at least this many times the ball of a click, against noise.
# A correction reaches at most this many mm, and this many times its distance from what is right.
REACH_MM, REACH = 6.0, 6.0
LEAST_REACH, RADIUS_MM = 2.0, 4.0  # A small structure has the factor radius / RADIUS_MM instead of REACH.
LIKE = 30.0  # Values that a correction adds differ from the structure's by at most this many units.
RARE = 0.02  # Ignore this share of the structure's values at either end.


class Ground(NamedTuple):
    """Blocks on which times are counted.

    Parameters
    ----------
    values : (slices, rows, columns) float32
        Smoothed means of blocks.
    heights : (slices, rows, columns) int32
        As of `geodesic.heights_of`.
    sides_mm : (z, y, x) float
        Sides of a block.
    bone : float
        Values above it are bone's; infinite where values are not HU.
    """

    values: Floats
    heights: Ints
    sides_mm: Sides
    bone: float


class Claims(NamedTuple):
    """Blocks of a grid that clicks have claimed.

    Parameters
    ----------
    labels : (slices, rows, columns) uint8
        Numbers of structures; 0 for the surroundings and for what no click has claimed.
    times : (slices, rows, columns) uint32
        Time from the click that has claimed a block, `NEVER` if none has.
    left : (slices, rows, columns) int32
        Time that was left to the click that has claimed a block; below 0 where no click has, by how much it is missed.
    reached : (slices, rows, columns) bool
        Near enough to a click in a structure to belong to it.
    """

    labels: NDArray[np.uint8]
    times: Times
    left: NDArray[np.int32]
    reached: Flags

    def part(self, window: Window) -> Claims:
        """Return views of a window."""
        return Claims(self.labels[window], self.times[window], self.left[window], self.reached[window])


def no_claims(shape: tuple[int, ...]) -> Claims:
    """Return a grid of which nothing is claimed."""
    left = np.full(shape, -NEVER, np.int32)
    return Claims(np.zeros(shape, np.uint8), np.full(shape, NEVER, np.uint32), left, np.zeros(shape, bool))


def claim_steps(claims: Claims, ground: Ground, block: Sample, structure: int, max_mm: float) -> Steps[None]:
    """Let a click in a block claim the blocks around it, in place.

    Parameters
    ----------
    claims : Claims
    ground : Ground
    block : (slice, row, column) int
    structure : int
        0 for the surroundings.
    max_mm : float
        Reach of the first click in a structure.
    """
    reach_mm = _reach_mm(claims.labels, block, structure, ground.sides_mm, max_mm)
    if reach_mm == 0:
        return
    z, y, x = ground.sides_mm
    window = window_around([block], reach_mm, (x, y, z), claims.labels.shape)
    own = claims.part(window)
    values, heights = ground.values[window], ground.heights[window]
    ball, alike = _ball(heights, sample_in(block, window), ground.sides_mm)
    own_values = ground.values[claims.labels == structure] if structure else values[:0]
    passable = _squares_from(sample_in(block, window), values.shape, ground.sides_mm) <= reach_mm * reach_mm
    if own_values.size:
        passable &= _is_like(values, own_values, values[ball][alike])
    heights = heights + np.where(passable, 0, np.int32(BLOCKED))
    times = np.full(heights.shape, NEVER, np.uint32)
    times[ball][alike] = 0
    times = yield from sweep_steps(times, heights, (x, y, z))
    longest = cost_of(max(reach_mm - BALL_MM, reach_mm / 10) * (LONGER if structure and not own_values.size else 1))
    nearer = times < own.times
    cut = longest
    if structure:
        competing = np.where(nearer, times, np.uint32(NEVER))
        far = FAR if not own_values.size else FAR_BONE if _is_bone(own_values, ground.bone) else FAR_CORRECTION
        cut = _sharpest_cut(competing, values, own.labels == structure, SMALLEST * alike.size, longest, far)
        own.reached[...] |= times < min(longest, BEYOND * cut)
    left = np.int32(cut) - times.astype(np.int32)
    claimed = nearer & (left > 0)
    if structure:
        missed = (own.times == NEVER) & ~claimed
        own.left[missed] = np.maximum(own.left[missed], left[missed])
    own.labels[claimed] = structure
    own.times[claimed] = times[claimed]
    own.left[claimed] = left[claimed]


def _reach_mm(labels: NDArray[np.uint8], block: Sample, structure: int, sides_mm: Sides, max_mm: float) -> float:
    """Return how far a click reaches; 0 where nothing is to be corrected."""
    right = labels == structure
    if structure and not right.any():
        return max_mm
    if right[block]:
        return 0.0
    z, y, x = ((at - here) * side for at, here, side in zip(np.nonzero(right), block, sides_mm, strict=True))
    away_mm = math.sqrt(float((z * z + y * y + x * x).min())) if z.size else max_mm
    volume_mm3 = np.count_nonzero(right if structure else labels) * math.prod(sides_mm)
    radius_mm = round((0.75 * volume_mm3 / math.pi) ** (1 / 3), 3)  # a machine's last bit does not matter
    slope = min(max(radius_mm / RADIUS_MM, LEAST_REACH), REACH)
    return min(max_mm, min(REACH_MM, radius_mm) + slope * away_mm)


def _is_bone(own_values: Floats, bone: float) -> bool:
    """Return whether a structure of these values is a bone, inside which shell and marrow differ as much as borders."""
    return bool(np.count_nonzero(own_values > bone) > BONE_SHARE * own_values.size)


def _is_like(values: Floats, own_values: Floats, clicked: Floats) -> Flags:
    """Return which values lie near those that a structure has, or near those of a click."""
    rare = int(own_values.size * RARE)
    low, high = np.partition(own_values, (rare, own_values.size - 1 - rare))[
        [rare, own_values.size - 1 - rare]
    ].tolist()
    low, high = min(low, float(clicked.min())) - LIKE, max(high, float(clicked.max())) + LIKE
    return (values >= low) & (values <= high)


def _squares_from(block: Sample, shape: tuple[int, ...], sides_mm: Sides) -> NDArray[np.float64]:
    """Return squared distances of all blocks from one, mm2."""
    z, y, x = (((np.arange(count) - at) * side) ** 2 for count, at, side in zip(shape, block, sides_mm, strict=True))
    return z[:, None, None] + y[:, None] + x


def _ball(heights: Ints, block: Sample, sides_mm: Sides) -> tuple[Window, Flags]:
    """Return the window of a click's ball, and which blocks in it are in the ball and like the click's own."""
    z, y, x = sides_mm
    window = window_around([block], BALL_MM, (x, y, z), heights.shape)
    part = heights[window]
    inside = _squares_from(sample_in(block, window), part.shape, sides_mm) <= BALL_MM * BALL_MM * (1 + 1e-6)
    return window, inside & (np.abs(part - heights[block]) <= cost_of(ALIKE_MM))


def _sharpest_cut(times: Times, values: Floats, same: Flags, smallest: int, longest: int, far: float) -> int:
    """Return the time to cut off at: where values differ most across the border of the inside, on average.

    A pair of neighbors counts while one is inside and the other is not. Pairs are summed in bins of time, so all cuts
    are compared in one look at the pairs.

    A first click has the first cut around which all rises or all falls, if little does behind it.

    Parameters
    ----------
    times : (slices, rows, columns) uint32
        `NEVER` where another click is nearer.
    values : (slices, rows, columns) float32
    same : (slices, rows, columns) bool
        Blocks of the structure already; a border with them does not count.
    smallest : int
        Blocks that are inside at least.
    longest : int
        The longest time.
    far : float
        Share of the mean difference that is taken off at the longest time, and in proportion before.
    """
    flat, level, other_clicks = times.ravel(), values.ravel(), same.ravel()
    inside = np.flatnonzero(flat < longest)
    bins = _bins(flat[inside], longest)
    sums, rises, pairs = np.zeros(BINS + 1), np.zeros(BINS + 1), np.zeros(BINS + 1, np.int64)
    place = np.unravel_index(inside, times.shape)
    for axis, pitch in enumerate((times.shape[1] * times.shape[2], times.shape[2], 1)):
        for step in (-1, 1):
            at = np.flatnonzero((place[axis] + step >= 0) & (place[axis] + step < times.shape[axis]))
            neighbor = inside[at] + step * pitch
            later = _bins(flat[neighbor], longest)
            counts = (later > bins[at]) & ~other_clicks[neighbor]
            at, neighbor, later = at[counts], neighbor[counts], later[counts]
            rise = level[neighbor] - level[inside[at]]
            for ends, sign in ((bins[at], 1), (later, -1)):
                sums += sign * np.bincount(ends, np.abs(rise), BINS + 1)
                rises += sign * np.bincount(ends, rise, BINS + 1)
                pairs += sign * np.bincount(ends, minlength=BINS + 1)
    across = np.maximum(np.cumsum(pairs), 1)[:BINS]
    sharpness, rise = np.cumsum(sums)[:BINS] / across, np.abs(np.cumsum(rises)[:BINS] / across)
    best = None if same.any() else _first_cut(sharpness, rise)
    if best is None:
        sharpness *= 1 - far * np.arange(BINS) / BINS
        sharpness[np.cumsum(np.bincount(bins, minlength=BINS))[:BINS] < smallest] = 0
        # A click without any pair, alone in a grid of one value, has what it reaches.
        best = int(sharpness.argmax()) if sharpness.max() > 0 else BINS - 1
    return (best + 1) * max(1, longest // BINS)


def _first_cut(sharpness: NDArray[np.float64], rise: NDArray[np.float64]) -> int | None:
    """Return the cut around a structure in a larger one, None where there is none.

    All around it values rise, or all around they fall, so that the mean difference is as large as the mean of the
    absolute differences. Behind it, in the larger structure, neither is.
    """
    coherent = np.where(rise > COHERENT * sharpness, rise, 0)
    highest = np.maximum.accumulate(coherent)
    behind = (highest > LEAST_RISE) & ((sharpness < VALLEY * highest) | (rise < FLAT * highest))
    return int(coherent[: int(behind.argmax())].argmax()) if behind.any() else None


def _bins(times: Times, longest: int) -> NDArray[np.int64]:
    return np.minimum(times // np.uint32(max(1, longest // BINS)), BINS).astype(np.int64)
