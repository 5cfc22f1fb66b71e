# SPDX-License-Identifier: GPL-3.0-or-later
"""Boxes that may overlap some selected ones, from a coarse grid in which these are marked."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]

CELLS = 64  # of the grid, along each axis


def near_boxes(low: Floats, high: Floats, selected: Flags) -> Flags:
    """Which boxes are in a cell that a selected one is in, (n,) bool: all that overlap one, and some more.

    Parameters
    ----------
    low, high : (3, n) float32
    selected : (n,) bool
        Not very many.
    """
    lowest = low.min(axis=1)
    cell = float((high.max(axis=1).astype(np.float64) - lowest).max()) / CELLS or 1.0
    ends = [((side - lowest[:, None]) * np.float32(1 / cell)).astype(np.int32) for side in (low, high)]
    first, last = (np.clip(end, 0, CELLS - 1) for end in ends)  # rising, so boxes that overlap share a cell
    marked = np.zeros((CELLS, CELLS, CELLS), bool)
    for x, y, z, right, back, top in np.unique(np.concatenate([first, last])[:, selected], axis=1).T.tolist():
        marked[x : right + 1, y : back + 1, z : top + 1] = True
    # How many cells are marked up to each corner of the grid: eight of them give how many are in a box.
    below = np.zeros((CELLS + 1,) * 3, np.int32)
    below[1:, 1:, 1:] = (
        marked.cumsum(axis=0, dtype=np.int32).cumsum(axis=1, dtype=np.int32).cumsum(axis=2, dtype=np.int32)
    )
    flat = below.ravel()
    step = np.array([(CELLS + 1) ** 2, CELLS + 1, 1], np.int32)[:, None]
    first, last = first * step, (last + 1) * step
    count = np.zeros(low.shape[1], np.int32)
    for corner in range(8):
        x, y, z = ((last if corner >> axis & 1 else first)[axis] for axis in range(3))
        number = np.take(flat, x + y + z)
        count += number if corner.bit_count() % 2 else -number
    return count > 0
