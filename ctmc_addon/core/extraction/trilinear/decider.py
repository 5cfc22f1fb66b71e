# SPDX-License-Identifier: GPL-3.0-or-later
"""Which of a case's surfaces the trilinear interpolant has: faces and interior decided from the gray values.

A face is decided by the sign of its bilinear interpolant at the saddle (the asymptotic decider): of the
two diagonals, the one with the larger product of differences from the threshold is connected. Both voxels at a
face multiply the same numbers, so they decide alike, ties included. Example: differences 2, -1, 3, -1 around a face:
2 * 3 > -1 * -1, so the two inside corners are connected.

In a slice of the voxel at height z the same rule says which of two opposite z edges are connected, and its
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

from ..case_table import EDGES, FACES, NEAREST, TriangleTables, case_triangles
from .cases import Piece, ambiguous_faces, surface, tunnels

TIE = 2.0**-30  # Lift ties in a voxel's interior by this share of its largest difference.
INSIDE = np.array([[case >> corner & 1 for corner in range(8)] for case in range(256)], bool)
FACE_CORNERS = np.array(FACES)
AMBIGUOUS = (
    (INSIDE[:, FACE_CORNERS[:, 0]] == INSIDE[:, FACE_CORNERS[:, 2]])
    & (INSIDE[:, FACE_CORNERS[:, 1]] == INSIDE[:, FACE_CORNERS[:, 3]])
    & (INSIDE[:, FACE_CORNERS[:, 0]] != INSIDE[:, FACE_CORNERS[:, 1]])
)
"""(256, 6) whether a face's corners are inside and outside in turn."""

FIRST_INSIDE, FIRST_OUTSIDE = (
    np.packbits(AMBIGUOUS & (INSIDE[:, FACE_CORNERS[:, 0]] == side), axis=1, bitorder="little")[:, 0]
    for side in (True, False)
)
"""(256,) a bit for each of these faces whose first corner is inside, and outside."""

INSIDE_OF_CORNER = np.ascontiguousarray(INSIDE.T)
"""(8, 256) whether a corner is inside in a case."""

NEEDS_DECISION = AMBIGUOUS.any(axis=1)
"""(256,) whether a case has more than one surface: an ambiguous face, or two opposite corners alone."""
for corner in range(4):
    NEEDS_DECISION[1 << corner | 128 >> corner] = NEEDS_DECISION[255 - (1 << corner | 128 >> corner)] = True

LOW_FACE_CORNERS = (0, 1, 3, 2)  # The corners around the low face along z; the z edges rise from them.


@dataclass(frozen=True, eq=False)
class _TrilinearTables(TriangleTables):
    """Triangles of every surface a voxel may have: its configurations, by number, the 256 classic cases first.

    Parameters
    ----------
    interior_weights : (configurations, 3, 12) float64
        The share that each edge's vertex has in the place of each vertex inside the voxel: there are 0, 1 or 3.
    interior_offset : (configurations, 3, 3) float64
        Place of each vertex inside if all edges' vertices stood at their edges' low corners.
    interior_middle : (configurations, 3, 3) float64
        Place of each vertex inside if the edges' vertices stand at the edges' midpoints.
    configuration_of : (256 * 64, 9) int16
        Configuration of 64 times a case with a bit for each face whose inside corners are connected, and 1 + the
        number of its tunnel.
    may_tunnel : (256 * 64,) bool
        Whether there is a surface with a tunnel.
    """

    interior_weights: NDArray[np.float64]
    interior_offset: NDArray[np.float64]
    interior_middle: NDArray[np.float64]
    configuration_of: NDArray[np.int16]
    may_tunnel: NDArray[np.bool_]


