# SPDX-License-Identifier: GPL-3.0-or-later
"""Mark cubes near the triangles of a tree, so that points far from all triangles are found at once.

A cube is near if it or a neighbor holds a part of a triangle's box; all other cubes are farther away than their side.
Positions are RAS+ mm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles, Flags
from ...mesh.distance.triangle_tree import TriangleTree
from ...mesh.topology import FACES_PER_STEP
from ...progress import PAUSE, Steps

MOST_CUBES = 512  # The longest side of the box has at most this many cubes.


@dataclass(frozen=True, eq=False)
class NearCells:
    """A grid of cubes.

    Parameters
    ----------
    low : (3,) float64
        Lowest corner.
    side : float
        Side of a cube, mm: points in cubes that are not near are farther than this from all triangles.
    near : (x, y, z) bool
    """

    low: Doubles
    side: float
    near: Flags

    def of(self, points: Doubles) -> NDArray[np.intp]:
        """Return the indices of points (3, n) that lie in near cubes."""
        at = np.floor((points - self.low[:, None]) / self.side)
        sizes = np.array(self.near.shape)[:, None]
        within = np.flatnonzero(((at >= 0) & (at < sizes)).all(axis=0))
        x, y, z = at[:, within].astype(np.intp)
        return within[self.near[x, y, z]]


def near_cells_steps(tree: TriangleTree, distance: float) -> Steps[NearCells]:
    """Return the cubes that hold every point within a distance, mm, of the triangles."""
    corners = tree.corners
    low, high = corners.min(axis=(0, 2)), corners.max(axis=(0, 2))
    side = max(distance, float((high - low).max()) / MOST_CUBES) * (1 + 2.0**-20)
    low = low - 1.5 * side  # One cube free on every side.
    shape = [math.floor(span / side) + 3 for span in (high - low).tolist()]
    near = np.zeros(shape, np.bool_)
    for start in range(0, corners.shape[2], FACES_PER_STEP):
        block = corners[:, :, start : start + FACES_PER_STEP]
        first, last = (
            ((each - low[:, None]) / side).astype(np.intp) for each in (block.min(axis=0), block.max(axis=0))
        )
        few = ((last - first) <= 1).all(axis=0)
        for number in range(8):
            x, y, z = (np.where(number >> axis & 1, last[axis, few], first[axis, few]) for axis in range(3))
            near[x, y, z] = True
        for number in np.flatnonzero(~few).tolist():
            ranges = (slice(first[axis, number], last[axis, number] + 1) for axis in range(3))
            near[tuple(ranges)] = True
        yield PAUSE
    for axis in range(3):
        along = np.moveaxis(near, axis, 0)
        before = along.copy()
        along[1:] |= before[:-1]
        along[:-1] |= before[1:]
        yield PAUSE
    return NearCells(low, side, near)
