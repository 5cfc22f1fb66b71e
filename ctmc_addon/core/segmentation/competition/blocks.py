# SPDX-License-Identifier: GPL-3.0-or-later
"""Blocks of voxels: how large they are, their means, and their borders drawn voxel by voxel."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags, Floats
from ...progress import Step, Steps
from ..distance import Spacing
from .border import BorderEvidence, drawn_shares, value_ratios

Factors = tuple[int, int, int]
MOST = 1 << 20
SIDE_MM = 1.4  # Blocks are not larger than twice this while there are few enough of them.
VALUE = np.float32(0.1)  # A voxel's own value has this weight at the border.
VOXELS_PER_STEP = 1 << 18


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
        if shortest >= SIDE_MM and blocks() <= MOST:
            return factors[0], factors[1], factors[2]
        for axis, length in enumerate(lengths):
            if length < shortest * 1.01:
                factors[axis] += 1


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


def blocks_any(mask: Flags, factors: Factors) -> Flags:
    """Return which blocks have a voxel of a mask."""
    for axis, factor in enumerate(factors):
        if factor > 1:
            mask = np.logical_or.reduceat(mask, np.arange(0, mask.shape[axis], factor), axis=axis)
    return mask


def drawn_steps(
    tissue: Floats, permitted: Flags | None, borders: Mapping[int, BorderEvidence], factors: Factors
) -> Steps[NDArray[np.uint8]]:
    """Return the structures of voxels: of their block, and near a border by the blocks around and their own value.

    Parameters
    ----------
    tissue : (slices, rows, columns) float32
    permitted : (slices, rows, columns) bool, optional
    borders : mapping of int to BorderEvidence
        Evidence by structure; of two that claim a voxel, the surer one has it.
    factors : (z, y, x) int
        Voxels of a block.
    """
    drawn = np.zeros(tissue.shape, np.uint8)
    best = np.full(tissue.shape, 0.5, np.float32) if len(borders) > 1 else None
    for number, (structure, border) in enumerate(borders.items()):
        window = tuple(
            slice(side.start * factor, min(side.stop * factor, count))
            for side, factor, count in zip(border.window, factors, tissue.shape, strict=True)
        )
        shape = tuple(side.stop - side.start for side in window)
        inside = border.share > 0.5
        share = _repeated(border.share, factors, shape)
        if factors != (1, 1, 1):
            near = _repeated(_bordering(inside).astype(np.float32), factors, shape)
            layers = max(1, VOXELS_PER_STEP // (shape[1] * shape[2]))
            for low in range(0, shape[0], layers):
                at = np.nonzero(near[low : low + layers])
                at = (at[0] + low, at[1], at[2])
                whole = tuple(index + side.start for index, side in zip(at, window, strict=True))
                if at[0].size:
                    share[at] = drawn_shares(border, whole, factors)
                    share[at] += VALUE * value_ratios(border, _mean_around(tissue, whole))
                yield Step((number + (low + layers) / shape[0]) / len(borders))
        taken = share > (0.5 if best is None else best[window])
        drawn[window][taken] = structure
        if best is not None:
            best[window][taken] = share[taken]
    if permitted is not None:
        drawn *= permitted
    return drawn


def _repeated(values: Floats, factors: Factors, shape: tuple[int, ...]) -> Floats:
    for axis, factor in enumerate(factors):
        if factor > 1:
            values = np.repeat(values, factor, axis=axis)
    return np.array(values[: shape[0], : shape[1], : shape[2]], order="C")


def _bordering(inside: Flags) -> Flags:
    """Return which blocks have both sides among themselves and the 26 around them."""
    least, most = inside, inside
    for axis in range(3):
        ends = [(0, 0)] * 3
        ends[axis] = (1, 1)
        count = inside.shape[axis]
        for_least, for_most = np.pad(least, ends, mode="edge"), np.pad(most, ends, mode="edge")
        index = [(slice(None),) * axis + (slice(step, step + count),) for step in range(3)]
        least = np.logical_and.reduce([for_least[part] for part in index])
        most = np.logical_or.reduce([for_most[part] for part in index])
    return least != most


def _mean_around(tissue: Floats, at: tuple[NDArray[np.intp], ...]) -> Floats:
    """Return the mean of the 27 voxels around each, where noise is smaller."""
    total = np.zeros(len(at[0]), np.float32)
    for step in np.ndindex(3, 3, 3):
        place = (
            np.clip(index + move - 1, 0, size - 1) for index, move, size in zip(at, step, tissue.shape, strict=True)
        )
        total += tissue[tuple(place)]
    return total / np.float32(27)
