# SPDX-License-Identifier: GPL-3.0-or-later
"""How the walls between three labels or more pass through one voxel.

Corners, edges and faces are numbered as in case_table.py. On each face the labels are separated by segments:

    two labels      as case_table.py cuts it: runs of the label with the larger number are cut off
    three, a b a c  the runs of b and of c are cut off, and a is connected
    three or four   the crossings are joined at a point on the face, which both voxels at it share

The segments of a voxel form connected groups. A group without a point on a face is a loop between two labels. If it is
the only group, or cuts off one corner, it is cut into triangles as in case_table.py. Every other group is a fan around
a point inside the voxel: diagonals of two loops could cross. Where a label would touch itself in that point, as one at
two opposite corners, a part of its border gets a point of its own, so that other programs find a surface that does not
touch itself. After Hege, Seebass, Stalling and Zoeckler 1997, ZIB
SC-97-05, and Wu and Sullivan 2003, doi:10.1002/nme.775.

A voxel's pattern is a number: three bits for each corner, the first corner with the same label, and a bit for each face
that says whether there the label of the face's first corner is larger than that of its second.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...mesh.topology import Groups
from ..case_table import EDGE_BETWEEN, FACES, Loop, closed_loops, roughness, triangulations

CORNER_BITS = 3
FACE_POINT = 12  # Nodes: 12 edges of the voxel, then a point on each of 6 faces, then points inside.
INNER_POINT = 18
FACE_CORNERS = np.array(FACES)
# Segments: two nodes, then the corners that stand for the label behind it and for the one in front.
FaceSegment = tuple[int, int, int, int]
Triangle = tuple[int, int, int]
Fan = dict[Triangle, tuple[int, int]]  # The labels behind and in front of each triangle.


@dataclass(frozen=True)
class Pattern:
    """The triangles of a pattern.

    Parameters
    ----------
    triangles : tuple of (a, b, c)
        Nodes of each triangle; the normal points out of the label behind it.
    sides : tuple of (behind, front)
        Corners whose labels these are.
    inner_points : tuple of tuple of int
        The crossed edges that each point inside the voxel is the mean of.
    """

    triangles: tuple[tuple[int, int, int], ...]
    sides: tuple[tuple[int, int], ...]
    inner_points: tuple[Loop, ...]


@dataclass(frozen=True, eq=False)
class PatternTables:
    """Arrays of some patterns; entries of pattern n begin at `first_triangle[n]` and `first_inner[n]`.

    Parameters
    ----------
    first_triangle, first_inner : (n + 1,) intp
    triangles : (t, 3) intp
    sides : (t, 2) intp
    inner_first : (p + 1,) intp
        Start of the edges of every inner point in `inner_edges`.
    inner_edges : (e,) intp
    """

    first_triangle: NDArray[np.intp]
    first_inner: NDArray[np.intp]
    triangles: NDArray[np.intp]
    sides: NDArray[np.intp]
    inner_first: NDArray[np.intp]
    inner_edges: NDArray[np.intp]


def pattern_numbers(owners: NDArray[Any]) -> NDArray[np.int64]:
    """Return the pattern of every voxel.

    Parameters
    ----------
    owners : (n, 8)
        Labels at the corners.

    Examples
    --------
    >>> pattern_numbers(np.array([[7, 7, 7, 7, 7, 7, 7, 7]])).tolist()
    [0]
    """
    number = np.zeros(len(owners), np.int64)
    for corner in range(8):
        number |= (owners[:, : corner + 1] == owners[:, corner, None]).argmax(axis=1) << (CORNER_BITS * corner)
    for face, (a, b, c, d) in enumerate(FACES):
        is_ambiguous = (owners[:, a] == owners[:, c]) & (owners[:, b] == owners[:, d])
        number |= (is_ambiguous & (owners[:, a] > owners[:, b])).astype(np.int64) << (8 * CORNER_BITS + face)
    return number


def faces_with_points(owners: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which faces of voxels have a point at which three or four labels meet, (n, 6).

    Parameters
    ----------
    owners : (n, 8)
        Labels at the corners.
    """
    a, b, c, d = (owners[:, FACE_CORNERS[:, corner]] for corner in range(4))
    # A diagonal of one label connects it; two labels have nothing else to meet at.
    three = (a != c) & (b != d)
    return three & ~((a == b) & (c == d)) & ~((a == d) & (b == c))


def tables_of(numbers: NDArray[np.int64]) -> PatternTables:
    """Return the tables of patterns, in their order."""
    patterns = [pattern_of(number) for number in numbers.tolist()]
    inner = [edges for pattern in patterns for edges in pattern.inner_points]
    return PatternTables(
        _firsts([len(pattern.triangles) for pattern in patterns]),
        _firsts([len(pattern.inner_points) for pattern in patterns]),
        np.array([triangle for pattern in patterns for triangle in pattern.triangles], np.intp).reshape(-1, 3),
        np.array([sides for pattern in patterns for sides in pattern.sides], np.intp).reshape(-1, 2),
        _firsts([len(edges) for edges in inner]),
        np.array([edge for edges in inner for edge in edges], np.intp),
    )


def _firsts(counts: list[int]) -> NDArray[np.intp]:
    return np.concatenate([[0], np.cumsum(counts, dtype=np.intp)]).astype(np.intp)


