# SPDX-License-Identifier: GPL-3.0-or-later
"""The border of a structure between claims, values and smoothness: a minimal cut, relaxed.

What clicks have claimed gives two histograms: values of the structure, and values around it. The border that is drawn
has the least sum of three costs: blocks whose value is more frequent on the other side (log of the ratio of the two
histograms, as Boykov and Jolly 2001, doi:10.1109/ICCV.2001.937505), blocks that lie on the other side of the claims, by
time (as Price, Morse and Cohen 2010, doi:10.1109/CVPR.2010.5540079), and the area of the border, which costs less where
values change. The least is found by a fixed number of primal-dual steps (Chambolle and Pock 2011,
doi:10.1007/s10851-010-0251-1), each a few sums over whole arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags
from ...progress import PAUSE, Steps, equal_part
from ...smoothing.gaussian import convolved, weights
from ..distance import Window, grown_window, near_steps, window_of
from ..points import Sample, sample_in
from ..tools.islands import touching_steps
from .claims import Claims, Floats, Sides
from .geodesic import NEVER, cost_of

AROUND_MM = 15.0  # Values up to this far around a structure are the other histogram.
# The width of a bin in units of the values, and the number of bins around the mean of what was clicked.
BIN, BINS = 4.0, 256
BLUR = 8.0  # Blur the histograms by this many units of the values.
CLICKED = 0.3  # The clicked values have this share in a histogram; claimed values have the rest.
RAREST = 1e-4
SUREST = 3.0  # The largest log of a ratio.
CLAIM, CLAIM_MM = 1.2, 6.0  # Cost of the other side of a claim, in full from this many mm of time from its border on.
EDGE = 20.0  # A change by this many units of the values from block to block makes the border cheap.
CHEAPEST = 0.1
PER_UNIT = 8  # Prices are looked up by the squared change, in steps of an eighth of a unit.
# They fall as a Gaussian of the change, in 256ths. The exponential of each block would have another last bit on another
# processor, and here and there fall to the other side of a 256th.
FALLING = np.rint(256 * np.exp(np.arange(7 * PER_UNIT * EDGE * EDGE) / (-PER_UNIT * EDGE * EDGE))) / 256
PRICES = (CHEAPEST + (1 - CHEAPEST) * FALLING).astype(np.float32)
ROUNDS = 40
STEP, DUAL_STEP = np.float32(0.3), np.float32(0.27)  # Their product is below 1/12, for three axes.


class BorderEvidence(NamedTuple):
    """Certainty that a block belongs to a structure, 0 to 1, and evidence of values for voxels at the border.

    Parameters
    ----------
    window : (z, y, x) slices of blocks
    share : (slices, rows, columns) float32
    ratios : (bins,) float32
        Log of structure to surroundings, by value.
    lowest : float
        Value of the first bin.
    """

    window: Window
    share: Floats
    ratios: Floats
    lowest: float


def border_steps(
    claims: Claims, values: Floats, sides_mm: Sides, clicks: Sequence[tuple[Sample, int]], structure: int
) -> Steps[BorderEvidence | None]:
    """Find the border of a structure; None where it has no block.

    Parameters
    ----------
    claims : Claims
    values : (slices, rows, columns) float32
        Means of blocks, little smoothed.
    sides_mm : (z, y, x) float
        Sides of a block.
    clicks : sequence of ((slice, row, column), int)
        Blocks, and the structure of each; 0 for the surroundings.
    structure : int
    """
    z, y, x = sides_mm
    window = window_of(claims.labels == structure)
    if window is None:
        return None
    window = grown_window(window, AROUND_MM, (x, y, z), values.shape)
    labels, times, left, reached = claims.part(window)
    near = values[window]
    inside = labels == structure
    around = yield from equal_part(near_steps(inside, (x, y, z), AROUND_MM), 0, 4)
    own = [sample_in(block, window) for block, number in clicks if number == structure]
    outside_blocks = [
        sample_in(block, window)
        for block, number in clicks
        if number != structure and all(side.start <= at < side.stop for at, side in zip(block, window, strict=True))
    ]
    lowest = float(np.rint(np.mean([near[block] for block in own]))) - BIN * BINS / 2
    bins = _bins(near, lowest)
    ratios = _log(_frequencies(bins, inside, own)) - _log(_frequencies(bins, around & ~inside, outside_blocks))
    np.clip(ratios, -SUREST, SUREST, out=ratios)
    surely = np.clip(left * np.float32(1 / cost_of(CLAIM_MM)), -1, 1)
    surely[(times < NEVER) & ~inside] *= -1
    gain = ratios[bins] + np.float32(CLAIM) * surely
    gain[~reached] = -SUREST - CLAIM
    fixed = np.zeros(near.shape, np.int8)
    for block in outside_blocks:
        fixed[block] = -1
    for block in own:
        fixed[block] = 1
    share = yield from equal_part(_least_steps(gain, _prices(near), fixed, sides_mm), 1, 2)
    kept = yield from touching_steps(share > 0.5, own)
    share[~kept] = np.minimum(share[~kept], 0.5)
    return BorderEvidence(window, share, ratios, lowest)


def _bins(values: Floats, lowest: float) -> NDArray[np.intp]:
    return np.clip((values - np.float32(lowest)) * np.float32(1 / BIN), 0, BINS - 1).astype(np.intp)


def _frequencies(bins: NDArray[np.intp], mask: Flags, clicked: Sequence[Sample]) -> NDArray[np.float64]:
    """Return how frequent values are in a mask and around clicks, blurred, with the sum 1."""
    whole = np.bincount(bins[mask], minlength=BINS).astype(np.float64)
    seen = np.zeros(BINS)
    for block in clicked:
        ball = bins[tuple(slice(max(0, at - 1), at + 2) for at in block)]
        seen += np.bincount(ball.ravel(), minlength=BINS) / ball.size
    share = CLICKED if clicked else 0.0
    mixed = (1 - share) * whole / max(whole.sum(), 1) + share * seen / max(len(clicked), 1)
    return convolved(mixed.astype(np.float32), weights(BLUR / BIN), 0).astype(np.float64)


def _log(frequencies: NDArray[np.float64]) -> Floats:
    """Return logarithms, rounded so that the last bit of a machine's does not matter."""
    return (np.rint(np.log(frequencies + RAREST) * 256) / 256).astype(np.float32)


