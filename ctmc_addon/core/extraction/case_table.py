# SPDX-License-Identifier: GPL-3.0-or-later
"""Derive the 256 cases of a surface in one voxel from the cube.

A voxel's corner k lies at x = k & 1, y = k >> 1 & 1, z = k >> 2. Bit k of a case says that corner k is
inside. Edge `4 a + b` runs along axis a from one of the four corners without a.

One rule cuts every face: walking around it, each run of inside corners is cut off by one segment. So
on an ambiguous face the two inside corners are separated. The rule knows only the face's own corners:
both voxels at a face cut it the same way, and the surface has no holes. The segments join into
loops, and each loop is cut into triangles by diagonals that lie in no face of the cube: otherwise the
neighbor could have the same diagonal, and an edge would have four triangles.

Example: in case 1 corner 0 alone is inside. The edges 0, 4 and 8, which start from it along x, y and z, are crossed;
three faces are cut, and the segments join into the one loop 0, 4, 8: one triangle.

Cases after Lorensen and Cline 1987, doi:10.1145/37401.37422; Su and Ma, 2.1 and figure 1.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from .classic_cases import CLASSIC_CASES

NEAREST = 2.0**-10  # A crossing keeps this share of an edge from the edge's ends, so that no two vertices meet.
Loop = tuple[int, ...]
Triangle = tuple[int, int, int]


def _edges() -> tuple[tuple[int, int], ...]:
    """Corners (low, high) of the twelve edges."""
    return tuple((corner, corner | 1 << axis) for axis in range(3) for corner in range(8) if not corner >> axis & 1)


def _faces() -> tuple[tuple[int, int, int, int], ...]:
    """Corners of the six faces, counter-clockwise seen from outside the cube."""
    faces = []
    for axis in range(3):
        u, v = 1 << (axis + 1) % 3, 1 << (axis + 2) % 3
        faces.append((0, v, u | v, u))
        faces.append(tuple(corner | 1 << axis for corner in (0, u, u | v, v)))  # type: ignore[arg-type]
    return tuple(faces)


EDGES = _edges()
FACES = _faces()
EDGE_BETWEEN = {frozenset(ends): edge for edge, ends in enumerate(EDGES)}
MIDPOINTS = [[sum(corner >> axis & 1 for corner in ends) / 2 for axis in range(3)] for ends in EDGES]
FACES_OF_EDGE = tuple(frozenset(f for f, face in enumerate(FACES) if set(ends) <= set(face)) for ends in EDGES)


def face_segments(case: int, face: tuple[int, int, int, int]) -> Iterator[tuple[int, int]]:
    """Directed segments (edge, edge) in which the surface cuts a face, one for each run of inside corners.

    A segment leads from the edge where a walk around the face comes in to the edge where it goes out,
    which turns the loops counter-clockwise seen from outside the surface.
    """
    inside = [bool(case >> corner & 1) for corner in face]
    for start in range(4):
        if inside[start] and not inside[start - 1]:
            end = start
            while inside[(end + 1) % 4]:
                end += 1
            entry_edge = EDGE_BETWEEN[frozenset((face[start - 1], face[start]))]
            exit_edge = EDGE_BETWEEN[frozenset((face[end % 4], face[(end + 1) % 4]))]
            yield entry_edge, exit_edge


def loops(case: int) -> list[Loop]:
    """Closed loops of crossed edges, counter-clockwise seen from outside the surface."""
    following = dict(segment for face in FACES for segment in face_segments(case, face))
    return list(closed_loops(following))


def closed_loops(following: dict[int, int]) -> Iterator[Loop]:
    """The loops that the edges form, of which each is given the next, each from its lowest edge on; empties it."""
    while following:
        loop = [min(following)]
        while (edge := following.pop(loop[-1])) != loop[0]:
            loop.append(edge)
        yield tuple(loop)


def triangulations(loop: Loop) -> Iterator[tuple[Triangle, ...]]:
    """Yield every way to cut a loop into triangles by diagonals that lie in no face of the cube."""
    if len(loop) < 3:
        yield ()
        return
    first, last = loop[0], loop[-1]
    for apex in range(1, len(loop) - 1):
        left, right = loop[: apex + 1], loop[apex:]
        # A side of two edges is the loop's own; a longer one ends in a diagonal.
        if any(len(side) > 2 and FACES_OF_EDGE[side[0]] & FACES_OF_EDGE[side[-1]] for side in (left, right)):
            continue
        for before in triangulations(left):
            for after in triangulations(right):
                yield (*before, (first, loop[apex], last), *after)


def roughness(triangles: tuple[Triangle, ...]) -> float:
    """Sum of the squared side lengths at the edges' midpoints: the lower, the better the shapes."""
    return sum(
        (MIDPOINTS[a][axis] - MIDPOINTS[b][axis]) ** 2
        for triangle in triangles
        for a, b in zip(triangle, triangle[1:] + triangle[:1], strict=True)
        for axis in range(3)
    )