@cache
def trilinear_tables() -> _TrilinearTables:
    """The configurations, made on first use."""
    pieces: list[Piece] = [(case_triangles(case), ()) for case in range(256)]
    configuration_of = np.repeat(np.arange(256, dtype=np.int16), 64 * 9).reshape(-1, 9)
    for case in np.flatnonzero(NEEDS_DECISION).tolist():
        faces = ambiguous_faces(case)
        for decisions in range(1 << len(faces)):
            connected = sum(1 << face for bit, face in enumerate(faces) if decisions >> bit & 1)
            if connected:
                configuration_of[case << 6 | connected] = len(pieces)
                pieces.append(surface(case, connected))
            for number, rims in tunnels(case, connected):
                configuration_of[case << 6 | connected, number + 1] = len(pieces)
                pieces.append(surface(case, connected, rims))
    count = np.array([len(triangles) for triangles, _ in pieces], np.uint8)
    interior_weights = np.zeros((len(pieces), 3, 12))
    for configuration, (_, groups) in enumerate(pieces):
        edges = [edge for group in groups for edge in group]
        for number, group in enumerate(groups):
            interior_weights[configuration, number, edges] = 0.5 / len(edges)
            interior_weights[configuration, number, list(group)] += 0.5 / len(group)
    interior_offset = np.zeros((len(pieces), 3, 3))
    for edge, (low, _) in enumerate(EDGES):
        for axis in range(3):
            if low >> axis & 1:
                interior_offset[:, :, axis] += interior_weights[:, :, edge]
    return _TrilinearTables(
        triangle_count=count,
        first_triangle=np.cumsum(count, dtype=np.intp) - count,
        triangle_edges=np.array([triangle for triangles, _ in pieces for triangle in triangles], np.intp),
        interior_count=np.array([len(groups) for _, groups in pieces], np.uint8),
        interior_weights=interior_weights,
        interior_offset=interior_offset,
        interior_middle=_moved(interior_weights, interior_offset, np.full(12, 0.5)),
        configuration_of=configuration_of,
        may_tunnel=(configuration_of[:, 1:] != configuration_of[:, :1]).any(axis=1),
    )


def decide(values: NDArray[np.float64], threshold: float, case: NDArray[np.uint8]) -> NDArray[np.intp]:
    """Configuration of the trilinear interpolant's surface in every voxel, as numbered in `trilinear_tables`.

    Parameters
    ----------
    values : (n, 8) float64
        Gray values of the corners. A corner on the wrong side of the threshold for its case, as the
        outside samples of a closed border are, counts as mirrored to the other side.
    threshold : float
    case : (n,) uint8

    Returns
    -------
    (n,) intp

    Notes
    -----
    Ties, frequent with integer gray values, are decided as by a threshold a little lower: inside is
    ``value >= threshold``. A tie in a face connects the inside corners.

    Examples
    --------
    >>> corners = np.array([[1.0, -1, -1, -1, -1, -1, -1, 1], [4.0, -1, -1, -1, -1, -1, -1, 4]])
    >>> trilinear_tables().interior_count[decide(corners, 0.0, np.array([129, 129], np.uint8))].tolist()
    [0, 3]
    """
    number = case.astype(np.intp)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        difference = values.T - threshold  # (8, n)
        wrong = (difference >= 0) != INSIDE_OF_CORNER.take(number, axis=1)
        if wrong.any():
            np.negative(difference, out=difference, where=wrong)
        decided = number << 6 | _connected_faces(difference, number)
        configuration = trilinear_tables().configuration_of[:, 0].take(decided).astype(np.intp)
        voxel = np.flatnonzero(trilinear_tables().may_tunnel.take(decided))
        decided = decided.take(voxel)
        lifted = difference.take(voxel, axis=1)
        lifted += TIE * np.abs(lifted).max(axis=0)
        tunnel = _tunnel(lifted, decided)
    configuration[voxel] = trilinear_tables().configuration_of[decided, tunnel]
    return configuration


def _connected_faces(difference: NDArray[np.float64], case: NDArray[np.intp]) -> NDArray[np.uint8]:
    """Return a bit for each ambiguous face whose inside corners are connected."""
    first_connected, second_connected = np.zeros((2, len(case)), np.uint8)  # along the first diagonal, the second
    for face, (a, b, c, d) in enumerate(FACES):
        first, second = difference[a] * difference[c], difference[b] * difference[d]
        first_connected |= (first >= second).view(np.uint8) << np.uint8(face)
        second_connected |= (second >= first).view(np.uint8) << np.uint8(face)
    first_connected &= FIRST_INSIDE.take(case)
    second_connected &= FIRST_OUTSIDE.take(case)
    return first_connected | second_connected


