# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles of a voxel whose ambiguous faces and interior are decided one by one: the table of cases, continued.

case_table.py separates the inside corners of every ambiguous face. Here each ambiguous face may also connect
them, and a tunnel through the voxel may connect two of the loops. The loops cut the voxel's boundary into
regions of inside and of outside corners; a tunnel connects two regions of one side that border on a
common region, and the two loops between become the rims of one band. Every other loop bounds a disc.

A triangle's inner edge may lie in no face of the cube: the neighbor could have the same one. So some
voxels need vertices inside, which stand in the tables as edges 12, 13 and 14: one in the
middle of a disc that has no allowed diagonals, three around the waist of a tunnel. Each belongs to a group of
edges and lies half-way between the mean of the group's vertices and that of the whole disc's or band's.

Example: in case 129 the opposite corners 0 and 7 are inside. No face is ambiguous, and the loops are two triangles,
(0, 4, 8) and (3, 11, 7). Where the voxel's middle is inside too, a tunnel connects the two corners: the loops are the
rims of one band with three vertices inside the voxel.

Chernyaev 1995, CERN CN/95-17; Nielson 2003, doi:10.1109/TVCG.2003.1207437; Custodio et al. 2013,
doi:10.1016/j.cag.2013.04.004.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from itertools import combinations

from ..case_table import EDGES, FACES, MIDPOINTS, Loop, Triangle, closed_loops, face_segments, triangulations

INTERIOR = 12  # Numbers from this one on are vertices inside the voxel; lower ones are edges.

LONGEST_CUT = 7  # Cut loops of up to this many edges: longer ones bend too much for diagonals, or have no allowed ones.

COMMON_MULTIPLE = math.lcm(*range(1, 13))  # Every number of edges divides this.

Group = tuple[int, ...]
Piece = tuple[tuple[Triangle, ...], tuple[Group, ...]]
"""Triangles of a disc or band, and for each vertex inside the voxel its group of edges."""

SQUARED_DISTANCES = [
    [sum(int(2 * p - 2 * q) ** 2 for p, q in zip(a, b, strict=True)) for a in MIDPOINTS] for b in MIDPOINTS
]
"""(12, 12) squared distances between the midpoints of the edges, in half sides of the voxel."""

TUNNELS = tuple((low | first << 2, (low ^ 3) | second << 2) for low in (0, 1) for first in (0, 1) for second in (0, 1))
"""Corners whose regions a tunnel may connect: an end each of two opposite edges along z."""


@cache
def segments(case: int) -> tuple[tuple[tuple[int, int], ...], ...]:
    """`face_segments` of the six faces."""
    return tuple(tuple(face_segments(case, face)) for face in FACES)


def ambiguous_faces(case: int) -> list[int]:
    """Faces whose corners are inside and outside in turn."""
    return [number for number, cut in enumerate(segments(case)) if len(cut) == 2]


def contours(case: int, connected: int) -> tuple[Loop, ...]:
    """Loops of crossed edges as in `loops`; bit f of `connected` connects the inside corners of ambiguous face f."""
    following: dict[int, int] = {}
    for number, cut in enumerate(segments(case)):
        following.update(cut)
        if connected >> number & 1:
            (first, second), (third, fourth) = cut
            following.update(((first, fourth), (third, second)))
    return tuple(closed_loops(following))


def _connected_corners(case: int, connected: int) -> list[tuple[int, int]]:
    """Return the two corners that are connected across each ambiguous face, inside or outside."""
    pairs = []
    for number in ambiguous_faces(case):
        start = (case >> FACES[number][0] ^ connected >> number) & 1
        pairs.append((FACES[number][start], FACES[number][start + 2]))
    return pairs


def regions(case: int, connected: int) -> list[int]:
    """Region of the voxel's boundary that each corner lies in: the region's lowest corner."""
    region = list(range(8))
    alike = [ends for ends in EDGES if not (case >> ends[0] ^ case >> ends[1]) & 1]
    for a, b in alike + _connected_corners(case, connected):
        low, high = sorted((region[a], region[b]))
        region = [low if each == high else each for each in region]
    return region


