# SPDX-License-Identifier: GPL-3.0-or-later
"""A competition on blocks of voxels: where each click's time is cut off, and the border drawn voxel by voxel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...progress import Step, Steps
from ..distance import Mask, Spacing
from .geodesic import BLOCKED, NEVER, OWNER_BITS, UNIT, Heights, Times

Floats = NDArray[np.float32]
Factors = tuple[int, int, int]
BINS = 128  # of times, for the sharpest cut
OWNER = np.uint32((1 << OWNER_BITS) - 1)
VOXELS_PER_STEP = 1 << 18


class Coarse(NamedTuple):
    """What a competition on blocks came to.

    Parameters
    ----------
    times, heights : (slices, rows, columns) of blocks
        As of `geodesic.sweep_steps`.
    structures : (clicks,) uint8
    cuts : (clicks,) uint32
        First time that no longer belongs to the click's structure.
    blocks : (z, y, x) int
        Voxels of a block.
    spacing_mm : (x, y, z) float
        Of voxels.
    hu_per_mm : float
    """

    times: Times
    heights: Heights
    structures: NDArray[np.uint8]
    cuts: NDArray[np.uint32]
    blocks: Factors
    spacing_mm: Spacing
    hu_per_mm: float

    def labels(self, times: Times) -> NDArray[np.uint8]:
        """Return the structures that some times belong to."""
        owners = np.minimum(times & OWNER, np.uint32(len(self.structures) - 1))
        return np.where(times < self.cuts[owners], self.structures[owners], np.uint8(0))


def block_means(values: Floats, factors: Factors) -> Floats:
    """Return the mean of every block of voxels; the last ones along an axis may be smaller.

    Examples
    --------
    >>> block_means(np.arange(6, dtype=np.float32).reshape(1, 2, 3), (1, 2, 2)).tolist()
    [[[2.0, 3.5]]]
    """
    for axis, factor in enumerate(factors):
        if factor > 1:
            starts = np.arange(0, values.shape[axis], factor)
            counts = np.diff(np.append(starts, values.shape[axis])).astype(np.float32)
            shape = [1, 1, 1]
            shape[axis] = len(starts)
            values = np.add.reduceat(values, starts, axis=axis) / counts.reshape(shape)
    return values


def blocks_any(mask: Mask, factors: Factors) -> Mask:
    """Return which blocks have a voxel of a mask."""
    for axis, factor in enumerate(factors):
        if factor > 1:
            mask = np.logical_or.reduceat(mask, np.arange(0, mask.shape[axis], factor), axis=axis)
    return mask


def sharpest_cuts(
    times: Times,
    values: Floats,
    structures: NDArray[np.uint8],
    smallest: Sequence[float],
    longest: int,
    far_share: float,
) -> NDArray[np.uint32]:
    """Return for every click the time to cut off at: where values differ most across what is inside, on average.

    The mean over a click's own border and that over the borders of all clicks of its structure count alike. A pair of
    neighbors counts while one is inside and the other is not, unless that is another click's of the same structure.
    Pairs are summed in bins of time, so all cuts are compared in one look at the pairs.

    Parameters
    ----------
    times : (slices, rows, columns) uint32
        As of `geodesic.sweep_steps`.
    values : (slices, rows, columns) float32
    structures : (clicks,) uint8
        0 for the surroundings, which have no time.
    smallest : sequence of float
        Samples that each click has at least.
    longest : int
        The longest time.
    far_share : float
        Share of the mean difference that is taken off at the longest time, and in proportion before.
    """
    clicks, wide = len(structures), BINS + 2
    flat, shape = times.ravel(), np.array(times.shape)
    own = structures[np.minimum(flat & OWNER, np.uint32(clicks - 1))]
    inside = np.flatnonzero((own > 0) & (flat < longest))
    owner = (flat[inside] & OWNER).astype(np.int64)
    bins = _bins(flat[inside], longest)
    level = values.ravel()
    total, count = np.zeros(clicks * wide), np.zeros(clicks * wide, np.int64)
    place = np.stack(np.unravel_index(inside, times.shape))
    for axis, pitch in enumerate((times.shape[1] * times.shape[2], times.shape[2], 1)):
        for step in (-1, 1):
            at = np.flatnonzero((place[axis] + step >= 0) & (place[axis] + step < shape[axis]))
            other = inside[at] + step * pitch
            same = (flat[other] & OWNER).astype(np.int64) == owner[at]
            later = np.where(same, _bins(flat[other], longest), BINS)
            counts = (same & (later > bins[at])) | (~same & (own[other] != own[inside[at]]))
            at, other, later = at[counts], other[counts], later[counts]
            difference = np.abs(level[inside[at]] - level[other])
            for ends, sign in ((bins[at], 1), (later, -1)):
                keys = owner[at] * wide + ends
                total += sign * np.bincount(keys, difference, clicks * wide)
                count += sign * np.bincount(keys, minlength=clicks * wide)
    sums, pairs = (np.cumsum(table.reshape(clicks, wide), axis=1) for table in (total, count))
    samples = np.cumsum(np.bincount(owner * wide + bins, minlength=clicks * wide).reshape(clicks, wide), axis=1)
    sharpness = sums / np.maximum(pairs, 1) * (1 - far_share * np.arange(wide) / BINS)
    sharpness = _with_the_structure(sharpness, sums, pairs, structures, far_share)
    sharpness[samples < np.array(smallest)[:, None]] = 0
    best = sharpness[:, :BINS].argmax(axis=1)
    # A click without any pair, alone in a grid of one value, has what it reaches.
    best[sharpness[:, :BINS].max(axis=1) <= 0] = BINS - 1
    return np.where(structures > 0, (best + 1) * (longest // BINS), 0).astype(np.uint32)


def _with_the_structure(
    sharpness: NDArray[np.float64],
    sums: NDArray[np.float64],
    pairs: NDArray[np.int64],
    structures: NDArray[np.uint8],
    far_share: float,
) -> NDArray[np.float64]:
    """Return each click's sharpness, as a share of its best, and that of all clicks of its structure together."""
    both = sharpness / np.maximum(sharpness.max(axis=1, keepdims=True), 1e-9)
    for structure in np.unique(structures[structures > 0]):
        those = structures == structure
        mean = sums[those].sum(axis=0) / np.maximum(pairs[those].sum(axis=0), 1)
        mean *= 1 - far_share * np.arange(sums.shape[1]) / BINS
        both[those] += mean / max(float(mean.max()), 1e-9)
    return both


