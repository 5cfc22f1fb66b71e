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

from .case_table import EDGES, FACES, NEAREST, TriangleTables, case_triangles
from .trilinear_cases import Piece, ambiguous_faces, surface, tunnels

TIE = 2.0**-30  # share of a voxel's largest difference by which ties in its interior are lifted
INSIDE = np.array([[case >> corner & 1 for corner in range(8)] for case in range(256)], bool)
AROUND = np.array(FACES)
AMBIGUOUS = (
    (INSIDE[:, AROUND[:, 0]] == INSIDE[:, AROUND[:, 2]])
    & (INSIDE[:, AROUND[:, 1]] == INSIDE[:, AROUND[:, 3]])
    & (INSIDE[:, AROUND[:, 0]] != INSIDE[:, AROUND[:, 1]])
)
"""(256, 6) whether a face's corners are inside and outside in turn."""

FIRST_INSIDE, FIRST_OUTSIDE = (
    np.ascontiguousarray((AMBIGUOUS & (INSIDE[:, AROUND[:, 0]] == side)).T) for side in (True, False)
)
"""(6, 256) of these the faces whose first corner is inside, and outside."""

FACE_BITS = np.array([1 << face for face in range(6)], np.uint8)[:, None]

SIDE = np.ascontiguousarray(np.where(INSIDE, 1.0, -1.0).T)
"""(8, 256) 1 for inside corners, -1 for outside ones."""

NEEDS = AMBIGUOUS.any(axis=1)
"""(256,) whether a case has more than one surface: an ambiguous face, or two opposite corners alone."""
for corner in range(4):
    NEEDS[1 << corner | 128 >> corner] = NEEDS[255 - (1 << corner | 128 >> corner)] = True

SQUARE = (0, 1, 3, 2)  # the corners around the low face along z; the z edges rise from them


@dataclass(frozen=True, eq=False)
class Tables(TriangleTables):
    """Triangles of every surface a voxel may have: a row each, the 256 of `cases` first.

    Parameters
    ----------
    own_weights : (rows, 3, 12) float64
        The share that each edge's vertex has in the place of each own vertex, of which there are 0, 1 or 3.
    own_offset : (rows, 3, 3) float64
        Place of each own vertex if all edges' vertices stood at their edges' low corners.
    own_middle : (rows, 3, 3) float64
        Place of each own vertex if the edges' vertices stand at the edges' midpoints.
    row_of : (256 * 64, 9) int16
        Row of 64 times a case with a bit for each face whose inside corners are joined, and 1 + the number of its
        tunnel.
    may_tunnel : (256 * 64,) bool
        Whether there is a surface with a tunnel.
    """

    own_weights: NDArray[np.float64]
    own_offset: NDArray[np.float64]
    own_middle: NDArray[np.float64]
    row_of: NDArray[np.int16]
    may_tunnel: NDArray[np.bool_]


