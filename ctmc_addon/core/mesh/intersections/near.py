# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles that may meet some selected ones, from a coarse grid in which these are marked."""

from __future__ import annotations

import numpy as np

from ...arrays import Flags, Floats, Ints
from ...progress import PAUSE, Steps

CELLS = 128  # The grid has this many cells along each axis.


def near_faces_steps(columns: Floats, faces: Ints, selected: Flags) -> Steps[Flags]:
    """Return which triangles are near a selected one, (F,) bool: all whose box meets its box, and some more.

    Parameters
    ----------
    columns : (3, V) float32
        Positions.
    faces : (3, F) int32
    selected : (F,) bool
        Not very many.
    """
    low = columns.min(axis=1)
    extent = float((columns.max(axis=1).astype(np.float64) - low).max()) or 1.0
    yield PAUSE
    cells = (columns - low[:, None]) * np.float32(CELLS / extent)  # rising, so boxes that overlap share a cell
    cells = np.minimum(cells, CELLS - 1, out=cells).astype(np.uint8)
    yield PAUSE
    corners = np.take(cells, np.compress(selected, faces, axis=1), axis=1).astype(np.int64)  # (3, 3, selected)
    first, last = np.maximum(corners.min(axis=1) - 1, 0), corners.max(axis=1) + 2
    marked = np.zeros((CELLS,) * 3, bool)  # where they are, and a cell around
    for x, y, z, right, back, top in np.unique(np.concatenate([first, last]), axis=1).T.tolist():
        marked[x:right, y:back, z:top] = True
    x, y, z = cells.astype(np.int32)
    marked_vertices = np.take(marked.ravel(), (x * CELLS + y) * CELLS + z)
    yield PAUSE
    a, b, c = (np.take(marked_vertices, corner) for corner in faces)
    near = a | b | c
    yield PAUSE
    for along in cells:  # a triangle in three cells or more may pass through what is marked with no corner there
        a, b, c = (np.take(along, corner) for corner in faces)
        near |= np.maximum(np.maximum(a, b), c) - np.minimum(np.minimum(a, b), c) > 1
        yield PAUSE
    return near
