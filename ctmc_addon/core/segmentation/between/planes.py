# SPDX-License-Identifier: GPL-3.0-or-later
"""The body between two parallel planes: signed distances to its contours in each, interpolated linearly.

Raya and Udupa 1990, doi:10.1109/42.52980. `between_slices` does so with cubics and smooths the body, and needs planes
that are slices; here a plane lies anywhere and has contours, which are finer than samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...arrays import Doubles, Flags
from ...progress import PAUSE, Steps
from ..distance import squared_distances

ON_SURFACE = 1e-3  # A sample this near to the body, in sides of a sample, is inside.
FIRST_LIMIT = 8  # Distances are measured this far first, in sides of a sample, then twice as far until all are found.
TILE = 32  # Samples of this many rows and columns are compared with the edges around them.
PAIRS = 1 << 17  # Samples and edges that are compared at once; their distances stay in the processor's cache.


class Outline(NamedTuple):
    """A body in a plane.

    Parameters
    ----------
    mask : (rows, columns) bool
        Its samples, with a margin of one without.
    start, end : (n, 2) float64
        Edges of its contours, column and row in samples; some may lie within the body.
    """

    mask: Flags
    start: Doubles
    end: Doubles


@dataclass(frozen=True, eq=False)
class _BetweenPlanes:
    """The body between two planes.

    Samples inside both planes are inside, those outside both are outside: distances decide only the others.

    Parameters
    ----------
    both, differing : (rows, columns) bool
        Samples that are inside of both planes, and inside of one.
    below, above : (n,) float64
        Signed distances of those that differ to the contours of each plane, + inside.
    least : float
        Distance from which on a sample is inside.
    """

    both: Flags
    differing: Flags
    below: Doubles
    above: Doubles
    least: float

    def at(self, share: float) -> Flags:
        """Return the body of a slice, (rows, columns) bool.

        Parameters
        ----------
        share : float
            The slice's way from the plane below to the one above: 0 to 1.
        """
        body = self.both.copy()
        body[self.differing] = (1 - share) * self.below + share * self.above >= self.least
        return body


def between_planes_steps(below: Outline, above: Outline, sides_mm: tuple[float, float]) -> Steps[_BetweenPlanes]:
    """Measure the body between two planes.

    Parameters
    ----------
    below, above : Outline
        Outlines of one shape.
    sides_mm : (rows, columns) float
        Distances between samples.

    Examples
    --------
    >>> from ctmc_addon.core import finish
    >>> def interval(low, high):
    ...     mask = np.array([[False] * 12, [low < at < high for at in range(12)], [False] * 12])
    ...     corners = np.array([[low, 0.5], [high, 0.5], [high, 1.5], [low, 1.5]])
    ...     return Outline(mask, corners, np.roll(corners, -1, axis=0))
    >>> between = finish(between_planes_steps(interval(0.5, 2.5), interval(0.5, 8.5), (9.0, 1.0)))
    >>> [between.at(share).sum().item() for share in (0.0, 0.25, 0.5, 1.0)]
    [2, 3, 5, 8]
    """
    differing = below.mask ^ above.mask
    below_mm = yield from _signed_mm_steps(below, differing, sides_mm)
    above_mm = yield from _signed_mm_steps(above, differing, sides_mm)
    return _BetweenPlanes(below.mask & above.mask, differing, below_mm, above_mm, -ON_SURFACE * min(sides_mm))


def _signed_mm_steps(outline: Outline, selected: Flags, sides_mm: tuple[float, float]) -> Steps[Doubles]:
    """Return the distances of some samples to the surface, (n,), + inside.

    The surface passes between a sample and the nearest one on its other side, so it is no farther than that one.
    """
    inside = outline.mask[selected]
    if not inside.size:
        return np.zeros(0)
    most_mm = np.empty(inside.size)
    for side, mask in ((inside, ~outline.mask), (~inside, outline.mask)):
        most_mm[side] = _to_samples_mm(mask, selected & ~mask, sides_mm)
    mm = yield from _to_edges_steps(outline, selected, most_mm, sides_mm)
    return np.where(inside, mm, -mm)


def _to_samples_mm(mask: Flags, selected: Flags, sides_mm: tuple[float, float]) -> Doubles:
    """Return the distances from some samples to the nearest of a mask, (n,); infinite where it has none."""
    rows_mm, columns_mm = sides_mm
    limit_mm = FIRST_LIMIT * max(sides_mm)
    while True:
        squares = squared_distances(mask[None], (columns_mm, rows_mm, 1.0), limit_mm)[0][selected]
        if not mask.any() or float(squares.max(initial=0.0)) <= limit_mm * limit_mm:
            return np.sqrt(squares.astype(np.float64))
        limit_mm *= 2


def _to_edges_steps(
    outline: Outline, selected: Flags, most_mm: Doubles, sides_mm: tuple[float, float]
) -> Steps[Doubles]:
    """Return the distances from some samples to the nearest edge on the surface, (n,), `most_mm` where none is nearer.

    Edges of a keyhole and of united contours lie in part within the body. A point of an edge is on the surface if
    samples around it lie on both sides.
    """
    rows, columns = np.nonzero(selected)
    scale = np.array(sides_mm[::-1])
    low, high = np.minimum(outline.start, outline.end) * scale, np.maximum(outline.start, outline.end) * scale
    surface = _on_surface(outline.mask)
    at_mm = np.stack([columns, rows], axis=1) * scale
    nearest_mm = most_mm.copy()
    tile = rows // TILE * selected.shape[1] + columns // TILE
    order = np.argsort(tile, kind="stable")
    for samples in np.split(order, np.flatnonzero(np.diff(tile[order])) + 1):
        reach = float(most_mm[samples].max()) * (1 + 1e-6)
        near = (high >= at_mm[samples].min(axis=0) - reach) & (low <= at_mm[samples].max(axis=0) + reach)
        edges = np.flatnonzero(near.all(axis=1))
        for first in range(0, len(edges), PAIRS // (TILE * TILE)):
            part = edges[first : first + PAIRS // (TILE * TILE)]
            own = _distances_mm(at_mm[samples], outline.start[part], outline.end[part], surface, sides_mm)
            nearest_mm[samples] = np.minimum(nearest_mm[samples], own)
            yield PAUSE
    return nearest_mm


def _distances_mm(
    at_mm: Doubles, start: Doubles, end: Doubles, surface: Flags, sides_mm: tuple[float, float]
) -> Doubles:
    """Return the distance from each sample, (n,), to the nearest edge whose nearest point is on the surface."""
    rows_mm, columns_mm = sides_mm
    along_x, along_y = end[:, 0] - start[:, 0], end[:, 1] - start[:, 1]
    mm_x, mm_y = along_x * columns_mm, along_y * rows_mm
    length = mm_x * mm_x + mm_y * mm_y
    from_x = at_mm[:, :1] - start[:, 0] * columns_mm  # (samples, edges)
    from_y = at_mm[:, 1:] - start[:, 1] * rows_mm
    share = from_x * mm_x + from_y * mm_y
    np.divide(share, length, out=share, where=length > 0)
    np.clip(share, 0.0, 1.0, out=share)
    from_x -= share * mm_x
    from_y -= share * mm_y
    squares = from_x * from_x + from_y * from_y
    row = np.rint(2 * np.clip(start[:, 1] + share * along_y, 0, (surface.shape[0] - 1) / 2)).astype(np.intp)
    column = np.rint(2 * np.clip(start[:, 0] + share * along_x, 0, (surface.shape[1] - 1) / 2)).astype(np.intp)
    nearest: Doubles = np.where(surface[row, column], squares, np.inf).min(axis=1)
    return np.sqrt(nearest)


def _on_surface(mask: Flags) -> Flags:
    """Return where samples lie on both sides, at every half row and column, (2 rows - 1, 2 columns - 1).

    Looked at are the samples beside a half, and those on a whole row with both neighbors. Everywhere where the mask is
    empty: then all contours pass between samples.
    """
    if not mask.any():
        return np.ones((2 * mask.shape[0] - 1, 2 * mask.shape[1] - 1), bool)
    both = []
    for side in (mask, ~mask):
        for axis in (0, 1):
            rows = np.moveaxis(side, axis, 0)
            halves = np.zeros((2 * len(rows) - 1, rows.shape[1]), bool)
            halves[1::2] = rows[:-1] | rows[1:]
            halves[::2] = rows
            halves[2::2] |= halves[1::2]
            halves[:-1:2] |= halves[1::2]
            side = np.moveaxis(halves, 0, axis)
        both.append(side)
    return both[0] & both[1]
