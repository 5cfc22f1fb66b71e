# SPDX-License-Identifier: GPL-3.0-or-later
"""Pairs of boxes that overlap, from a tree of boxes that is compared with itself.

Box b of a level holds boxes 4 b to 4 b + 3 of the level below. Pairs go down the tree in blocks that stay in the cache.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags, Floats, Ints

SHIFT = 2
BRANCH = 1 << SHIFT  # A box has this many children.
BLOCK = 1 << 15  # Compare this many pairs at once.
_FORWARD = np.arange(BRANCH)[:, None] <= np.arange(BRANCH)  # A box and itself give every pair of children once.


class BoxTree:
    """Boxes in an order in which neighbors in space are near each other.

    Parameters
    ----------
    low, high : (3, n) float32
        Without the empty box, whose low is above its high.
    selected : (n,) bool, optional
        Only pairs with at least one of these are looked for.
    """

    def __init__(self, low: Floats, high: Floats, selected: Flags | None = None) -> None:
        self.count = low.shape[1]
        self._levels: list[tuple[Floats, Floats, Flags | None]] = []  # (3, 4, boxes / 4) twice, (4, boxes / 4)
        while low.shape[1] > 1 or not self._levels:
            fours = _fours(low, np.inf), _fours(high, -np.inf)
            fours_selected = None if selected is None else _fours(selected[None], False)[0]
            self._levels.append((*fours, fours_selected))
            low, high = fours[0].min(axis=1), fours[1].max(axis=1)
            selected = None if fours_selected is None else fours_selected.any(axis=0)

    def pairs(self) -> Generator[tuple[Ints, Ints], None, None]:
        """Yield blocks of pairs of overlapping boxes, (n,) and (n,) int32, every pair once, the lower number first."""
        zero = np.zeros(1, np.int32)
        stack = [(len(self._levels) - 1, zero, zero)]
        while stack:
            height, first, second = stack.pop()
            if len(first) > BLOCK:
                stack.append((height, first[BLOCK:], second[BLOCK:]))
                first, second = first[:BLOCK], second[:BLOCK]
            first, second = self._children(height, first, second)
            if height:
                stack.append((height - 1, first, second))
                continue
            differ = first != second
            yield first[differ], second[differ]

    def _children(self, height: int, first: Ints, second: Ints) -> tuple[Ints, Ints]:
        """Pairs of overlapping boxes of the level in these pairs of boxes of the level above."""
        low, high, selected = self._levels[height]
        near = np.ones((BRANCH, BRANCH, len(first)), bool)
        for lows, highs in zip(low, high, strict=True):
            near &= np.take(lows, first, axis=1)[:, None] <= np.take(highs, second, axis=1)
            near &= np.take(lows, second, axis=1) <= np.take(highs, first, axis=1)[:, None]
        if selected is not None:
            near &= np.take(selected, first, axis=1)[:, None] | np.take(selected, second, axis=1)
        itself = np.flatnonzero(first == second)
        near[:, :, itself] &= _FORWARD[:, :, None]
        flat = np.flatnonzero(_by_column(near.reshape(2, 8, -1))).astype(np.int32)
        pair = flat >> 2 * SHIFT
        of_first, of_second = flat >> SHIFT & BRANCH - 1, flat & BRANCH - 1
        return (np.take(first, pair) << SHIFT) + of_first, (np.take(second, pair) << SHIFT) + of_second


def _by_column(flags: Flags) -> Flags:
    """Flags (2, 8, n), one column of 16 after the other, (16 n,): by way of their bits several times faster."""
    bits = flags.view(np.uint8)
    words = np.empty((flags.shape[2], 2), np.uint8)
    for half in (0, 1):
        word = bits[half, 7].copy()
        for row in bits[half, 6::-1]:
            word <<= 1
            word |= row
        words[:, half] = word
    return np.unpackbits(words.ravel(), bitorder="little").view(bool)


def _fours(rows: NDArray[Any], fill: float) -> NDArray[Any]:
    """Return the columns of (k, n) rows four by four, (k, 4, n / 4)."""
    parents = -(-rows.shape[1] // BRANCH)
    padded = np.full((len(rows), parents * BRANCH), fill, rows.dtype)
    padded[:, : rows.shape[1]] = rows
    return np.ascontiguousarray(padded.reshape(len(rows), parents, BRANCH).transpose(0, 2, 1))
