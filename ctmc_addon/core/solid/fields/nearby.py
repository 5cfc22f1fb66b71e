# SPDX-License-Identifier: GPL-3.0-or-later
"""Find samples that are certainly within a distance of flagged samples; 64 samples along x are one word.

Each row of samples is spread along x once for every reach, and the rows around it copy the result: a ball of rows.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags
from ...machine.budget import Budget
from ...machine.parallel import map_steps, parts_of
from ...progress import Steps, equal_part
from .lattice import Lattice

Words = NDArray[np.uint64]
WORD = np.dtype("<u8")
MOST_REACH = 8  # Spread by at most this many of the shortest steps at once.
WORDS_AT_ONCE = 1 << 17
ROUNDED = 1 - 2.0**-16


def nearby_steps(flags: Words, lattice: Lattice, distance: float, budget: Budget | None = None) -> Steps[Words]:
    """Return whether each sample has a flagged one within a distance.

    Long distances are covered by several short ones, which leaves out samples that are only just within.

    Parameters
    ----------
    flags : (z, y, words) uint64
        From `packed`.
    lattice : Lattice
    distance : float
        mm.
    budget : Budget, optional

    Returns
    -------
    (z, y, words) uint64
    """
    count = max(1, math.ceil(distance / (MOST_REACH * min(lattice.sides_mm))))
    rows = _rows(lattice, distance / count * ROUNDED)
    for number in range(count):
        flags = yield from equal_part(_spread_steps(flags, rows, budget), number, count)
    return flags


def words_of(width: int) -> int:
    """Return the number of words in a row of samples."""
    return -(-width // 64)


def packed(flags: Flags) -> Words:
    """Return flags (z, y, x) as words of 64 along x, (z, y, words) uint64."""
    depth, height, width = flags.shape
    out = np.zeros((depth, height, 8 * words_of(width)), np.uint8)
    out[:, :, : -(-width // 8)] = np.packbits(flags, axis=2, bitorder="little")
    return out.view(WORD)


def unpacked(words: Words, width: int) -> Flags:
    """Return the flags of words, (z, y, width)."""
    return np.unpackbits(words.view(np.uint8), axis=2, count=width, bitorder="little").view(bool)


def _rows(lattice: Lattice, distance: float) -> dict[int, list[tuple[int, int]]]:
    """Return the row offsets (z, y) within a distance, by the number of samples that they reach along x."""
    # Oblique axes and shorter steps change lengths, so take the longest.
    steps = np.array([np.diff(along).max() for along in (lattice.x, lattice.y, lattice.z)])
    axes = lattice.affine[:3, :3] * steps
    products = np.abs((axes[:, :, None] * axes[:, None, :]).sum(axis=0))
    most = math.ceil(distance / min(lattice.sides_mm))
    x = np.arange(64.0)
    rows: dict[int, list[tuple[int, int]]] = {}
    for z in range(-most, most + 1):
        for y in range(-most, most + 1):
            sample = (x, float(abs(y)), float(abs(z)))
            squared = sum(products[a, b] * sample[a] * sample[b] for a in range(3) for b in range(3))
            reach = int(np.count_nonzero(np.sqrt(squared) <= distance)) - 1
            if reach >= 0:
                rows.setdefault(reach, []).append((z, y))
    return rows


def _spread_steps(flags: Words, rows: dict[int, list[tuple[int, int]]], budget: Budget | None) -> Steps[Words]:
    """Flag the samples of all rows around flagged samples."""
    depth, height, words = flags.shape
    out = np.zeros(flags.shape, WORD)
    beyond = max(z for around in rows.values() for z, _ in around)

    def spread(part: slice) -> None:
        first, end = max(0, part.start - beyond), min(depth, part.stop + beyond)
        here = flags[first:end]
        along, reached = here.copy(), 0
        for reach, around in sorted(rows.items()):
            for shift in range(reached + 1, reach + 1):
                _shift_into(along, here, np.uint64(shift))
            reached = reach
            for z, y in around:
                low, high = max(part.start, first - z), min(part.stop, end - z)  # Neighbors exist.
                below, above = max(0, -y), height - max(0, y)
                if low < high and below < above:
                    neighbors = along[low + z - first : high + z - first, below + y : above + y]
                    target = out[low:high, below:above]
                    np.bitwise_or(target, neighbors, out=target)

    parts = parts_of(depth, max(1, WORDS_AT_ONCE // (height * words)))
    yield from map_steps(spread, parts, (budget or Budget()).thread_count, "", len(parts))
    return out


def _shift_into(out: Words, words: Words, shift: np.uint64) -> None:
    """Flag the samples that are `shift` samples before or after flagged ones along x."""
    back = np.uint64(64) - shift
    out |= words << shift
    out |= words >> shift
    out[:, :, 1:] |= words[:, :, :-1] >> back
    out[:, :, :-1] |= words[:, :, 1:] << back
