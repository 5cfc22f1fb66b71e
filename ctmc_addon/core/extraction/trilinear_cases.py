"""Triangles of a voxel whose ambiguous faces and interior are decided one by one: the table of cases, continued.

`cases.py` parts the inside corners of every ambiguous face. Here each ambiguous face may also join
them, and a tunnel through the voxel may join two of the loops. The loops cut the voxel's boundary into
regions of inside and of outside corners; a tunnel joins two regions of one side that border on a
common region, and the two loops between become the rims of one band. Every other loop bounds a disc.

A triangle's inner edge may lie in no face of the cube: the neighbour could have the same one. So some
voxels need vertices of their own, inside, which stand in the tables as edges 12, 13 and 14: one in the
middle of a disc that has no allowed diagonals, three around the waist of a tunnel. Each belongs to a group of
edges and lies half-way between the mean of the group's vertices and that of the whole disc's or band's.

Chernyaev 1995, CERN CN/95-17; Nielson 2003, doi:10.1109/TVCG.2003.1207437; Custodio et al. 2013,
doi:10.1016/j.cag.2013.04.004.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from itertools import combinations

from .case_table import EDGES, FACES, FACES_OF_EDGE, MIDPOINTS, Loop, Triangle, face_segments, triangulations

OWN = 12  # the first of the numbers that stand for a voxel's own vertices where others name an edge

LONGEST_CUT = 7  # edges of a loop; longer ones bend too much for diagonals, or have none that are allowed

PARTS = math.lcm(*range(1, 13))  # every number of edges divides it

Group = tuple[int, ...]
Piece = tuple[tuple[Triangle, ...], tuple[Group, ...]]
"""Triangles of a disc or band, and for each own vertex among them its group of edges."""

APART = [
    [sum(int(2 * p - 2 * q) ** 2 for p, q in zip(one, other, strict=True)) for one in MIDPOINTS] for other in MIDPOINTS
]
"""(12, 12) squared distances between the midpoints of the edges, in half sides of the voxel."""

TUNNELS = tuple((low | one << 2, (low ^ 3) | other << 2) for low in (0, 1) for one in (0, 1) for other in (0, 1))
"""Corners whose regions a tunnel may join: an end each of two opposite edges along z."""


@cache
def segments(case: int) -> tuple[tuple[tuple[int, int], ...], ...]:
    """`cases.face_segments` of the six faces."""
    return tuple(tuple(face_segments(case, face)) for face in FACES)


def ambiguous_faces(case: int) -> list[int]:
    """Faces whose corners are inside and outside in turn."""
    return [number for number, cut in enumerate(segments(case)) if len(cut) == 2]


def contours(case: int, joined: int) -> tuple[Loop, ...]:
    """Loops of crossed edges as in `cases.loops`; bit f of `joined` joins the inside corners of ambiguous face f."""
    following: dict[int, int] = {}
    for number, cut in enumerate(segments(case)):
        following.update(cut)
        if joined >> number & 1:
            (first, second), (third, fourth) = cut
            following.update(((first, fourth), (third, second)))
    found = []
    while following:
        loop = [min(following)]
        while (edge := following.pop(loop[-1])) != loop[0]:
            loop.append(edge)
        found.append(tuple(loop))
    return tuple(found)


def joined_corners(case: int, joined: int) -> list[tuple[int, int]]:
    """The two corners that are joined across each ambiguous face, inside or outside."""
    pairs = []
    for number in ambiguous_faces(case):
        start = (case >> FACES[number][0] ^ joined >> number) & 1
        pairs.append((FACES[number][start], FACES[number][start + 2]))
    return pairs


def regions(case: int, joined: int) -> list[int]:
    """Region of the voxel's boundary that each corner lies in, named by its lowest corner."""
    region = list(range(8))
    alike = [ends for ends in EDGES if not (case >> ends[0] ^ case >> ends[1]) & 1]
    for one, other in alike + joined_corners(case, joined):
        low, high = sorted((region[one], region[other]))
        region = [low if each == high else each for each in region]
    return region


