# SPDX-License-Identifier: GPL-3.0-or-later
"""Pairs of triangles of a mesh that have a point in common besides common vertices and edges, decided exactly.

What counts is what other programs call a self-intersection (as CGAL's `does_self_intersect`): touching too. Triangles
without a common vertex must not have a common point. Those with one common vertex must meet there alone; those with a
common edge must not lie on each other. A triangle without area counts as one that meets itself, and is compared with
no other. A vertex is its number: two vertices at one position are two.

Most pairs that are near each other are neighbors, and most neighbors are proved apart by looking at the vertex between
them (`stars`). Of the others most lie on one side of each other's plane, which float64 decides. The rest is decided
exactly (`triangle_pairs`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...progress import PAUSE, Steps, finish
from ..distance.triangle_tree import CODE_BITS, morton_codes
from ..vectors import cross, dot
from .box_pairs import BoxTree
from .near import near_boxes
from .orientation import EPSILON
from .stars import flat_stars_steps
from .triangle_pairs import have_no_area, triangles_at_edge_meet, triangles_at_vertex_meet, triangles_meet

Ints = NDArray[np.int32]
Indices = NDArray[np.int64]
Doubles = NDArray[np.float64]
Flags = NDArray[np.bool_]

TOGETHER = 64  # blocks of pairs whose doubtful ones are decided together
FEW = 10  # times as many triangles as selected ones, from which on those far away are left out first
PLANE_ERROR = 64 * EPSILON  # of the square of a triangle's size times an offset, both in the largest norm


def self_intersections(vertices: NDArray[Any], faces: NDArray[Any], selected: Flags | None = None) -> Indices:
    """Drive `self_intersections_steps`.

    Examples
    --------
    >>> corners = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [1, 1, -1], [1, 1, 1], [9, 9, 0]], np.float32)
    >>> self_intersections(corners, np.array([[0, 1, 2], [3, 4, 5]], np.int32))
    array([[0, 1]])
    """
    return finish(self_intersections_steps(vertices, faces, selected))


def self_intersections_steps(
    vertices: NDArray[Any], faces: NDArray[Any], selected: Flags | None = None
) -> Steps[Indices]:
    """Find the pairs of triangles that cross, touch or overlap each other.

    Parameters
    ----------
    vertices : (V, 3) float32
        Finite, in any unit.
    faces : (F, 3) int32
        Any triangles over them: one surface, several, or the complex of labels that share walls.
    selected : (F,) bool, optional
        Only pairs with at least one of these triangles are looked for.

    Returns
    -------
    (n, 2) int64
        Numbers of two triangles, the lower first, in rising order; twice the same for a triangle without area.
    """
    if not len(faces) or (selected is not None and not selected.any()):
        return np.zeros((0, 2), np.int64)
    near = None
    if selected is not None and FEW * selected.sum() < len(selected):
        near = np.flatnonzero((yield from _near_steps(vertices, faces, selected)))
        faces, selected = faces[near], selected[near]
    mesh = _Ordered()
    yield from mesh.prepare_steps(vertices, faces, selected)
    if near is not None:
        mesh.order = near[mesh.order]
    found = [np.stack([mesh.flat, mesh.flat])]
    doubtful: list[list[Indices]] = []
    blocks = mesh.tree.pairs()
    while (block := next(blocks, None)) is not None:
        doubtful.append(mesh.doubtful(*block))
        if len(doubtful) == TOGETHER:
            found += mesh.meeting(_joined(doubtful))
            doubtful = []
        yield PAUSE
    found += mesh.meeting(_joined(doubtful))
    pairs = np.sort(mesh.order[np.concatenate(found, axis=1)], axis=0)
    return np.ascontiguousarray(pairs[:, np.lexsort(pairs[::-1])].T)


def _near_steps(vertices: NDArray[Any], faces: NDArray[Any], selected: Flags) -> Steps[Flags]:
    """Which triangles may meet one of a few selected ones."""
    columns, rows = np.ascontiguousarray(vertices.T, np.float32), np.ascontiguousarray(faces.T)
    low, high = np.empty((2, 3, len(faces)), np.float32)
    yield PAUSE
    for axis, along in enumerate(columns):
        a, b, c = (np.take(along, corner) for corner in rows)
        low[axis], high[axis] = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    yield PAUSE
    return near_boxes(low, high, selected)


class _Ordered:
    """The triangles of a mesh in an order that keeps neighbors together, in columns, and what is known of each."""

    def prepare_steps(self, vertices: NDArray[Any], faces: NDArray[Any], selected: Flags | None) -> Steps[None]:
        """Take in a mesh."""
        columns, rows = np.ascontiguousarray(vertices.T, np.float32), np.ascontiguousarray(faces.T, np.int32)
        self.order = yield from _order_steps(columns, rows)
        self.faces, self.columns = np.take(rows, self.order, axis=1), columns
        yield PAUSE
        self.corners = [np.take(columns, corner, axis=1) for corner in self.faces]
        yield PAUSE
        a, b, c = self.corners
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        size = (high.astype(np.float64) - low).max(axis=0)
        self.error = PLANE_ERROR * size * size  # of a normal's product with an offset, for every unit of that
        yield PAUSE
        start = a.astype(np.float64)
        self.normals = cross(b - start, c - start)
        yield PAUSE
        thin = np.flatnonzero(np.abs(self.normals).max(axis=0) <= self.error)
        twice = (self.faces == self.faces[[1, 2, 0]]).any(axis=0)
        self.flat = thin[have_no_area(_doubles(self.corners, thin)) | twice[thin]]
        stars = yield from flat_stars_steps(self.corners, self.faces, columns.shape[1], self.normals, self.error)
        proved = [np.take(stars, corner).view(np.uint8) << np.uint8(row) for row, corner in enumerate(self.faces)]
        self.proved = proved[0] | proved[1] | proved[2]
        low[:, self.flat], high[:, self.flat] = np.inf, -np.inf
        chosen = None if selected is None else selected[self.order]
        if chosen is not None:
            self.flat = self.flat[chosen[self.flat]]
        yield PAUSE
        self.tree = BoxTree(low, high, chosen)

    def doubtful(self, first: Ints, second: Ints) -> list[Indices]:
        """Of pairs of triangles whose boxes overlap those that may meet: (2, n) for 0, 1, 2 and 3 common vertices."""
        ours, theirs = np.take(self.faces, first, axis=1), np.take(self.faces, second, axis=1)
        common = np.zeros(len(first), np.uint8)  # a bit for every corner of the first that the second has too
        for row, corner in enumerate(ours):
            same = (corner == theirs[0]) | (corner == theirs[1]) | (corner == theirs[2])
            common |= same.view(np.uint8) << np.uint8(row)
        left = np.flatnonzero(common & np.take(self.proved, first) == 0)
        count = _COUNT[common[left]]
        of_count = [left[count == number] for number in range(4)]
        apart = of_count[0]
        for planes, others in ((first, second), (second, first)):
            apart = apart[~self._one_side(planes[apart], self._corners(others[apart]))]
        of_count[0] = apart
        return [np.stack([first[at], second[at]]) for at in of_count]

    def meeting(self, doubtful: list[Indices]) -> list[Indices]:
        """The pairs, (2, n) each, that meet where they may not."""
        tests = (self._meet, self._meet_beyond_vertex, self._meet_beyond_edge)
        return [pairs[:, test(*pairs)] for test, pairs in zip(tests, doubtful[:3], strict=True)] + doubtful[3:]

    def _corners(self, triangles: Ints) -> list[Doubles]:
        return _doubles(self.corners, triangles)

    def _one_side(self, planes: Ints, points: list[Doubles]) -> Flags:
        """Whether points are surely on one side of the planes of triangles, none on it."""
        normal, place = np.take(self.normals, planes, axis=1), _doubles(self.corners[:1], planes)[0]
        least, most = np.full(len(planes), np.inf), np.full(len(planes), -np.inf)
        reach = np.zeros(len(planes))
        for point in points:
            offset = point - place
            height = dot(normal, offset)
            np.minimum(least, height, out=least)
            np.maximum(most, height, out=most)
            for along in offset:
                np.maximum(reach, np.abs(along), out=reach)
        error = np.take(self.error, planes) * reach
        return (least > error) | (most < -error)

    def _meet(self, first: Ints, second: Ints) -> Flags:
        """Which of these pairs without a common vertex meet."""
        return triangles_meet(self._corners(first), self._corners(second))

    def _meet_beyond_vertex(self, first: Ints, second: Ints) -> Flags:
        """Which of these pairs with one common vertex meet elsewhere."""
        ours, theirs = self.faces[:, first], self.faces[:, second]
        same = ours[:, None] == theirs
        turned = []
        for numbers, corner in ((ours, same.any(axis=1).argmax(axis=0)), (theirs, same.any(axis=0).argmax(axis=0))):
            column = np.arange(len(corner))
            turned.append([numbers[(corner + turn) % 3, column] for turn in range(3)])
        sides = [[_doubles([self.columns], corner)[0] for corner in triangle] for triangle in turned]
        at = np.flatnonzero(~self._one_side(first, sides[1][1:]))
        at = at[~self._one_side(second[at], [corner[:, at] for corner in sides[0][1:]])]
        out = np.zeros(len(first), bool)
        out[at] = triangles_at_vertex_meet(*([corner[:, at] for corner in triangle] for triangle in sides))
        return out

    def _meet_beyond_edge(self, first: Ints, second: Ints) -> Flags:
        """Which of these pairs with a common edge lie on each other."""
        ours, theirs = self.faces[:, first], self.faces[:, second]
        same = ours[:, None] == theirs
        column = np.arange(len(first))
        alone = same.any(axis=1).argmin(axis=0)
        points = [ours[(alone + turn) % 3, column] for turn in (1, 2, 0)]
        points.append(theirs[same.any(axis=0).argmin(axis=0), column])
        return triangles_at_edge_meet(*(_doubles([self.columns], point)[0] for point in points))


def _doubles(points: list[NDArray[np.float32]], at: NDArray[Any]) -> list[Doubles]:
    return [np.take(point, at, axis=1).astype(np.float64) for point in points]


def _joined(blocks: list[list[Indices]]) -> list[Indices]:
    """The pairs of several blocks, by the number of common vertices."""
    empty = np.zeros((2, 0), np.int32)
    return [np.concatenate([empty, *(block[number] for block in blocks)], axis=1) for number in range(4)]


_COUNT = np.array([0, 1, 1, 2, 1, 2, 2, 3], np.uint8)  # bits set


def _order_steps(columns: NDArray[np.float32], faces: NDArray[Any]) -> Steps[Indices]:
    """The order of the triangles (3, F) along a curve that keeps neighbors together, (F,)."""
    low, high = columns.min(axis=1), columns.max(axis=1)
    extent = float((high.astype(np.float64) - low).max()) or 1.0
    corner = np.take(columns, faces[0], axis=1).T
    codes = morton_codes(corner, low, (2**CODE_BITS - 1) / extent)
    yield PAUSE
    order = np.arange(len(codes))
    for shift in (32, 48):  # the upper half is enough
        digits = (codes >> np.uint64(shift)).astype(np.uint16)[order]
        order = order[np.argsort(digits, kind="stable")]
        yield PAUSE
    return order
