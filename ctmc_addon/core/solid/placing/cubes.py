# SPDX-License-Identifier: GPL-3.0-or-later
"""Search a box with cubes that are divided repeatedly, for example for the deepest point of a solid.

Between two points the depth changes by no more than they are apart, so cubes that cannot hold the result are dropped
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

FIRST_CUBES = 8  # Begin with this many cubes along the longest side of the box.
HALF_DIAGONAL = 0.8661
CLOSE = 2.0**-12  # Depths are exact to this share of the longest side, unless many points are nearly as deep.
MOST_PARTED = 1024  # Divide at most this many cubes at a time, those with the greatest depth.
EVERY = slice(None)
EIGHTHS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]).T  # Shape (3, 8).


@dataclass(frozen=True)
class Cubes:
    """Cubes of one grid: its origin, their side, and their indices along x, y and z, (3, n)."""

    origin: Doubles
    side: float
    at: Indices

    @classmethod
    def over(cls, low: Doubles, high: Doubles) -> Cubes:
        """Return the first cubes, which cover a box given by its lowest and highest corner, (3,) each."""
        spans = high - low
        side = float(spans.max()) / FIRST_CUBES
        counts = [max(1, math.ceil(span / side)) for span in spans.tolist()]
        origin = (low + high) / 2 - np.array(counts) * (side / 2)
        return cls(origin, side, np.stack([each.ravel() for each in np.indices(counts)]))

    def points(self, numbers: NDArray[np.intp] | slice = EVERY) -> Doubles:
        """Return the middles of cubes, (3, n)."""
        return self.origin[:, None] + (self.at[:, numbers] + 0.5) * self.side

    def kept(self, which: NDArray[np.intp]) -> Cubes:
        """Return a selection of the cubes."""
        return Cubes(self.origin, self.side, self.at[:, which])

    def parted(self) -> Cubes:
        """Divide each cube into eight."""
        at = (2 * self.at[:, :, None] + EIGHTHS[:, None]).reshape(3, -1)
        return Cubes(self.origin, self.side / 2, at)


def deepest_steps(depth: Depth, low: Doubles, high: Doubles) -> Steps[tuple[Doubles, float]]:
    """Return the deepest point in a box, (3,), and its depth; the first of equals.

    The depth is never too large, and exact to `CLOSE` of the longest side of the box.
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