@cache
def tables() -> Tables:
    """The rows, made on first use."""
    rows: list[Piece] = [(case_triangles(case), ()) for case in range(256)]
    row_of = np.repeat(np.arange(256, dtype=np.int16), 64 * 9).reshape(-1, 9)
    for case in np.flatnonzero(NEEDS).tolist():
        faces = ambiguous_faces(case)
        for decisions in range(1 << len(faces)):
            joined = sum(1 << face for bit, face in enumerate(faces) if decisions >> bit & 1)
            if joined:
                row_of[case << 6 | joined] = len(rows)
                rows.append(surface(case, joined))
            for number, rims in tunnels(case, joined):
                row_of[case << 6 | joined, number + 1] = len(rows)
                rows.append(surface(case, joined, rims))
    count = np.array([len(triangles) for triangles, _ in rows], np.uint8)
    own_weights = np.zeros((len(rows), 3, 12))
    for row, (_, groups) in enumerate(rows):
        every = [edge for group in groups for edge in group]
        for number, group in enumerate(groups):
            own_weights[row, number, every] = 0.5 / len(every)
            own_weights[row, number, list(group)] += 0.5 / len(group)
    own_offset = np.zeros((len(rows), 3, 3))
    for edge, (low, _) in enumerate(EDGES):
        for axis in range(3):
            if low >> axis & 1:
                own_offset[:, :, axis] += own_weights[:, :, edge]
    return Tables(
        triangle_count=count,
        first_triangle=np.cumsum(count, dtype=np.intp) - count,
        triangle_edges=np.array([triangle for triangles, _ in rows for triangle in triangles], np.intp),
        own_count=np.array([len(groups) for _, groups in rows], np.uint8),
        own_weights=own_weights,
        own_offset=own_offset,
        own_middle=_moved(own_weights, own_offset, np.full(12, 0.5)),
        row_of=row_of,
        may_tunnel=(row_of[:, 1:] != row_of[:, :1]).any(axis=1),
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
    Ties, frequent with integer grey values, are decided as by a threshold a little lower: inside is
    ``value >= threshold``. A tie in a face joins the inside corners.

    Examples
    --------
    >>> corners = np.array([[1.0, -1, -1, -1, -1, -1, -1, 1], [4.0, -1, -1, -1, -1, -1, -1, 4]])
    >>> tables().own_count[resolve(corners, 0.0, np.array([129, 129], np.uint8))].tolist()
    [0, 3]
    """
    apart = np.abs(values.T - threshold)
    difference = SIDE.take(case, axis=1) * apart  # (8, n)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        decided = case.astype(np.intp) << 6 | _joined_faces(difference, case)
        row = tables().row_of[:, 0].take(decided).astype(np.intp)
        lifted = difference + TIE * apart.max(axis=0)
        some, z = _turns(lifted)
        may = tables().may_tunnel.take(decided.take(some))
        some, z = some[may], z[may]
        tunnel = _tunnel(lifted.take(some, axis=1), z, decided.take(some))
    row[some] = tables().row_of[decided.take(some), tunnel]
    return row


def _joined_faces(difference: NDArray[np.float64], case: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A bit for each ambiguous face whose inside corners are joined."""
    a, b, c, d = AROUND.T
    one, other = difference[a] * difference[c], difference[b] * difference[d]  # (6, n)
    join = (one >= other) & FIRST_INSIDE.take(case, axis=1)
    join |= (other >= one) & FIRST_OUTSIDE.take(case, axis=1)
    return np.bitwise_or.reduce(join * FACE_BITS, axis=0)


def _turns(difference: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Voxels in which the quadratic turns, and where: only there can a tunnel be."""
    low, high = difference[list(SQUARE)], difference[[corner | 4 for corner in SQUARE]]
    # With a, b, c, d around a slice, a c - b d is positive where a and c are joined: start + slope z + bend z z.
    start = low[0] * low[2] - low[1] * low[3]
    slope = (low[0] * high[2] + low[2] * high[0]) - (low[1] * high[3] + low[3] * high[1]) - 2 * start
    bend = (high[0] * high[2] - high[1] * high[3]) - start - slope
    z = -slope / (2 * bend)
    some = np.flatnonzero((z > 0) & (z < 1))
    return some, z[some]


def _tunnel(difference: NDArray[np.float64], z: NDArray[np.float64], decided: NDArray[np.intp]) -> NDArray[np.intp]:
    """1 + the number of the tunnel in `TUNNELS`, 0 where there is none at the height z where the quadratic turns."""
    low, high = difference[list(SQUARE)], difference[[corner | 4 for corner in SQUARE]]
    at = low + (high - low) * z  # (4, n)
    side = at >= 0
    turned = at[0] * at[2] - at[1] * at[3]
    joined_here = np.where(side[0], turned >= 0, turned <= 0)  # the inside edges, as below and above
    joined_below, joined_above = _joined_around(z, low, high, side, decided)
    found = (side[0] == side[2]) & (side[1] == side[3]) & (side[0] != side[1])
    found &= (joined_below == joined_above) & (joined_here != joined_below)
    # A corner of each joined edge: the end that is on the edge's side.
    end = (INSIDE.T[list(SQUARE)].take(decided >> 6, axis=1) != side).astype(np.intp)
    first, second = 2 * end[0] + end[2], 4 + 2 * end[1] + end[3]
    return np.where(found, 1 + np.where(turned > 0, first, second), 0)


def _joined_around(
    z: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    side: NDArray[np.bool_],
    decided: NDArray[np.intp],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether the inside edges are joined where slices cease to be ambiguous, below and above z.

    That is at a face of the voxel, or where an edge changes sides, which joins the other two.
    """
    zero = np.where((low >= 0) != (high >= 0), low / (low - high), np.nan)
    below, above = np.where(zero < z, zero, -np.inf), np.where(zero > z, zero, np.inf)
    each = np.arange(len(z))
    last, first = below.argmax(axis=0), above.argmin(axis=0)
    joined_below = np.where(np.isinf(below[last, each]), decided >> 4 & 1 != 0, ~side[last, each])
    joined_above = np.where(np.isinf(above[first, each]), decided >> 5 & 1 != 0, ~side[first, each])
    return joined_below, joined_above


def crossings(values: NDArray[np.float64], threshold: float) -> NDArray[np.float64]:
    """Where the threshold crosses the voxels' edges, (n, 12), as a share of the edge from its low corner.

    Edges that are not crossed, and those of a closed border, have 0.5.
    """
    low, high = (values.T[list(ends)] for ends in zip(*EDGES, strict=True))  # (12, n)
    crossed = (low >= threshold) != (high >= threshold)
    share = (threshold - low) / np.where(crossed, high - low, 1.0)
    return np.where(crossed, np.minimum(np.maximum(share, NEAREST), 1 - NEAREST), 0.5).T


def own_points(row: NDArray[np.intp], number: NDArray[np.intp], share: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places (x, y, z) of voxels' own vertices, (n, 3), in the voxel's unit cube.

    Parameters
    ----------
    row : (n,) intp
    number : (n,) intp
        Which of the voxel's own vertices: below `own_count`.
    share : (n, 12) float64
        Where the vertices stand on the voxel's edges: `crossings`.
    """
    return _moved(tables().own_weights[row, number], tables().own_offset[row, number], share)


def _moved(
    weights: NDArray[np.float64], offset: NDArray[np.float64], share: NDArray[np.float64]
) -> NDArray[np.float64]:
    moved = (weights * share).reshape(*offset.shape, 4)  # an axis has four edges
    points = offset.copy()
    for edge in range(4):
        points += moved[..., edge]
    return points
