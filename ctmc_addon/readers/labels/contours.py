# SPDX-License-Identifier: GPL-3.0-or-later
"""Fill closed contours on pixels: even-odd rule, pixel centers, one scanline pass for all edges.

Positions are (column, row) in pixels, the center of the first pixel at (0, 0). A pixel whose center lies on a contour
is inside, so that a contour drawn through the outermost pixels of a mask gives that mask again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import Step, Steps

ON_CONTOUR = 1e-3  # Pixels; files have positions to about 0.001 mm.
CROSSINGS = 1 << 20  # This many crossings of edges with rows are done at once, in about 0.1 s.
FAR = 1e7  # Pixels; nothing farther away is drawn exactly.


class Filled(NamedTuple):
    """The pixels inside, within the box around them."""

    top: int  # First row.
    left: int  # First column.
    mask: NDArray[np.bool_]  # (rows, columns); empty where nothing lies in the picture


class _Traced(NamedTuple):
    """The pixels inside an odd number of contours, and those on one, within the box around them."""

    top: int  # First row.
    left: int  # First column.
    odd: NDArray[np.bool_]  # (rows, columns); empty where nothing lies in the picture
    on: NDArray[np.bool_]  # (rows, columns)

    @property
    def filled(self) -> Filled:
        """Return the pixels inside and on the contours."""
        return Filled(self.top, self.left, self.odd | self.on)


class Edges(NamedTuple):
    """The edges of contours and the picture rows that they touch; no rows where `last` is less than `first`."""

    start: NDArray[np.float64]  # (n, 2)
    end: NDArray[np.float64]  # (n, 2)
    first: NDArray[np.int64]  # (n,)
    last: NDArray[np.int64]  # (n,)

    def part(self, which: slice) -> Edges:
        """Return some of the edges."""
        return Edges(self.start[which], self.end[which], self.first[which], self.last[which])

    @property
    def crossings(self) -> NDArray[np.int64]:
        """Return the number of rows that each edge touches, a measure of the work."""
        return np.maximum(0, self.last - self.first + 1)


def edges_of(contours: Sequence[NDArray[np.float64]], rows: int) -> Edges:
    """Return the edges of contours, each joined to a ring.

    Parameters
    ----------
    contours : sequence of (n, 2) float64
        Column and row in pixels.
    rows : int
        Of the picture.
    """
    rings = [np.clip(corners, -FAR, FAR) for corners in contours]
    start = np.concatenate(rings) if rings else np.zeros((0, 2))
    end = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings]) if rings else np.zeros((0, 2))
    low, high = np.minimum(start[:, 1], end[:, 1]), np.maximum(start[:, 1], end[:, 1])
    first = np.maximum(np.ceil(low - ON_CONTOUR), 0).astype(np.int64)
    last = np.minimum(np.floor(high + ON_CONTOUR), rows - 1).astype(np.int64)
    return Edges(start, end, first, last)


def filled_steps(edges: Edges, columns: int) -> Steps[Filled]:
    """Return the pixels inside an odd number of contours, or on one.

    Parameters
    ----------
    edges : Edges
    columns : int
        Of the picture.

    Examples
    --------
    >>> from ctmc_addon.core import finish
    >>> square = np.array([[0.5, 0.5], [2.5, 0.5], [2.5, 2.5], [0.5, 2.5]])
    >>> finish(filled_steps(edges_of([square], 9), 9))
    Filled(top=1, left=0, mask=array([[False,  True,  True, False],
           [False,  True,  True, False]]))
    """
    return (yield from traced_steps(edges, columns)).filled


def traced_steps(edges: Edges, columns: int) -> Steps[_Traced]:
    """Do what `filled_steps` does, and keep the pixels on contours apart.

    Parameters
    ----------
    edges : Edges
    columns : int
        Of the picture.
    """
    count = edges.crossings
    x = edges.start[:, 0]
    if not count.any() or x.max() < -ON_CONTOUR or x.min() > columns - 1 + ON_CONTOUR:
        return _Traced(0, 0, np.zeros((0, 0), np.bool_), np.zeros((0, 0), np.bool_))
    touching = count > 0
    top, bottom = int(edges.first[touching].min()), int(edges.last[touching].max())
    left = int(np.clip(np.floor(x.min()), 0, columns - 1))
    right = int(np.clip(np.ceil(x.max()), 0, columns - 1))
    # Edges met from the left are odd inside; one column more takes those beyond the right.
    odd = np.zeros((bottom - top + 1, right - left + 2), np.bool_)
    on = np.zeros_like(odd)
    done, total = 0, np.cumsum(count)
    while done < len(count):
        before = int(total[done - 1]) if done else 0
        stop = max(done + 1, int(np.searchsorted(total, before + CROSSINGS, side="right")))
        cross(edges.part(slice(done, stop)), (top, left), odd, on)
        done = stop
        yield Step(done / len(count), "Filling contours")
    return _Traced(top, left, np.logical_xor.accumulate(odd, axis=1)[:, :-1], on[:, :-1])


def cross(edges: Edges, corner: tuple[int, int], odd: NDArray[np.bool_], on: NDArray[np.bool_]) -> None:
    """Mark where edges cross rows in `odd`, and the pixels that lie on them in `on`; both begin at `corner`."""
    width = odd.shape[1]
    count = edges.crossings
    number = np.repeat(np.arange(len(count)), count)  # of the edge, for each crossing
    row = np.arange(len(number)) - np.repeat(np.cumsum(count) - count, count) + edges.first[number]
    start, end = edges.start[number] - (corner[1], 0), edges.end[number] - (corner[1], 0)
    x0, y0, x1, y1 = start[:, 0], start[:, 1], end[:, 0], end[:, 1]
    height = y1 - y0
    level = np.abs(height) <= ON_CONTOUR
    share = np.divide(row - y0, height, out=np.zeros(len(row)), where=~level)
    x = x0 + np.clip(share, 0.0, 1.0) * (x1 - x0)
    base = (row - corner[0]) * width
    # An edge has its upper end and not its lower one: a corner between two edges counts once.
    crosses = (np.minimum(y0, y1) <= row) & (row < np.maximum(y0, y1))
    column = np.clip(np.ceil(x[crosses]), 0, width - 1).astype(np.int64)
    odd ^= (np.bincount(base[crosses] + column, minlength=odd.size) & 1).astype(np.bool_).reshape(odd.shape)
    near = np.where(level, np.minimum(x0, x1), x), np.where(level, np.maximum(x0, x1), x)
    first = np.clip(np.ceil(near[0] - ON_CONTOUR), 0, width - 1).astype(np.int64)
    last = np.clip(np.floor(near[1] + ON_CONTOUR), -1, width - 2).astype(np.int64)
    lies = first <= last
    runs = np.bincount(base[lies] + first[lies], minlength=odd.size)
    runs -= np.bincount(base[lies] + last[lies] + 1, minlength=odd.size)
    on |= np.cumsum(runs).astype(np.bool_).reshape(on.shape)
