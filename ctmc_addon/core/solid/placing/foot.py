# SPDX-License-Identifier: GPL-3.0-or-later
"""A flat foot below a part: a prism as wide as the shadow of all that lies within the foot's height, and some more.

The shadow is the sum of squares whose column from the lowest point up to the foot's height meets the part. Squares at
its outline are parted to `SIDE_MM` and cut where the greatest depth of their corners' columns, taken as linear between
them, is 0: the outline is right to `SIDE_MM` squared over eight times its radius, and to half of `SIDE_MM` at sharp
corners, half of `STEP_MM` at sharp rims between the lowest point and the foot's height. From there the distance is
exact.

Distances are in mm, positive inside; points are (3, n) float64, RAS+ mm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles, Indices
from ...errors import MeshError
from ...mesh.distance.triangle_tree import BLOCK, TriangleTree
from ...mesh.triangle_mesh import TriangleMesh
from ...progress import PAUSE, Steps
from ..fields.depth import Depth
from ..fields.shapes import Box, Plane
from .cubes import lowest_steps

SIDE_MM = 0.2  # Of the squares at the outline.
STEP_MM = 0.4  # Of the samples in a column, at least.
MOST_SQUARES = 60000  # Do not part more.
FIRST_SQUARES = 16  # Along the longer side of the box.
HALF_DIAGONAL = 0.7072
POINTS_AT_ONCE = 1 << 18
FAR_MM = 3.0  # Farther points outside count as this far away, which saves time.
MOST_CELLS = 256  # Along the longer side of the table of distances from the shadow.
CORNERS = np.array([[0, 0, 1, 1], [0, 1, 0, 1]])  # of a square, (2, 4)
HALVES = np.array([[0, 2, 3], [0, 3, 1]])  # Its triangles, counter-clockwise.


@dataclass(frozen=True, eq=False)
class Table:
    """Distances from the shadow at the middles of square cells, which bound those of all points.

    Parameters
    ----------
    low : (2,) float64
        Where it begins.
    side : float
        Of a cell, mm.
    distances : (x, y) float64
    """

    low: Doubles
    side: float
    distances: Doubles

    def bounds(self, at: Doubles) -> tuple[Doubles, Doubles]:
        """Return the least and the greatest distance that points (2, n) can have; beyond the table inf for both."""
        cells = np.floor((at - self.low[:, None]) / self.side)
        within = ((cells >= 0) & (cells < np.array(self.distances.shape)[:, None])).all(axis=0)
        x, y = np.where(within, cells, 0).astype(np.intp)
        here = np.where(within, self.distances[x, y], np.inf)
        reach = HALF_DIAGONAL * self.side
        return here - reach, here + reach


@dataclass(frozen=True)
class Foot:
    """A vertical prism with a round outline.

    Parameters
    ----------
    shadow : TriangleTree
        Triangles at z = 0 whose union is the shadow.
    low, high : float
        From where to where it goes along z.
    grown : float
        By how much it is wider than the shadow, all around.
    table : Table
        Of distances from the shadow.
    """

    shadow: TriangleTree
    low: float
    high: float
    grown: float
    table: Table

    @property
    def box(self) -> Box:
        """Box that holds it."""
        corners = self.shadow.corners.reshape(3, 3, -1)  # corner, axis, triangle
        low, high = corners.min(axis=(0, 2)) - self.grown, corners.max(axis=(0, 2)) + self.grown
        low[2], high[2] = self.low, self.high
        return low, high

    @property
    def planes(self) -> tuple[Plane, ...]:
        """Its lower and its upper side."""
        return ((0.0, 0.0, 1.0), self.low), ((0.0, 0.0, -1.0), -self.high)

    def at(self, points: Doubles) -> Doubles:
        """Return the distance near the surface; a lower bound of it far inside, beside edges and far away."""
        out = np.minimum(points[2] - self.low, self.high - points[2])
        near = np.flatnonzero(out > -FAR_MM)
        least, greatest = self.table.bounds(points[:2, near])
        # Where the shadow is surely near enough, the planes are nearer than the outline.
        far = self.grown - least < -FAR_MM
        out[near[far]] = -FAR_MM
        asked = near[~far & (self.grown - greatest < out[near])]
        flat = np.zeros((3, len(asked)))
        flat[:2] = points[:2, asked]
        for start in range(0, len(asked), BLOCK):
            block = np.ascontiguousarray(flat[:, start : start + BLOCK])
            squared, _ = self.shadow.nearest(block, np.full(block.shape[1], np.inf))
            numbers = asked[start : start + BLOCK]
            out[numbers] = np.minimum(out[numbers], self.grown - np.sqrt(squared))
        return out


def foot_steps(depth: Depth, low: Doubles, high: Doubles, base: float) -> Steps[Foot]:
    """Make the foot of a part.

    Parameters
    ----------
    depth : Depth
        Below the surface of the part.
    low, high : (3,) float64
        Corners of a box around it, RAS+ mm.
    base : float
        Height of the foot, and by how much it is wider than the part there, mm.

    Raises
    ------
    MeshError
        If there is nothing in the box.
    """
    lowest = yield from lowest_steps(depth, low, high)
    if math.isinf(lowest):
        raise MeshError("a part without material has no foot; leave out --base")
    columns = _Columns(depth, lowest, lowest + base)
    squares, corners = yield from _shadow_steps(columns, low, high)
    triangles = np.concatenate([squares, corners], axis=2)
    if not triangles.shape[2]:
        raise MeshError(f"the lowest {base:g} mm of a part are thinner than {SIDE_MM:g} mm; give a higher --base")
    tree = TriangleTree()
    yield from tree.prepare_steps(_flat_mesh(triangles))
    return Foot(tree, lowest, lowest + base, base, (yield from _table_steps(tree, base + FAR_MM)))


def _table_steps(shadow: TriangleTree, beyond: float) -> Steps[Table]:
    """Return a table of distances from the shadow up to `beyond` mm away."""
    corners = shadow.corners[:, :2]
    low, high = corners.min(axis=(0, 2)) - beyond, corners.max(axis=(0, 2)) + beyond
    side = float((high - low).max()) / MOST_CELLS
    counts = [math.ceil(span / side) for span in (high - low).tolist()]
    at = low[:, None] + (np.stack([each.ravel() for each in np.indices(counts)]) + 0.5) * side
    distances = yield from shadow.distances_steps(np.stack([*at, np.zeros(at.shape[1])], axis=1))
    return Table(low, side, distances.reshape(counts))


@dataclass(frozen=True)
class _Columns:
    """Vertical columns of a part."""

    depth: Depth
    low: float
    high: float

    def deepest_steps(self, at: Doubles, step: float) -> Steps[Doubles]:
        """Return the greatest depth of samples at most `step` mm apart in columns at (2, n), (n,)."""
        count = max(1, math.ceil((self.high - self.low) / step))
        deepest = np.full(at.shape[1], -np.inf)
        for number in range(count + 1):
            height = self.low + (self.high - self.low) * number / count
            for start in range(0, at.shape[1], POINTS_AT_ONCE):
                block = slice(start, start + POINTS_AT_ONCE)
                points = np.stack([*at[:, block], np.full(at[0, block].shape, height)])
                deepest[block] = np.maximum(deepest[block], (yield from self.depth(points)))
        return deepest


def _shadow_steps(columns: _Columns, low: Doubles, high: Doubles) -> Steps[tuple[Doubles, Doubles]]:
    """Return triangles within the shadow, (2, 3, n), those of whole squares and those at the outline."""
    spans = (high - low)[:2]
    side = max(float(spans.max()) / FIRST_SQUARES, SIDE_MM)
    counts = [max(1, math.ceil(span / side)) + 1 for span in spans.tolist()]
    origin = ((low + high) / 2)[:2, None] - np.array(counts)[:, None] * (side / 2)
    at = np.stack([each.ravel() for each in np.indices(counts)])
    whole = []
    while True:
        step = max(side, STEP_MM)
        deepest = yield from columns.deepest_steps(origin + (at + 0.5) * side, step)
        reach = HALF_DIAGONAL * side
        whole.append(_triangles(origin, at[:, deepest > reach], side))
        at = at[:, (deepest <= reach) & (deepest + step / 2 > -reach)]
        if side <= SIDE_MM or at.shape[1] > MOST_SQUARES:
            break
        at, side = (2 * at[:, :, None] + CORNERS[:, None]).reshape(2, -1), side / 2
    outline = yield from _outline_steps(columns, origin, at, side)
    return np.concatenate(whole, axis=2), outline


def _outline_steps(columns: _Columns, origin: Doubles, at: Indices, side: float) -> Steps[Doubles]:
    """Return what of squares lies in the shadow, as triangles (2, 3, n)."""
    corners = (at[:, :, None] + CORNERS[:, None]).reshape(2, -1)
    if not corners.shape[1]:
        return np.empty((2, 3, 0))
    width = int(corners[1].max()) + 1
    flat, number = np.unique(corners[0] * width + corners[1], return_inverse=True)
    places = origin + np.stack(np.divmod(flat, width)) * side
    deepest = yield from columns.deepest_steps(places, STEP_MM)
    yield PAUSE
    numbers = number.reshape(-1, 4)[:, HALVES].reshape(-1, 3).T  # (3, triangles)
    return cut_triangles(places[:, numbers], deepest[numbers])


def cut_triangles(corners: Doubles, values: Doubles) -> Doubles:
    """Return what of triangles has a value above 0, linear between the corners, as triangles.

    Parameters
    ----------
    corners : (2, 3, n) float64
    values : (3, n) float64

    Examples
    --------
    >>> corners = np.array([[0.0, 4.0, 0.0], [0.0, 0.0, 4.0]])[:, :, None]
    >>> cut_triangles(corners, np.array([[1.0], [-1.0], [-3.0]])).tolist()
    [[[0.0], [2.0], [0.0]], [[0.0], [0.0], [1.0]]]
    """
    inside = values > 0
    count = inside.sum(axis=0)
    parts = [corners[:, :, count == 3]]
    for one in (1, 2):  # one corner that is inside, or outside
        chosen = np.flatnonzero(count == one)
        apex = (inside if one == 1 else ~inside)[:, chosen].argmax(axis=0)
        turn = (apex + np.arange(3)[:, None]) % 3
        a, b, c = (corners[:, turn[number], chosen] for number in range(3))
        at, bt, ct = (values[turn[number], chosen] for number in range(3))
        ab, ac = a + (b - a) * (at / (at - bt)), a + (c - a) * (at / (at - ct))
        if one == 1:
            parts.append(np.stack([a, ab, ac], axis=1))
        else:
            parts += [np.stack([ab, b, c], axis=1), np.stack([ab, c, ac], axis=1)]
    return np.concatenate(parts, axis=2)


def _triangles(origin: Doubles, at: Indices, side: float) -> Doubles:
    """Return the halves of squares, (2, 3, n)."""
    corners = origin[:, :, None] + (at[:, :, None] + CORNERS[:, None]) * side  # (2, n, 4)
    return np.concatenate([corners[:, :, half].transpose(0, 2, 1) for half in HALVES], axis=2)


def _flat_mesh(triangles: Doubles) -> TriangleMesh:
    """Return triangles (2, 3, n) at z = 0."""
    count = triangles.shape[2]
    vertices = np.zeros((3 * count, 3), np.float32)
    vertices[:, :2] = triangles.transpose(2, 1, 0).reshape(-1, 2)
    faces: NDArray[np.int32] = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return TriangleMesh(vertices, faces)
