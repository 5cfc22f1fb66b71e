"""Which of a case's surfaces the trilinear interpolant has: faces and interior decided from the grey values.

A face is decided by the sign of its bilinear interpolant at the saddle (the asymptotic decider): of the
two diagonals, the one with the larger product of differences from the threshold is joined. Both voxels at a
face multiply the same numbers, so they decide alike, ties included.

In a slice of the voxel at height z the same rule says which of two opposite z edges are joined, and its
condition is quadratic in z. A tunnel is where the answer changes and changes back within the heights at which the
slice is ambiguous. Two roots are all a quadratic has: a voxel has one tunnel at most, and whatever the
corners and faces show besides is shown by the loops.

Positions are in the voxel's own unit cube. Nielson and Hamann 1991, doi:10.1109/VISUAL.1991.175782;
Chernyaev 1995, CERN CN/95-17. The slices and their quadratic after Nielson 2003, doi:10.1109/TVCG.2003.1207437.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from .cases import EDGES, FACES, case_triangles
from .contours import Piece, ambiguous_faces, surface, tunnels

NEAREST = 2.0**-10  # share of an edge that a crossing keeps from the edge's ends
INSIDE = np.array([[case >> corner & 1 for corner in range(8)] for case in range(256)], bool)
AROUND = np.array(FACES)
AMBIGUOUS = (
    (INSIDE[:, AROUND[:, 0]] == INSIDE[:, AROUND[:, 2]])
    & (INSIDE[:, AROUND[:, 1]] == INSIDE[:, AROUND[:, 3]])
    & (INSIDE[:, AROUND[:, 0]] != INSIDE[:, AROUND[:, 1]])
)
"""(256, 6) whether a face's corners are inside and outside in turn."""

NEEDS = AMBIGUOUS.any(axis=1)
"""(256,) whether a case has more than one surface: an ambiguous face, or two opposite corners alone."""
for corner in range(4):
    NEEDS[1 << corner | 128 >> corner] = NEEDS[255 - (1 << corner | 128 >> corner)] = True

SQUARE = (0, 1, 3, 2)  # the corners around the low face along z; the z edges rise from them


@dataclass(frozen=True, eq=False)
class Tables:
    """Triangles of every surface a voxel may have: a row each, the 256 of `cases` first.

    Parameters
    ----------
    triangle_count : (rows,) uint8
    first_triangle : (rows,) intp
        Where a row's triangles begin in `triangle_edges`.
    triangle_edges : (n, 3) intp
        Edges 0 to 11, and 12 to 14 for the voxel's own vertices.
    own_count : (rows,) uint8
        Number of own vertices: 0, 1 or 3.
    own_weights : (rows, 3, 12) float64
        The share that each edge's vertex has in the place of each own vertex.
    row_of : (256, 64, 9) int16
        Row of a case, a bit for each face whose inside corners are joined, and 1 + the number of its tunnel.
    """

    triangle_count: NDArray[np.uint8]
    first_triangle: NDArray[np.intp]
    triangle_edges: NDArray[np.intp]
    own_count: NDArray[np.uint8]
    own_weights: NDArray[np.float64]
    row_of: NDArray[np.int16]


@cache
def tables() -> Tables:
    """The rows, made on first use."""
    rows: list[Piece] = [(case_triangles(case), ()) for case in range(256)]
    row_of = np.repeat(np.arange(256, dtype=np.int16), 64 * 9).reshape(256, 64, 9)
    for case in np.flatnonzero(NEEDS).tolist():
        faces = ambiguous_faces(case)
        for decisions in range(1 << len(faces)):
            joined = sum(1 << face for bit, face in enumerate(faces) if decisions >> bit & 1)
            if joined:
                row_of[case, joined] = len(rows)
                rows.append(surface(case, joined))
            for number, rims in tunnels(case, joined):
                row_of[case, joined, number + 1] = len(rows)
                rows.append(surface(case, joined, rims))
    count = np.array([len(triangles) for triangles, _ in rows], np.uint8)
    own_weights = np.zeros((len(rows), 3, 12))
    for row, (_, groups) in enumerate(rows):
        every = [edge for group in groups for edge in group]
        for number, group in enumerate(groups):
            own_weights[row, number, every] = 0.5 / len(every)
            own_weights[row, number, list(group)] += 0.5 / len(group)
    return Tables(
        triangle_count=count,
        first_triangle=np.cumsum(count, dtype=np.intp) - count,
        triangle_edges=np.array([triangle for triangles, _ in rows for triangle in triangles], np.intp),
        own_count=np.array([len(groups) for _, groups in rows], np.uint8),
        own_weights=own_weights,
        row_of=row_of,
    )