@cache
def pattern_of(number: int) -> Pattern:
    """Return the triangles of a pattern."""
    labels = [number >> (CORNER_BITS * corner) & 7 for corner in range(8)]
    segments = [
        segment
        for face in range(len(FACES))
        for segment in _face_segments(labels, face, bool(number >> (8 * CORNER_BITS + face) & 1))
    ]
    triangles: list[tuple[int, int, int]] = []
    sides: list[tuple[int, int]] = []
    inner: list[Loop] = []
    groups = _groups(segments)
    for group in groups:
        nodes = {node for segment in group for node in segment[:2]}
        stays_apart = len(group) == 3 or len(groups) == 1
        cut = _cut_loops(group) if stays_apart and max(nodes) < FACE_POINT else None
        if cut is not None:
            triangles += cut
            sides += [group[0][2:]] * len(cut)
            continue
        center = INNER_POINT + len(inner)
        # The mean of the points on faces, each of which is a mean itself: there the labels meet.
        on_faces = tuple(sorted(s[0] for s in group if s[1] >= FACE_POINT))
        inner.append(on_faces or tuple(sorted(nodes)))
        fan = {(first, second, center): (behind, front) for first, second, behind, front in group}
        while any(_split_off(fan, *part, center, inner) for part in _parts_that_meet(fan, center)):
            pass
        triangles += fan
        sides += fan.values()
    return Pattern(tuple(triangles), tuple(sides), tuple(inner))


def _parts_that_meet(fan: Fan, center: int) -> list[tuple[int, list[Triangle]]]:
    """Return the parts of labels' borders that meet a part of the same label in the point only, small ones first."""
    parts: list[tuple[int, list[Triangle]]] = []
    for label in sorted({label for both in fan.values() for label in both}):
        across: dict[FaceSegment, Triangle] = {}
        for triangle, (behind, front) in fan.items():
            if label in (behind, front) and center in triangle:
                first, second = (node for node in triangle if node != center)
                across[first, second, behind, front] = triangle
        groups = _groups(list(across))
        if len(groups) > 1:
            parts += [(label, [across[segment] for segment in group]) for group in groups]
    return sorted(parts, key=lambda part: len(part[1]))


def _split_off(fan: Fan, label: int, own: list[Triangle], center: int, inner: list[Loop]) -> bool:
    """Give a part of a label's border a point of its own, and join it to the other by walls between other labels.

    Returns whether that was done: not where a label would then touch itself along the edge between both points.
    """
    point = INNER_POINT + len(inner)
    beyond = {t: fan[t][1] if fan[t][0] == label else fan[t][0] for t in own}
    around = {node: [t for t in own if node in t] for triangle in own for node in triangle if node != center}
    walls: Fan = {}
    for node, (first, second) in around.items():
        if beyond[first] != beyond[second]:
            a, b, c = first if fan[first][0] == label else first[::-1]
            leads = (node, center) in ((a, b), (b, c), (c, a))
            walls[(node, point, center) if leads else (point, node, center)] = (beyond[first], beyond[second])
    sides = [segment_end for both in walls.values() for segment_end in both]
    if any(sides.count(segment_end) > 2 for segment_end in sides):
        return False
    edges = [node for node in around if node < FACE_POINT]
    of_center = inner[center - INNER_POINT]
    inner.append(tuple(sorted([*of_center, *edges * (len(of_center) // len(edges))])))  # half-way to those edges
    for triangle in own:
        both = fan.pop(triangle)
        a, b, c = (point if node == center else node for node in triangle)
        fan[a, b, c] = both
    fan.update(walls)
    return True


def _face_segments(labels: list[int], face: int, first_is_larger: bool) -> Iterator[FaceSegment]:
    """Yield the segments on a face; the label behind is on the left of each, seen from outside the voxel."""
    corners = FACES[face]
    around = [labels[corner] for corner in corners]
    edges = [EDGE_BETWEEN[frozenset((corners[at - 1], corners[at]))] for at in range(4)]  # before each corner
    a, b, c, d = around
    kinds = set(around)
    if len(kinds) == 1:
        return
    if len(kinds) == 2:
        inside = {a if first_is_larger else b} if (a, b) == (c, d) else {a}
    elif len(kinds) == 3 and (a == c or b == d):
        inside = kinds - {a if a == c else b}
    else:
        for at in range(4):
            if around[at] != around[at - 1]:
                yield edges[at], FACE_POINT + face, around[at], around[at - 1]
        return
    for start in range(4):
        if around[start] in inside and around[start] != around[start - 1]:
            end = start
            while around[(end + 1) % 4] == around[start]:
                end += 1
            yield edges[start], edges[(end + 1) % 4], around[start], around[start - 1]


def _groups(segments: list[FaceSegment]) -> list[list[FaceSegment]]:
    """Return the connected groups of segments, in the order of their lowest nodes."""
    joined = Groups(1 + max((node for segment in segments for node in segment[:2]), default=-1))
    for first, second, _, _ in segments:
        joined.join(first, second)
    groups: dict[int, list[FaceSegment]] = {}
    for segment in segments:
        groups.setdefault(joined.root(segment[0]), []).append(segment)
    return [groups[lowest] for lowest in sorted(groups)]


def _cut_loops(group: list[FaceSegment]) -> list[tuple[int, int, int]] | None:
    """Return the triangles of a loop between two labels; None where no diagonals cut it."""
    behind = group[0][2]
    following = dict((s[0], s[1]) if s[2] == behind else (s[1], s[0]) for s in group)
    (loop,) = closed_loops(following)
    best = min(triangulations(loop), key=roughness, default=None)
    return None if best is None else list(best)