def case_triangles(case: int) -> tuple[Triangle, ...]:
    """Triangles of a case as triples of edges, the best shaped of the allowed cuts."""
    return tuple(triangle for loop in loops(case) for triangle in min(triangulations(loop), key=roughness))


@dataclass(frozen=True, eq=False)
class TriangleTables:
    """Triangles of every surface a voxel may have: its configurations, by number.

    Parameters
    ----------
    triangle_count : (configurations,) uint8
    first_triangle : (configurations,) intp
        Start of a configuration's triangles in `triangle_edges`.
    triangle_edges : (n, 3) intp
        Edges 0 to 11, and 12 to 14 for the vertices inside the voxel.
    interior_count : (configurations,) uint8
        Number of vertices inside the voxel: 0 in every classic case.
    """

    triangle_count: NDArray[np.uint8]
    first_triangle: NDArray[np.intp]
    triangle_edges: NDArray[np.intp]
    interior_count: NDArray[np.uint8]

    @cached_property
    def corners(self) -> CornerLists:
        """The triangles as lists of corners to look up."""
        lists, kinds = [], []
        for first, count in zip(self.first_triangle.tolist(), self.triangle_count.tolist(), strict=True):
            triangles = [tuple(triangle) for triangle in self.triangle_edges[first : first + count].tolist()]
            fan = _as_fan(triangles)
            lists.append(fan or [edge for triangle in triangles for edge in triangle])
            kinds.append(2 * count - bool(fan))
        edges = np.zeros((max(map(len, lists)), len(lists)), np.intp)
        for configuration, corners in enumerate(lists):
            edges[: len(corners), configuration] = corners
        return CornerLists(np.array(kinds, np.uint8), edges)


@dataclass(frozen=True, eq=False)
class CornerLists:
    """Edges to look up for a configuration's triangles: in a fan each edge only once.

    Two triangles (4, 0, 1), (4, 1, 2) are a fan about edge 4: the list is 4, 0, 1, 2, the kind 3, and `columns(3)`
    tells that the triangles are made of places 0, 1, 2 and 0, 2, 3 of the list.

    Parameters
    ----------
    corner_list_kind : (configurations,) uint8
        0 for no triangles, `2 n - 1` for n that make a fan, `2 n` for n others; see `columns`. Example: 3 for two
        triangles that make a fan, 4 for two that do not.
    edges : (longest list, configurations) intp
        Every configuration's list down a column, 0 below its end.
    """

    corner_list_kind: NDArray[np.uint8]
    edges: NDArray[np.intp]

    @staticmethod
    @cache
    def columns(kind: int) -> tuple[int, tuple[int, ...]]:
        """Return the number of corners in the list of a kind, and the position of each triangle corner in it."""
        triangles = (kind + 1) // 2
        if kind % 2:
            return triangles + 2, tuple(corner for n in range(triangles) for corner in (0, n + 1, n + 2))
        return 3 * triangles, tuple(range(3 * triangles))


def _as_fan(triangles: list[Triangle]) -> Loop:
    """Return the corners of triangles that all share one, that one first; empty where they make no fan.

    Examples
    --------
    >>> _as_fan([(0, 3, 4), (2, 3, 0)])
    (0, 2, 3, 4)
    """
    for center in sorted(set.intersection(*map(set, triangles))) if triangles else ():
        rotated = [triangle[triangle.index(center) :] + triangle[: triangle.index(center)] for triangle in triangles]
        following = {second: third for _, second, third in rotated}
        starts = set(following) - set(following.values())
        if len(starts) == 1 and len(following) == len(triangles):
            fan = (center, *starts)
            while fan[-1] in following:
                fan += (following[fan[-1]],)
            return fan
    return ()


def _classic() -> TriangleTables:
    cases = CLASSIC_CASES.split(".")
    count = np.array([len(edges) // 3 for edges in cases], np.uint8)
    return TriangleTables(
        triangle_count=count,
        first_triangle=np.cumsum(count, dtype=np.intp) - count,
        triangle_edges=np.array([int(edge, 16) for edge in "".join(cases)], np.intp).reshape(-1, 3),
        interior_count=np.zeros(256, np.uint8),
    )


CLASSIC = _classic()
"""The 256 cases."""
