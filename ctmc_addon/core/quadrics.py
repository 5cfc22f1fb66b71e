"""Quadric errors: how far a point is from the planes of many faces, and where it is least far.

A vertex carries the sum, over the faces it stands for, of the squared distance to each face's plane
times the face's area: `d A d + 2 g d + c` for a point that lies `d` away from the vertex. Kept about
the vertex's own position (not the origin) the ten numbers stay small beside each other, and float32
is enough. A quadric is (10, n): A as xx, xy, xz, yy, yz, zz; then g; then c.
Garland and Heckbert 1997, doi:10.1145/258734.258849.

Only + - * / in fixed order: the order of collapses hangs on these bits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

# A share of the trace added to A's diagonal: on flat ground, where the planes leave the point free to
# slide, it stays near the edge's midpoint, and elsewhere it hardly moves.
DAMPING = np.float32(1e-4)


def vertex_quadrics(positions: Floats, faces: NDArray[np.int32]) -> Floats:
    """Quadric of every vertex from its faces, each face given to its corners in equal parts.

    Parameters
    ----------
    positions : (3, V) float32
    faces : (3, F) int32

    Returns
    -------
    (10, V) float32
        g and c are zero: every plane passes through the vertex.
    """
    u = positions[:, faces[1]] - positions[:, faces[0]]  # (3, F)
    v = positions[:, faces[2]] - positions[:, faces[0]]
    normal = cross(u, v)
    length = np.sqrt(dot(normal, normal))
    length[length == 0] = 1.0  # a face without area has no plane, and weighs nothing
    weighted = normal / (np.float32(6.0) * length)  # a third of the area, times the unit normal's share

    quadrics = np.zeros((10, positions.shape[1]), np.float32)
    row = 0
    for i in range(3):
        for j in range(i, 3):
            share = weighted[i] * normal[j]
            total = np.zeros(positions.shape[1])
            for corner in faces:  # bincount adds in the order of the faces: the same bits everywhere
                total += np.bincount(corner, share, positions.shape[1])
            quadrics[row] = total
            row += 1
    return quadrics


def moved(quadric: Floats, step: Floats) -> Floats:
    """The same quadrics (10, n), expressed about points that lie `step` (3, n) away."""
    out = np.empty_like(quadric)
    out[:6] = quadric[:6]
    gradient = out[6:9]
    gradient[:] = times(quadric, step)
    gradient += quadric[6:9]
    out[9] = quadric[9] + dot(step, quadric[6:9] + gradient)
    return out


def best_step(quadric: Floats) -> Floats:
    """Step (3, n) from where the quadrics (10, n) are kept to their damped minimum.

    Solves `(A + DAMPING trace(A) I) d = -g` by L D L^T, which in float32 keeps the digits that the
    cofactors of a nearly flat A would lose.
    """
    xx, xy, xz, yy, yz, zz, gx, gy, gz, _ = quadric
    trace = xx + yy + zz
    scale = np.float32(1.0) / np.where(trace > 0, trace, np.float32(1.0))
    # Divided by the trace, the damping is a constant, and the first pivot is at least that.
    xx = xx * scale + DAMPING
    yy = yy * scale + DAMPING
    zz = zz * scale + DAMPING
    xy, xz, yz = xy * scale, xz * scale, yz * scale
    lower_yx = xy / xx
    lower_zx = xz / xx
    pivot_y = yy - lower_yx * xy
    off = yz - lower_zx * xy
    lower_zy = off / pivot_y
    pivot_z = zz - lower_zx * xz - lower_zy * off

    step = np.empty((3, quadric.shape[1]), np.float32)
    x = gx * -scale
    y = gy * -scale - lower_yx * x
    z = gz * -scale - lower_zx * x - lower_zy * y
    step[2] = z / pivot_z
    step[1] = y / pivot_y - lower_zy * step[2]
    step[0] = x / xx - lower_yx * step[1] - lower_zx * step[2]
    return step


def error(quadric: Floats, step: Floats) -> Floats:
    """Value of the quadrics (10, n) at `step` (3, n) from where they are kept, (n,)."""
    value = dot(step, quadric[6:9] + quadric[6:9] + times(quadric, step))
    value += quadric[9]
    return value


def times(quadric: Floats, step: Floats) -> Floats:
    """A d, (3, n)."""
    xx, xy, xz, yy, yz, zz = quadric[:6]
    x, y, z = step
    out = np.empty_like(step)
    out[0] = xx * x + xy * y + xz * z
    out[1] = xy * x + yy * y + yz * z
    out[2] = xz * x + yz * y + zz * z
    return out


def dot(u: NDArray[Any], v: NDArray[Any]) -> NDArray[Any]:
    """Dot products of the columns of two (3, n) arrays, (n,)."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def cross(u: NDArray[Any], v: NDArray[Any]) -> NDArray[Any]:
    """Cross products of the columns of two (3, n) arrays, (3, n)."""
    out = np.empty_like(u)
    out[0] = u[1] * v[2] - u[2] * v[1]
    out[1] = u[2] * v[0] - u[0] * v[2]
    out[2] = u[0] * v[1] - u[1] * v[0]
    return out
