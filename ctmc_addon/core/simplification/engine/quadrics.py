# SPDX-License-Identifier: GPL-3.0-or-later
"""Quadric errors: how far a point is from the planes of many faces, and where it is least far.

The quadric of a vertex is the sum over its faces of the squared distance to the face's plane times a
third of the face's area. All these planes pass through the vertex, so for a point that lies `d` away it
is `d A d`, and six numbers are enough: A as xx, xy, xz, yy, yz, zz, an array (6, n). Kept about the
vertex itself, not the origin, they stay of one size, and float32 is enough.
Garland and Heckbert 1997, doi:10.1145/258734.258849; made again from the present faces, not
summed up from former ones, as in Lindstrom and Turk 1998, doi:10.1109/VISUAL.1998.745314: nearer to the
surface by a fifth.

Only + - * / in a fixed order: the order of collapses depends on these bits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arrays import Floats
from ...mesh.vectors import cross, dot
from ...progress import PAUSE, Steps

# A share of the trace added to A's diagonal: on flat ground, where the planes leave the point free to
# slide, it stays near the edge's midpoint, and elsewhere it hardly moves.
DAMPING = np.float32(1e-6)


def vertex_quadrics_steps(positions: Floats, faces: NDArray[np.int32]) -> Steps[Floats]:
    """Quadric of every vertex, (6, V) float32, from positions (3, V) and faces (3, F); yields now and then."""
    a, b, c = (np.take(positions, corner, axis=1) for corner in faces)
    yield PAUSE
    normal = cross(b - a, c - a)
    yield PAUSE
    length = np.sqrt(dot(normal, normal))
    length[length == 0] = 1.0  # a face without area has no plane, and weighs nothing
    yield PAUSE
    weighted = normal / (np.float32(6.0) * length)  # by twice the normal: a third of the area

    corners = faces.astype(np.intp)
    quadrics = np.empty((6, positions.shape[1]), np.float32)
    rows = iter(quadrics)
    for i in range(3):
        for j in range(i, 3):
            yield PAUSE
            share = (weighted[i] * normal[j]).astype(np.float64)
            total = np.zeros(positions.shape[1])
            for corner in corners:  # bincount adds in the order of the faces: the same bits everywhere
                total += np.bincount(corner, share, positions.shape[1])
            next(rows)[:] = total
    return quadrics


def face_quadrics(positions: Floats, faces: NDArray[np.int32] | NDArray[np.int64]) -> Floats:
    """Return the share of faces (3, f) in the quadric of each of their corners, (6, f)."""
    a, b, c = (np.take(positions, corner, axis=1) for corner in faces)
    return normal_quadrics(cross(b - a, c - a))


def normal_quadrics(normal: Floats) -> Floats:
    """Return the share of faces in the quadric of each corner, (6, f), from normals (3, f) of twice their areas."""
    length = np.sqrt(dot(normal, normal))
    length[length == 0] = 1.0
    weighted = normal / (np.float32(6.0) * length)
    out = np.empty((6, normal.shape[1]), np.float32)
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    for row, (i, j) in zip(out, pairs, strict=True):
        np.multiply(weighted[i], normal[j], out=row)
    return out


def renew_quadrics_steps(
    quadrics: Floats, positions: Floats, faces: NDArray[np.int32], moved: NDArray[np.bool_]
) -> Steps[None]:
    """Recompute the quadrics (6, V) of vertices that moved, (V,) bool, and of their neighbors."""
    around = np.zeros(len(moved), bool)
    around[faces[:, np.take(moved, faces).any(axis=0)]] = True
    faces = faces[:, np.take(around, faces).any(axis=0)]
    yield PAUSE
    rows = np.flatnonzero(around)
    number = np.zeros(len(moved), np.int32)  # of a row, from 1 on; 0 for all other vertices
    number[rows] = np.arange(1, len(rows) + 1, dtype=np.int32)
    index = np.take(number, faces).ravel()
    for row, share in zip(quadrics, face_quadrics(positions, faces), strict=True):
        row[rows] = np.bincount(index, np.tile(share, 3), len(rows) + 1)[1:]
        yield PAUSE


class EdgeQuadric(NamedTuple):
    """Sum of the quadrics of two vertices, about the middle between them: `d A d + 2 g d + c`."""

    matrix: Floats  # (6, n)
    gradient: Floats  # (3, n)
    constant: Floats  # (n,)


def edge_quadric(start: Floats, end: Floats, half: Floats) -> EdgeQuadric:
    """Quadric of edges from those of their ends, (6, n) each, and half the way from start to end, (3, n)."""
    matrix = start + end
    return EdgeQuadric(matrix, times(start - end, half), dot(half, times(matrix, half)))


def best_step(quadric: EdgeQuadric) -> Floats:
    """Step (3, n) from the middle of the edges to the least error.

    Solves `(A + DAMPING trace(A) I) d = -g` by L D L^T, which in float32 keeps the digits that the
    cofactors of a nearly flat A would lose, and once more for what the damping left over. The damping is also the
    least that a pivot can be; where rounding makes it 0, it is the damping.
    """
    xx, xy, xz, yy, yz, zz = quadric.matrix
    trace = xx + yy + zz
    trace[trace == 0] = 1.0
    # Divided by the trace, the damping is a constant, and the first pivot is at least that.
    scale = np.float32(1.0) / trace
    xx = xx * scale + DAMPING
    yy = yy * scale + DAMPING
    zz = zz * scale + DAMPING
    xy, xz, yz = xy * scale, xz * scale, yz * scale
    lower_yx = xy / xx
    lower_zx = xz / xx
    pivot_y = yy - lower_yx * xy
    pivot_y[pivot_y == 0] = DAMPING
    off = yz - lower_zx * xy
    lower_zy = off / pivot_y
    pivot_z = zz - lower_zx * xz - lower_zy * off
    pivot_z[pivot_z == 0] = DAMPING

    def solve(right: Floats) -> Floats:
        x, y, z = right
        y -= lower_yx * x
        z -= lower_zx * x
        z -= lower_zy * y
        z /= pivot_z
        y /= pivot_y
        y -= lower_zy * z
        x /= xx
        x -= lower_yx * y
        x -= lower_zx * z
        return right

    step = solve(quadric.gradient * -scale)
    step += solve((quadric.gradient + times(quadric.matrix, step)) * -scale)
    return step


def error(quadric: EdgeQuadric, step: Floats) -> Floats:
    """Value of the quadrics at `step` (3, n) from the middle of the edges, (n,)."""
    slope = times(quadric.matrix, step)
    slope += quadric.gradient
    slope += quadric.gradient
    return np.maximum(dot(step, slope) + quadric.constant, np.float32(0.0))


def times(matrix: Floats, step: Floats) -> Floats:
    """Return the matrices times the steps, (3, n): one symmetric matrix and one step a column."""
    xx, xy, xz, yy, yz, zz = matrix
    x, y, z = step
    out = np.empty_like(step)
    out[0] = xx * x + xy * y + xz * z
    out[1] = xy * x + yy * y + yz * z
    out[2] = xz * x + yz * y + zz * z
    return out