def _bins(times: Times, longest: int) -> NDArray[np.int64]:
    return np.minimum(times // np.uint32(longest // BINS), BINS).astype(np.int64)


def drawn_steps(tissue: Floats, permitted: Mask | None, coarse: Coarse) -> Steps[NDArray[np.uint8]]:
    """Return the labels of voxels: of their block, or near a border by the time from the blocks around.

    Parameters
    ----------
    tissue : (slices, rows, columns) float32
        On the scale of the blocks' heights.
    permitted : (slices, rows, columns) bool, optional
    coarse : Coarse
    """
    labels = coarse.labels(coarse.times)
    if coarse.blocks == (1, 1, 1):
        return labels if permitted is None else labels * permitted
    drawn = _repeated(labels, coarse.blocks, tissue.shape)
    near = _repeated(_bordering(labels), coarse.blocks, tissue.shape)
    layers = max(1, VOXELS_PER_STEP // (tissue.shape[1] * tissue.shape[2]))
    for low in range(0, len(tissue), layers):
        high = min(len(tissue), low + layers)
        z, y, x = np.nonzero(near[low:high])
        if z.size:
            drawn[low + z, y, x] = _refined((low + z, y, x), tissue, coarse)
        yield Step(high / len(tissue))
    if permitted is not None:
        drawn *= permitted
    return drawn


def _repeated(values: NDArray[np.uint8] | Mask, blocks: Factors, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    fine: NDArray[np.uint8] = values.astype(np.uint8)
    for axis, factor in enumerate(blocks):
        if factor > 1:
            fine = np.repeat(fine, factor, axis=axis)
    return np.ascontiguousarray(fine[: shape[0], : shape[1], : shape[2]])


def _bordering(labels: NDArray[np.uint8]) -> Mask:
    """Return which blocks have another label among the 26 around them."""
    least, most = labels, labels
    for axis in range(3):
        ends = [(0, 0)] * 3
        ends[axis] = (1, 1)
        count = labels.shape[axis]
        for_least, for_most = np.pad(least, ends, mode="edge"), np.pad(most, ends, mode="edge")
        index = [[slice(None)] * axis + [slice(step, step + count)] for step in range(3)]
        least = np.minimum.reduce([for_least[tuple(part)] for part in index])
        most = np.maximum.reduce([for_most[tuple(part)] for part in index])
    return least != most


def _refined(at: tuple[NDArray[np.int64], ...], tissue: Floats, coarse: Coarse) -> NDArray[np.uint8]:
    """Return the labels of voxels (z, y, x), each from the eight blocks around it."""
    value = np.zeros(len(at[0]), np.float32)
    for step in np.ndindex(3, 3, 3):  # noise is smaller in the mean of 27
        place = (
            np.clip(index + move - 1, 0, size - 1) for index, move, size in zip(at, step, tissue.shape, strict=True)
        )
        value += tissue[tuple(place)]
    own = np.rint(value * np.float32(UNIT / (27 * coarse.hu_per_mm))).astype(np.int32) << OWNER_BITS
    lower, apart = [], []
    for index, factor, side in zip(at, coarse.blocks, reversed(coarse.spacing_mm), strict=True):
        first = (2 * index + 1 - factor) // (2 * factor)  # the block whose center is not behind the voxel's
        lower.append(first)
        apart.append((index - first * factor - (factor - 1) / 2) * side)
    best = np.full(len(own), NEVER, np.uint32)
    for corner in np.ndindex(2, 2, 2):
        block = tuple(
            np.clip(first + move, 0, size - 1)
            for first, move, size in zip(lower, corner, coarse.times.shape, strict=True)
        )
        squares = [
            (mm - move * factor * side) ** 2
            for mm, move, factor, side in zip(apart, corner, coarse.blocks, reversed(coarse.spacing_mm), strict=True)
        ]
        length = np.sqrt(squares[0] + squares[1] + squares[2])
        height = coarse.heights[block]
        step_up = np.abs(own - np.where(height >= BLOCKED // 2, height - BLOCKED, height)).astype(np.uint32)
        time = coarse.times[block] + step_up + (np.rint(length * UNIT).astype(np.uint32) << np.uint32(OWNER_BITS))
        np.minimum(best, time, out=best)
    return coarse.labels(best)
