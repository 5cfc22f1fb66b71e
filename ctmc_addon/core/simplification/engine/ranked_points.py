# SPDX-License-Identifier: GPL-3.0-or-later
"""The nearest of many points among those of a higher rank."""

from __future__ import annotations

import numpy as np

from ...arrays import Flags, Floats, Ints
from ...mesh.distance.triangle_tree import CODE_BITS, morton_codes
from ...mesh.vectors import dot
from ...progress import PAUSE, Steps

BRANCH = 4  # A box has this many children.
CURVE_NEIGHBORS = 12  # Bound a distance first by this many points on either side along the curve.


class RankedPoints:
    """A tree of boxes over points of ranked components: which is the nearest of a higher rank; see `TriangleTree`."""

    def prepare_steps(self, points: Floats, component: Ints, rank: Ints) -> Steps[None]:
        """Take in points (3, n), the component of each and the rank of every component."""
        low = points.min(axis=1)
        extent = float((points - low[:, None]).max())
        self._low, self._cells_per_unit = low, (2**CODE_BITS - 1) / (extent or 1.0)
        codes = morton_codes(points.T, low, self._cells_per_unit)
        order = np.argsort(codes, kind="stable")
        self._codes = codes[order]
        yield PAUSE
        self.component = component[order]
        low = high = np.take(points, order, axis=1)
        self.boxes, self.ranks = [(low, high)], [rank[self.component]]
        while low.shape[1] > 1:
            starts = np.arange(0, low.shape[1], BRANCH)
            low, high = np.minimum.reduceat(low, starts, axis=1), np.maximum.reduceat(high, starts, axis=1)
            self.boxes.append((low, high))
        yield PAUSE
        self._raise_ranks()

    def keep(self, present: Flags) -> None:
        """Keep the points of components that are still present, (components,) bool."""
        self.ranks[0] = np.where(present[self.component], self.ranks[0], np.int32(-1))
        self._raise_ranks()

    def _raise_ranks(self) -> None:
        """Give every box the highest rank in it."""
        del self.ranks[1:]
        while len(self.ranks) < len(self.boxes):
            below = self.ranks[-1]
            self.ranks.append(np.maximum.reduceat(below, np.arange(0, len(below), BRANCH)))

    def nearest(self, points: Floats, ranks: Ints) -> tuple[Floats, Ints]:
        """Distance from every point (3, n) to the nearest of a rank above its own, (n,), and the component of that."""
        best = self._bounds(points, ranks)  # no farther than this, squared
        point, box = np.arange(points.shape[1]), np.zeros(points.shape[1], np.int64)
        squared = best
        for level in range(len(self.boxes) - 1, -1, -1):
            low, high = self.boxes[level]
            if level < len(self.boxes) - 1:
                point = np.repeat(point, BRANCH)
                box = (box[:, None] * BRANCH + np.arange(BRANCH)).ravel()
                exists = box < low.shape[1]
                point, box = point[exists], box[exists]
            higher = self.ranks[level][box] > ranks[point]
            point, box = point[higher], box[higher]
            position = np.take(points, point, axis=1)
            below, above = np.take(low, box, axis=1) - position, position - np.take(high, box, axis=1)
            outside = np.maximum(np.maximum(below, above), np.float32(0))
            farthest = np.minimum(below, above)
            starts = np.flatnonzero(np.diff(point, prepend=-1))
            owner = point[starts]
            best[owner] = np.minimum(best[owner], np.minimum.reduceat(dot(farthest, farthest), starts))
            squared = dot(outside, outside)
            near = squared <= best[point]
            point, box, squared = point[near], box[near], squared[near]
        first = np.flatnonzero(np.diff(point, prepend=-1))  # the first of equal points
        return np.sqrt(squared[first]), self.component[box[first]]

    def _bounds(self, points: Floats, ranks: Ints) -> Floats:
        """Squared distance to the nearest of those of a higher rank that the curve passes just before or after."""
        at = np.searchsorted(self._codes, morton_codes(points.T, self._low, self._cells_per_unit))
        best = np.full(points.shape[1], np.inf, np.float32)
        for offset in range(-CURVE_NEIGHBORS, CURVE_NEIGHBORS):
            neighbor = np.clip(at + offset, 0, len(self._codes) - 1)
            along = np.take(self.boxes[0][0], neighbor, axis=1) - points
            higher = np.take(self.ranks[0], neighbor) > ranks
            np.minimum(best, dot(along, along), out=best, where=higher)
        return best
