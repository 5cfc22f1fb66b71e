# SPDX-License-Identifier: GPL-3.0-or-later
"""Find exactly the pairs of triangles of a mesh that have a common point besides common vertices and edges.

These are self-intersections as in other programs (CGAL's `does_self_intersect`), including triangles that touch. Two
triangles without a common vertex must not have a common point; with one common vertex they must meet only there; with a
common edge they must not lie on each other. A triangle without area counts as meeting itself, and is compared with no
other. Vertices are identified by number: two vertices at one position are different.

Most near pairs are neighbors, and most neighbors are proved apart by the vertex between them (`stars`). Most other
pairs lie on one side of each other's plane, which float64 decides. The rest is decided exactly (`triangle_pairs`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles, Flags, Floats, Indices, Ints
from ...progress import PAUSE, Steps, finish
from ..distance.triangle_tree import CODE_BITS, morton_codes
from ..topology import compacted
from ..vectors import cross, dot
from .box_pairs import BoxTree
from .near import near_faces_steps
from .orientation import EPSILON
from .stars import flat_stars_steps
from .triangle_pairs import have_no_area, surely_apart, triangles_at_edge_meet, triangles_at_vertex_meet, triangles_meet

Pairs = Iterator[tuple[Ints, Ints]]

BLOCKS_AT_ONCE = 16  # Decide the doubtful pairs of this many blocks at once.
FEW = 8  # Leave out far triangles first if there are this many times as many triangles as selected ones.
PLANE_ERROR = 64 * EPSILON  # Error per square of a triangle's size times an offset, both in the largest norm.


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
    columns, rows = np.ascontiguousarray(vertices.T, np.float32), np.ascontiguousarray(faces.T, np.int32)
    numbers = None
    if selected is not None and FEW * selected.sum() < len(selected):
        numbers = np.flatnonzero((yield from near_faces_steps(columns, rows, selected)))
        rows, selected = np.take(rows, numbers, axis=1), selected[numbers]
    order = yield from _order_steps(columns, rows)
    numbers = order if numbers is None else numbers[order]
    rows, selected = np.take(rows, order, axis=1), None if selected is None else selected[order]
    yield PAUSE
    low, high = yield from _boxes_steps(columns, rows)
    blocks: Pairs = BoxTree(low, high, selected).pairs()
    del low, high
    if selected is not None and 2 * selected.sum() < len(selected):
        blocks, kept = yield from _kept_steps(blocks, selected)
        numbers, selected = numbers[kept], selected[kept]
        columns, rows = _used(columns, np.take(rows, kept, axis=1))
    mesh = _Triangles(columns, rows)
    yield from mesh.measure_steps()
    flat = mesh.flat if selected is None else mesh.flat[selected[mesh.flat]]
    pair_blocks = [np.stack([flat, flat])]
    doubtful: list[list[Indices]] = []
    while (block := next(blocks, None)) is not None:
        doubtful.append(mesh.doubtful(*block))
        if len(doubtful) == BLOCKS_AT_ONCE:
            pair_blocks += mesh.meeting(_joined(doubtful))
            doubtful = []
        yield PAUSE
    pair_blocks += mesh.meeting(_joined(doubtful))
    pairs = np.sort(numbers[np.concatenate(pair_blocks, axis=1)], axis=0)
    return np.ascontiguousarray(pairs[:, np.lexsort(pairs[::-1])].T)


def _boxes_steps(columns: Floats, faces: Ints) -> Steps[tuple[Floats, Floats]]:
    """Lowest and highest coordinates of triangles, (3, F) each."""
    low, high = np.empty((2, 3, faces.shape[1]), np.float32)
    for axis, along in enumerate(columns):
        a, b, c = (np.take(along, corner) for corner in faces)
        low[axis], high[axis] = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        yield PAUSE
    return low, high


def _kept_steps(blocks: Pairs, selected: Flags) -> Steps[tuple[Pairs, Indices]]:
    """Return the pairs with new numbers for the triangles that are in one or selected, and which these are."""
    pairs, kept = [], selected.copy()
    for first, second in blocks:
        pairs.append((first, second))
        kept[first] = kept[second] = True
        yield PAUSE
    number = np.cumsum(kept, dtype=np.int32) - np.int32(1)
    return ((np.take(number, first), np.take(number, second)) for first, second in pairs), np.flatnonzero(kept)


def _used(columns: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Only the vertices that triangles have, and these with the new numbers."""
    used, faces = compacted(faces, columns.shape[1])
    return np.compress(used, columns, axis=1), faces