def tunnels(case: int, joined: int) -> Iterator[tuple[int, tuple[Loop, Loop]]]:
    """Numbers of the possible `TUNNELS`, and the two loops that each makes into one band.

    What joins two z edges is a condition quadratic in z: met within a tunnel, it is met in neither end face.
    """
    in_ends = [{one & 3, other & 3} for one, other in joined_corners(case, joined)]
    region = regions(case, joined)
    between = {}  # inside and outside region to loop, both ways
    for loop in contours(case, joined):
        one, other = (region[corner] for corner in EDGES[loop[0]])
        between[one, other] = between[other, one] = loop
    for number, ends in enumerate(TUNNELS):
        one, other = (region[end] for end in ends)
        common = [far for near, far in between if near == one and (other, far) in between]
        if one != other and common and {end & 3 for end in ends} not in in_ends:
            rims = between[one, common[0]], between[other, common[0]]
            if len(rims[0]) + len(rims[1]) < 10:  # longer ones are met in an end face along x or y
                yield number, rims


def in_one_face(one: int, other: int) -> bool:
    """Whether a face of the cube holds both edges."""
    return bool(FACES_OF_EDGE[one] & FACES_OF_EDGE[other])


@cache
def spread(edges: Group) -> int:
    """Sum of the squared distances between the edges' midpoints, over their number; a whole number of `1 / PARTS`.

    Whole, as Python's versions add fractions up differently: ties would be broken here so and there so.
    """
    return sum(APART[a][b] for a, b in combinations(edges, 2)) * (PARTS // len(edges))


@cache
def disc(loop: Loop) -> Piece:
    """A disc in a loop: by allowed diagonals the best shaped, or a fan around an own vertex."""
    cuts = triangulations(loop) if len(loop) <= LONGEST_CUT else ()
    best = min(cuts, key=lambda triangles: sum(map(spread, triangles)), default=None)
    if best is not None:
        return best, ()
    return tuple((a, b, OWN) for a, b in _sides(loop)), (loop,)


def _sides(loop: Loop) -> Iterator[tuple[int, int]]:
    return zip(loop, loop[1:] + loop[:1], strict=True)


def _runs(loop: Loop) -> Iterator[tuple[Group, Group, Group]]:
    """Every way to cut a loop into three runs of edges, in their order."""
    twice = loop + loop
    for a, b, c in combinations(range(len(loop)), 3):
        yield twice[a:b], twice[b:c], twice[c : a + len(loop)]


@cache
def band(one: Loop, other: Loop) -> Piece:
    """A band between two loops, with three own vertices between them, each near a run of both loops."""
    # The surface keeps to the left of both loops, so they run around the band in opposite ways.
    waists = (
        tuple(forward[third] + backward[turn - third] for third in range(3))
        for forward in _runs(one)
        for backward in _runs(other)
        for turn in range(3)
    )
    waist = min(waists, key=lambda groups: sum(map(spread, groups)))
    nearest = {edge: OWN + number for number, group in enumerate(waist) for edge in group}
    triangles = []
    for loop in (one, other):
        for a, b in _sides(loop):
            triangles.append((a, b, nearest[a]))
            if nearest[a] != nearest[b]:
                triangles.append((b, nearest[b], nearest[a]))
    return tuple(triangles), waist


def surface(case: int, joined: int, rims: tuple[Loop, ...] = ()) -> Piece:
    """All triangles of a voxel, given its joined faces and the rims of its tunnel, if it has one."""
    pieces = [disc(loop) for loop in contours(case, joined) if loop not in rims]
    if rims:
        pieces.append(band(*rims))
    triangles = tuple(triangle for piece in pieces for triangle in piece[0])
    (groups,) = [piece[1] for piece in pieces if piece[1]] or [()]  # at most one piece has own vertices
    return triangles, groups