def resolve(values: NDArray[np.float64], threshold: float, case: NDArray[np.uint8]) -> NDArray[np.intp]:
    """Row of `tables` for the trilinear interpolant in every voxel.

    Parameters
    ----------
    values : (n, 8) float64
        Grey values of the corners. A corner on the wrong side of the threshold for its case, as the
        outside samples of a closed border are, counts as mirrored to the other side.
    threshold : float
    case : (n,) uint8

    Returns
    -------
    (n,) intp

    Notes
    -----
    A tie in a face joins the inside corners. A tunnel that is narrowed to a point is closed.

    Examples
    --------
    >>> corners = np.array([[1.0, -1, -1, -1, -1, -1, -1, 1], [4.0, -1, -1, -1, -1, -1, -1, 4]])
    >>> tables().own_count[resolve(corners, 0.0, np.array([129, 129], np.uint8))].tolist()
    [0, 3]
    """
    inside = INSIDE[case].T
    apart = np.abs(values - threshold).T
    difference = np.where(inside, apart, -apart)  # (8, n)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        joined = _joined_faces(difference, inside, case)
        tunnel = _tunnel(difference, inside)
    return tables().row_of[case, joined, tunnel].astype(np.intp)


def _joined_faces(
    difference: NDArray[np.float64], inside: NDArray[np.bool_], case: NDArray[np.uint8]
) -> NDArray[np.intp]:
    """A bit for each ambiguous face whose inside corners are joined."""
    joined = np.zeros(len(case), np.intp)
    for number, (a, b, c, d) in enumerate(FACES):
        one, other = difference[a] * difference[c], difference[b] * difference[d]
        join = np.where(inside[a], one >= other, other >= one) & AMBIGUOUS[case, number]
        joined |= join.astype(np.intp) << number
    return joined


def _tunnel(difference: NDArray[np.float64], inside: NDArray[np.bool_]) -> NDArray[np.intp]:
    """1 + the number of the tunnel in `TUNNELS`, 0 where there is none."""
    low = [difference[corner] for corner in SQUARE]
    high = [difference[corner | 4] for corner in SQUARE]
    # With a, b, c, d around a slice, a c - b d is positive where a and c are joined: constant + slope z + bend z z.
    constant = low[0] * low[2] - low[1] * low[3]
    middle = (low[0] * high[2] + low[2] * high[0]) - (low[1] * high[3] + low[3] * high[1])
    bend = constant - middle + (high[0] * high[2] - high[1] * high[3])
    slope = middle - 2 * constant
    reach = np.sqrt(slope * slope - 4 * constant * bend)  # not a number without roots: all below is False
    first = (-slope - np.copysign(reach, bend)) / (2 * bend)
    second = (-slope + np.copysign(reach, bend)) / (2 * bend)
    found = (first > 0) & (first < second) & (second < 1)
    at_first = [one + (other - one) * first >= 0 for one, other in zip(low, high, strict=True)]
    at_second = [one + (other - one) * second >= 0 for one, other in zip(low, high, strict=True)]
    found &= (at_first[0] == at_first[2]) & (at_first[1] == at_first[3]) & (at_first[0] != at_first[1])
    for one, other in zip(at_first, at_second, strict=True):
        found &= one == other
    # Between the roots the sign is against the bend. The corner of an edge is the end on the tunnel's side.
    turned = (bend > 0).astype(np.intp)
    ends = [inside[corner] != at for corner, at in zip(SQUARE, at_first, strict=True)]
    one_end = np.where(turned, ends[1], ends[0]).astype(np.intp)
    other_end = np.where(turned, ends[3], ends[2]).astype(np.intp)
    return np.where(found, 1 + 4 * turned + 2 * one_end + other_end, 0)


def crossings(values: NDArray[np.float64], threshold: float) -> NDArray[np.float64]:
    """Where the threshold crosses the voxels' edges, (n, 12), as a share of the edge from its low corner.

    Edges that are not crossed, and those of a closed border, have 0.5.
    """
    low, high = (values[:, list(ends)] for ends in zip(*EDGES, strict=True))
    crossed = (low >= threshold) != (high >= threshold)
    share = (threshold - low) / np.where(crossed, high - low, 1.0)
    return np.where(crossed, np.clip(share, NEAREST, 1 - NEAREST), 0.5)


def own_points(row: NDArray[np.intp], share: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places (x, y, z) of the voxels' own vertices, (n, 3, 3), in the voxel's unit cube; unused ones are 0.

    Parameters
    ----------
    row : (n,) intp
    share : (n, 12) float64
        Where the vertices stand on the voxel's edges: `crossings`, or 0.5 for the midpoints.
    """
    weights = tables().own_weights[row]  # (n, 3, 12)
    points = np.zeros((len(row), 3, 3))
    for edge, (low, _) in enumerate(EDGES):
        for axis in range(3):
            place = share[:, edge] if axis == edge // 4 else np.full(len(row), float(low >> axis & 1))
            points[:, :, axis] += weights[:, :, edge] * place[:, None]
    return points