class _Triangles:
    """Triangles in columns, and facts about each.

    columns : (3, V) float32
    faces : (3, F) int32
    """

    def __init__(self, columns: Floats, faces: Ints) -> None:
        self.columns, self.faces = columns, faces

    def measure_steps(self) -> Steps[None]:
        """Find planes, triangles without area, and the corners that are proved to be the only common point."""
        columns, faces = self.columns, self.faces
        self.corners = [np.take(columns, corner, axis=1) for corner in faces]
        yield PAUSE
        start = self.corners[0].astype(np.float64)
        to_b, to_c = (corner - start for corner in self.corners[1:])
        size = np.maximum(np.abs(to_b).max(axis=0), np.abs(to_c).max(axis=0))
        error = PLANE_ERROR * size * size  # of a normal's product with an offset, for every unit of that
        yield PAUSE
        self.normals = cross(to_b, to_c)
        del to_b, to_c, size
        self.offsets = dot(self.normals, start)
        # No offset is longer than twice the largest coordinate; that again for what the products lose.
        self.errors = error * (4 * float(np.abs(columns).max()))
        yield PAUSE
        thin = np.flatnonzero(np.abs(self.normals).max(axis=0) <= error)
        twice = (faces == faces[[1, 2, 0]]).any(axis=0)
        self.flat = thin[have_no_area(_doubles(self.corners, thin)) | twice[thin]]
        self.is_flat = np.zeros(faces.shape[1], bool)
        self.is_flat[self.flat] = True
        stars = yield from flat_stars_steps(self.corners, faces, columns.shape[1], self.normals, error)
        proved = [np.take(stars, corner).view(np.uint8) << np.uint8(row) for row, corner in enumerate(faces)]
        self.proved = proved[0] | proved[1] | proved[2]
        yield PAUSE

    def doubtful(self, first: Ints, second: Ints) -> list[Indices]:
        """Return the pairs that may meet, of boxes that overlap: (2, n) each for 0, 1, 2 and 3 common vertices."""
        if len(self.flat):
            solid = ~(np.take(self.is_flat, first) | np.take(self.is_flat, second))
            first, second = first[solid], second[solid]
        ours, theirs = np.take(self.faces, first, axis=1), np.take(self.faces, second, axis=1)
        common = np.zeros(len(first), np.uint8)  # a bit for every corner of the first that the second has too
        for row, corner in enumerate(ours):
            same = (corner == theirs[0]) | (corner == theirs[1]) | (corner == theirs[2])
            common |= same.view(np.uint8) << np.uint8(row)
        left = np.flatnonzero(common & np.take(self.proved, first) == 0)
        count = _COUNT[common[left]]
        for planes, opposite in ((first, second), (second, first)):
            near = ~self._one_side(planes[left], opposite[left], _OWN[count])
            left, count = left[near], count[near]
        pairs = np.stack([first[left], second[left]])
        return [np.compress(count == number, pairs, axis=1) for number in range(4)]

    def meeting(self, doubtful: list[Indices]) -> list[Indices]:
        """Return the pairs, (2, n) each, that meet where they may not."""
        tests = (self._meet, self._meet_beyond_vertex, self._meet_beyond_edge)
        return [pairs[:, test(*pairs)] for test, pairs in zip(tests, doubtful[:3], strict=True)] + doubtful[3:]

    def _corners(self, triangles: Ints) -> list[Doubles]:
        return _doubles(self.corners, triangles)

    def _one_side(self, planes: Ints, triangles: Ints, own: NDArray[np.uint8]) -> Flags:
        """Return whether the corners of triangles, but for those in `own` planes, are surely on one side."""
        x, y, z = np.take(self.normals, planes, axis=1)
        least, error = np.take(self.offsets, planes), np.take(self.errors, planes)
        most = least + error
        least -= error
        above, below = np.zeros((2, len(planes)), np.uint8)
        for corner in self.corners:
            along = np.take(corner, triangles, axis=1)
            height = x * along[0] + y * along[1] + z * along[2]
            above += height > most
            below += height < least
        return (np.maximum(above, below) == own) & (np.minimum(above, below) == 0)

    def _meet(self, first: Ints, second: Ints) -> Flags:
        """Return whether each pair without a common vertex meets."""
        met = ~surely_apart(self._corners(first), self._corners(second))
        left = np.flatnonzero(met)
        met[left] = triangles_meet(self._corners(first[left]), self._corners(second[left]))
        return met

    def _meet_beyond_vertex(self, first: Ints, second: Ints) -> Flags:
        """Return whether each pair with one common vertex meets elsewhere."""
        ours, theirs = self.faces[:, first], self.faces[:, second]
        same = ours[:, None] == theirs
        turned = []
        for numbers, corner in ((ours, same.any(axis=1).argmax(axis=0)), (theirs, same.any(axis=0).argmax(axis=0))):
            column = np.arange(len(corner))
            turned.append([numbers[(corner + turn) % 3, column] for turn in range(3)])
        sides = [[_doubles([self.columns], corner)[0] for corner in triangle] for triangle in turned]
        return triangles_at_vertex_meet(*sides)

    def _meet_beyond_edge(self, first: Ints, second: Ints) -> Flags:
        """Return whether the triangles of each pair with a common edge lie on each other."""
        ours, theirs = self.faces[:, first], self.faces[:, second]
        same = ours[:, None] == theirs
        column = np.arange(len(first))
        own_corner = same.any(axis=1).argmin(axis=0)
        points = [ours[(own_corner + turn) % 3, column] for turn in (1, 2, 0)]
        points.append(theirs[same.any(axis=0).argmin(axis=0), column])
        return triangles_at_edge_meet(*(_doubles([self.columns], point)[0] for point in points))


def _doubles(points: list[Floats], at: NDArray[Any]) -> list[Doubles]:
    return [np.take(point, at, axis=1).astype(np.float64) for point in points]


def _joined(blocks: list[list[Indices]]) -> list[Indices]:
    """Return the pairs of several blocks, by the number of common vertices."""
    empty = np.zeros((2, 0), np.int32)
    return [np.concatenate([empty, *(block[number] for block in blocks)], axis=1) for number in range(4)]


_COUNT = np.array([0, 1, 1, 2, 1, 2, 2, 3], np.uint8)  # The number of bits set.
# The number of corners that are not common; two triangles of the same corners always meet.
_OWN = np.array([3, 2, 1, 4], np.uint8)


def _order_steps(columns: Floats, faces: Ints) -> Steps[Indices]:
    """Return the order of the triangles (3, F) along a curve that keeps neighbors close, (F,)."""
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
