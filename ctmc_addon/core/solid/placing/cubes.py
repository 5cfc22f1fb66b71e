# SPDX-License-Identifier: GPL-3.0-or-later
"""Cubes that are parted again and again, and what is found with them, such as the deepest place of a solid.

The depth changes by no more than the way between two points, so cubes that cannot hold what is looked for are dropped
early. Distances are in mm, positive inside; points are (3, n) float64, RAS+ mm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles, Indices
from ...progress import Steps
from ..fields.depth import Depth

FIRST_CUBES = 8  # Along the longest side of the box.
HALF_DIAGONAL = 0.8661
CLOSE = 2.0**-12  # Of the longest side of the box: depths are known to this, where few places are nearly as deep.
MOST_PARTED = 1024  # Part this many cubes at a time, the most promising ones.
EVERY = slice(None)
EIGHTHS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]).T  # (3, 8)


@dataclass(frozen=True)
class Cubes:
    """Cubes of one grid: from where it begins, their side, and their numbers along x, y and z, (3, n)."""

    origin: Doubles
    side: float
    at: Indices

    @classmethod
    def over(cls, low: Doubles, high: Doubles) -> Cubes:
        """Return the first cubes, which cover a box (3,) to (3,)."""
        spans = high - low
        side = float(spans.max()) / FIRST_CUBES
        counts = [max(1, math.ceil(span / side)) for span in spans.tolist()]
        origin = (low + high) / 2 - np.array(counts) * (side / 2)
        return cls(origin, side, np.stack([each.ravel() for each in np.indices(counts)]))

    def points(self, numbers: NDArray[np.intp] | slice = EVERY) -> Doubles:
        """Return the middles of cubes, (3, n)."""
        return self.origin[:, None] + (self.at[:, numbers] + 0.5) * self.side

    def kept(self, which: NDArray[np.intp]) -> Cubes:
        """Return some of them."""
        return Cubes(self.origin, self.side, self.at[:, which])

    def parted(self) -> Cubes:
        """Return eight cubes for each."""
        at = (2 * self.at[:, :, None] + EIGHTHS[:, None]).reshape(3, -1)
        return Cubes(self.origin, self.side / 2, at)


def deepest_steps(depth: Depth, low: Doubles, high: Doubles) -> Steps[tuple[Doubles, float]]:
    """Return the deepest point in a box (3,) to (3,), as (3,), and its depth: the first of equals.

    The depth is right to `CLOSE` of the longest side of the box, and never too large.
    """
    cubes, close = Cubes.over(low, high), CLOSE * float((high - low).max())
    best, deepest = (low + high) / 2, -math.inf
    while True:
        points = cubes.points()
        here = yield from depth(points)
        top = int(here.argmax())
        if here[top] > deepest:
            best, deepest = points[:, top].copy(), float(here[top])
        near = np.flatnonzero(here + HALF_DIAGONAL * cubes.side > deepest + close)
        if not len(near):
            return best, deepest
        order = np.argsort(-here[near], kind="stable")[:MOST_PARTED]
        cubes = cubes.kept(np.sort(near[order])).parted()