def tunnels(case: int, connected: int) -> Iterator[tuple[int, tuple[Loop, Loop]]]:
    """Numbers of the possible `TUNNELS`, and the two loops that each makes into one band.

    What connects two z edges is a condition quadratic in z: met within a tunnel, it is met in neither end face.
    """
    in_ends = [{a & 3, b & 3} for a, b in _connected_corners(case, connected)]
    region = regions(case, connected)
    between = {}  # inside and outside region to loop, both ways
    for loop in contours(case, connected):
        a, b = (region[corner] for corner in EDGES[loop[0]])
        between[a, b] = between[b, a] = loop
    for number, ends in enumerate(TUNNELS):
        first, second = (region[end] for end in ends)
        common = [far for near, far in between if near == first and (second, far) in between]
        if first != second and common and {end & 3 for end in ends} not in in_ends:
            rims = between[first, common[0]], between[second, common[0]]
            if len(rims[0]) + len(rims[1]) < 10:  # longer ones are met in an end face along x or y
                yield number, rims


@cache
def spread(edges: Group) -> int:
    """Sum of the squared distances between the edges' midpoints, over their number; times `COMMON_MULTIPLE`.

    A whole number, since Python's versions add fractions up differently and would break ties differently.
    """
    return sum(SQUARED_DISTANCES[a][b] for a, b in combinations(edges, 2)) * (COMMON_MULTIPLE // len(edges))


@cache
def disc(loop: Loop) -> Piece:
    """A disc in a loop: by allowed diagonals the best shaped, or a fan around a vertex inside the voxel."""
    cuts = triangulations(loop) if len(loop) <= LONGEST_CUT else ()
    best = min(cuts, key=lambda triangles: sum(map(spread, triangles)), default=None)
    if best is not None:
        return best, ()
    return tuple((a, b, INTERIOR) for a, b in _sides(loop)), (loop,)


def _sides(loop: Loop) -> Iterator[tuple[int, int]]:
    return zip(loop, loop[1:] + loop[:1], strict=True)


def _runs(loop: Loop) -> Iterator[tuple[Group, Group, Group]]:
    """Yield every way to cut a loop into three runs of edges, in their order."""
    twice = loop + loop
    for a, b, c in combinations(range(len(loop)), 3):
        yield twice[a:b], twice[b:c], twice[c : a + len(loop)]


@cache
def band(first: Loop, second: Loop) -> Piece:
    """A band between two loops, with three vertices inside the voxel, each near a run of both loops."""
    # The surface keeps to the left of both loops, so they run around the band in opposite ways.
    waists = (
        tuple(forward[third] + backward[turn - third] for third in range(3))
        for forward in _runs(first)
        for backward in _runs(second)
        for turn in range(3)
    )
    waist = min(waists, key=lambda groups: sum(map(spread, groups)))
    nearest = {edge: INTERIOR + number for number, group in enumerate(waist) for edge in group}
    triangles = []
    for loop in (first, second):
        for a, b in _sides(loop):
            triangles.append((a, b, nearest[a]))
            if nearest[a] != nearest[b]:
                triangles.append((b, nearest[b], nearest[a]))
    return tuple(triangles), waist


def surface(case: int, connected: int, rims: tuple[Loop, ...] = ()) -> Piece:
    """Return all triangles of a voxel, given which faces are connected and the rims of its tunnel, if it has one."""
    pieces = [disc(loop) for loop in contours(case, connected) if loop not in rims]
    if rims:
        pieces.append(band(*rims))
    triangles = tuple(triangle for piece in pieces for triangle in piece[0])
    (groups,) = [piece[1] for piece in pieces if piece[1]] or [()]  # at most one piece has vertices inside
    return triangles, groups