def _prices(values: Floats) -> Floats:
    """Return the cost of a border in each block: less where values change."""
    squares = np.zeros_like(values)
    for axis, count in enumerate(values.shape):
        if count > 1:
            squares += np.gradient(values, axis=axis) ** 2
    squares *= np.float32(PER_UNIT)
    return PRICES.take(np.minimum(squares, np.float32(len(PRICES) - 1), out=squares).astype(np.int32))


def _least_steps(gain: Floats, prices: Floats, fixed: NDArray[np.int8], sides_mm: Sides) -> Steps[Floats]:
    """Return the shares, 0 to 1, with the least price of borders less gain."""
    share = (gain > 0).astype(np.float32)
    ahead = share.copy()
    flows = [np.zeros_like(gain) for _ in sides_mm]
    inside, outside = fixed > 0, fixed < 0
    lower = -prices
    for _ in range(ROUNDS):
        change = gain.copy()
        for axis, (flow, side) in enumerate(zip(flows, sides_mm, strict=True)):
            per_side = np.float32(min(sides_mm) / side)
            head, tail = (slice(None),) * axis + (slice(1, None),), (slice(None),) * axis + (slice(None, -1),)
            flow[tail] += DUAL_STEP * per_side * (ahead[head] - ahead[tail])
            np.maximum(flow, lower, out=flow)  # both together take a tenth of the time of np.clip with arrays
            np.minimum(flow, prices, out=flow)
            moved = per_side * flow[tail]
            change[tail] += moved
            change[head] -= moved
        change *= STEP
        change += share
        np.clip(change, 0, 1, out=change)
        change[inside], change[outside] = 1, 0
        np.subtract(2 * change, share, out=ahead)
        share = change
        yield PAUSE
    return share


def drawn_shares(border: BorderEvidence, at: tuple[NDArray[np.intp], ...], factors: Sequence[int]) -> Floats:
    """Return the shares of voxels (z, y, x), interpolated between the middles of blocks."""
    low, high, part = [], [], []
    for index, factor, side, count in zip(at, factors, border.window, border.share.shape, strict=True):
        place = np.clip((index + 0.5) / factor - 0.5 - side.start, 0, count - 1)
        first = np.floor(place).astype(np.intp)
        low.append(first)
        high.append(np.minimum(first + 1, count - 1))
        part.append((place - first).astype(np.float32))
    total = np.zeros(len(at[0]), np.float32)
    for corner in np.ndindex(2, 2, 2):
        block = tuple(high[axis] if up else low[axis] for axis, up in enumerate(corner))
        share = border.share[block]
        for axis, up in enumerate(corner):
            share = share * (part[axis] if up else 1 - part[axis])
        total += share
    return total


def value_ratios(border: BorderEvidence, values: Floats) -> Floats:
    """Return the log of structure to surroundings of some values."""
    return border.ratios[_bins(values, border.lowest)]