def _tunnel(difference: NDArray[np.float64], decided: NDArray[np.intp]) -> NDArray[np.intp]:
    """1 + the number of the tunnel in `TUNNELS`, or 0 without one."""
    tunnel = np.zeros(len(decided), np.intp)
    low, high = difference[list(LOW_FACE_CORNERS)], difference[[corner | 4 for corner in LOW_FACE_CORNERS]]
    # With a, b, c, d around a slice, a c - b d is positive where a and c are connected: start + slope z + bend z z.
    start = low[0] * low[2] - low[1] * low[3]
    slope = (low[0] * high[2] + low[2] * high[0]) - (low[1] * high[3] + low[3] * high[1]) - 2 * start
    bend = (high[0] * high[2] - high[1] * high[3]) - start - slope
    z = -slope / (2 * bend)  # where it turns: only there can a tunnel be
    turning = np.flatnonzero((z > 0) & (z < 1))
    z, low, high = z.take(turning), low.take(turning, axis=1), high.take(turning, axis=1)
    at = low + (high - low) * z  # (4, n)
    side = at >= 0
    ambiguous = np.flatnonzero((side[0] == side[2]) & (side[1] == side[3]) & (side[0] != side[1]))
    z, side = z.take(ambiguous), side.take(ambiguous, axis=1)
    low, high, at = (each.take(ambiguous, axis=1) for each in (low, high, at))
    voxel = turning.take(ambiguous)
    decided = decided.take(voxel)
    turned = at[0] * at[2] - at[1] * at[3]
    connected_here = np.where(side[0], turned >= 0, turned <= 0)  # the inside edges, as below and above
    connected_below, connected_above = _connected_around(z, low, high, side, decided)
    # A corner of each connected edge: the end that is on the edge's side.
    end = (INSIDE.T[list(LOW_FACE_CORNERS)].take(decided >> 6, axis=1) != side).astype(np.intp)
    first, second = 2 * end[0] + end[2], 4 + 2 * end[1] + end[3]
    is_tunnel = (connected_below == connected_above) & (connected_here != connected_below)
    tunnel[voxel] = np.where(is_tunnel, 1 + np.where(turned > 0, first, second), 0)
    return tunnel


def _connected_around(
    z: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    side: NDArray[np.bool_],
    decided: NDArray[np.intp],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return whether the inside edges are connected where slices cease to be ambiguous, below and above z.

    That is at a face of the voxel, or where an edge changes sides, which connects the other two.
    """
    zero = np.where((low >= 0) != (high >= 0), low / (low - high), np.nan)
    below, above = np.where(zero < z, zero, -np.inf), np.where(zero > z, zero, np.inf)
    each = np.arange(len(z))
    last, first = below.argmax(axis=0), above.argmin(axis=0)
    connected_below = np.where(np.isinf(below[last, each]), decided >> 4 & 1 != 0, ~side[last, each])
    connected_above = np.where(np.isinf(above[first, each]), decided >> 5 & 1 != 0, ~side[first, each])
    return connected_below, connected_above


def crossings(values: NDArray[np.float64], threshold: float) -> NDArray[np.float64]:
    """Return the threshold's crossings of the voxels' edges, (n, 12), as shares of the edge from its low corner.

    Edges that are not crossed, and those of a closed border, have 0.5.
    """
    low, high = (values.T[list(ends)] for ends in zip(*EDGES, strict=True))  # (12, n)
    crossed = (low >= threshold) != (high >= threshold)
    share = (threshold - low) / np.where(crossed, high - low, 1.0)
    return np.where(crossed, np.minimum(np.maximum(share, NEAREST), 1 - NEAREST), 0.5).T


def interior_points(
    configuration: NDArray[np.intp], number: NDArray[np.intp], share: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Places (x, y, z) of vertices inside voxels, (n, 3), in the voxel's unit cube.

    Parameters
    ----------
    configuration : (n,) intp
    number : (n,) intp
        Number of the vertex inside the voxel, below `interior_count`.
    share : (n, 12) float64
        Positions of the vertices on the voxel's edges: `crossings`.
    """
    tables = trilinear_tables()
    return _moved(tables.interior_weights[configuration, number], tables.interior_offset[configuration, number], share)


def _moved(
    weights: NDArray[np.float64], offset: NDArray[np.float64], share: NDArray[np.float64]
) -> NDArray[np.float64]:
    moved = (weights * share).reshape(*offset.shape, 4)  # an axis has four edges
    points = offset.copy()
    for edge in range(4):
        points += moved[..., edge]
    return points
