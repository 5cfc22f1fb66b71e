# SPDX-License-Identifier: GPL-3.0-or-later
"""On which side of a plane or line a point lies, exactly, for float32 positions.

float64 decides where its result is larger than its rounding can be (the bounds of Shewchuk 1997,
doi:10.1007/PL00009321); the few others are worked out with whole numbers, as a float32 is one over a power of two.
All arrays stand in columns: (3, n) float64 that hold float32 values.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Doubles = NDArray[np.float64]
Signs = NDArray[np.int8]

EPSILON = 2.0**-53
SIDE_ERROR = 8 * EPSILON  # of the sum of the absolute products: (7 + 56 eps) eps, rounded up
TURN_ERROR = 4 * EPSILON  # (3 + 16 eps) eps, rounded up
WHOLE = 2.0**149  # times any float32 is a whole number, which float64 holds


def sides(a: Doubles, b: Doubles, c: Doubles, d: Doubles) -> Signs:
    """Sign of the volume of every tetrahedron abcd, (n,): 1 where abc runs counter-clockwise as d sees it.

    Examples
    --------
    >>> corners = np.eye(3)[:, :, None]
    >>> sides(*corners, np.ones((3, 1))), sides(*corners, np.array([[2.0], [-1.0], [0.0]]))
    (array([1], dtype=int8), array([0], dtype=int8))
    """
    ux, uy, uz = a - d
    vx, vy, vz = b - d
    wx, wy, wz = c - d
    x, x_back = vy * wz, vz * wy
    y, y_back = vz * wx, vx * wz
    z, z_back = vx * wy, vy * wx
    volume = ux * (x - x_back) + uy * (y - y_back) + uz * (z - z_back)
    size = np.abs(ux) * (np.abs(x) + np.abs(x_back))
    size += np.abs(uy) * (np.abs(y) + np.abs(y_back))
    size += np.abs(uz) * (np.abs(z) + np.abs(z_back))
    out = -np.sign(volume).astype(np.int8)
    # Where every product has an exact factor 0, the volume is exactly 0.
    for at in np.flatnonzero((np.abs(volume) <= SIDE_ERROR * size) & (size > 0)).tolist():
        out[at] = -_exact_volume_sign(*(_whole_numbers(point[:, at]) for point in (a, b, c, d)))
    return out


def turns(a: Doubles, b: Doubles, c: Doubles) -> Signs:
    """Sign of the area of every triangle abc in the plane, (n,): 1 where it runs counter-clockwise; arrays (2, n)."""
    ux, uy = a - c
    vx, vy = b - c
    one, other = ux * vy, uy * vx
    area, size = one - other, np.abs(one) + np.abs(other)
    out = np.sign(area).astype(np.int8)
    for at in np.flatnonzero((np.abs(area) <= TURN_ERROR * size) & (size > 0)).tolist():
        (ax, ay), (bx, by), (cx, cy) = (_whole_numbers(point[:, at]) for point in (a, b, c))
        out[at] = _sign((ax - cx) * (by - cy) - (ay - cy) * (bx - cx))
    return out


def _whole_numbers(point: Doubles) -> list[int]:
    return [int(value) for value in (point * WHOLE).tolist()]


def _exact_volume_sign(a: list[int], b: list[int], c: list[int], d: list[int]) -> int:
    (ux, uy, uz), (vx, vy, vz), (wx, wy, wz) = (
        [one - other for one, other in zip(p, d, strict=True)] for p in (a, b, c)
    )
    return _sign(ux * (vy * wz - vz * wy) + uy * (vz * wx - vx * wz) + uz * (vx * wy - vy * wx))


def _sign(number: int) -> int:
    return (number > 0) - (number < 0)
