# SPDX-License-Identifier: GPL-3.0-or-later
"""Decide exactly on which side of a plane or line a point lies, for float32 positions.

float64 decides where its result is larger than its rounding can be (the bounds of Shewchuk 1997,
doi:10.1007/PL00009321). The rest is computed with integers, since a float32 is an integer over a power of two. If the
float64 result is nearly 0, so is the integer. It then fits 64 bits even if its products do not, because these are wrong
only by multiples of 2^64. Python's integers are used for points that need more bits: those with a coordinate far
smaller than the distance to the other points.

All arrays are columns: (3, n) float64 that hold float32 values.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles, Signs

EPSILON = 2.0**-53
SIDE_ERROR = 8 * EPSILON  # Error per sum of the absolute products: (7 + 56 eps) eps, rounded up.
TURN_ERROR = 4 * EPSILON  # Error per sum of the absolute products: (3 + 16 eps) eps, rounded up.
WHOLE = 2.0**149  # Any float32 times this is a whole number, which float64 holds.
BITS = 36  # A difference of coordinates has this many bits, so that a doubtful volume is below 2^62.


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
    at = np.flatnonzero((np.abs(volume) <= SIDE_ERROR * size) & (size > 0))
    if len(at):
        out[at] = -_exact_signs([point[:, at] for point in (a, b, c, d)], _volumes)
    return out


def turns(a: Doubles, b: Doubles, c: Doubles) -> Signs:
    """Sign of the area of every triangle abc in the plane, (n,): 1 where it runs counter-clockwise; arrays (2, n)."""
    ux, uy = a - c
    vx, vy = b - c
    left, right = ux * vy, uy * vx
    area, size = left - right, np.abs(left) + np.abs(right)
    out = np.sign(area).astype(np.int8)
    at = np.flatnonzero((np.abs(area) <= TURN_ERROR * size) & (size > 0))
    if len(at):
        out[at] = _exact_signs([point[:, at] for point in (a, b, c)], _areas)
    return out


def _exact_signs(points: list[Doubles], value: Callable[..., Any]) -> Signs:
    """Signs of doubtful values of all but the last point from there, (n,)."""
    *leading, last = points
    _, exponent = np.frexp(np.maximum.reduce([np.abs(point - last) for point in leading]))
    # A factor for each axis changes no sign.
    scaled = [np.ldexp(point, BITS - exponent) for point in points]
    whole = np.logical_and.reduce([np.rint(point) == point for point in scaled]).all(axis=0)
    at = np.flatnonzero(whole)
    out = np.empty(len(whole), np.int8)
    origin = scaled[-1][:, at]
    out[at] = np.sign(value(*((point[:, at] - origin).astype(np.int64) for point in scaled[:-1])))
    for column in np.flatnonzero(~whole).tolist():
        place = _whole_numbers(last[:, column])
        number = value(*(np.subtract(_whole_numbers(point[:, column]), place) for point in leading))
        out[column] = (number > 0) - (number < 0)
    return out


def _volumes(u: NDArray[Any], v: NDArray[Any], w: NDArray[Any]) -> Any:
    """Six times the volumes that three vectors span; of whole numbers modulo 2^64."""
    (ux, uy, uz), (vx, vy, vz), (wx, wy, wz) = u, v, w
    return ux * (vy * wz - vz * wy) + uy * (vz * wx - vx * wz) + uz * (vx * wy - vy * wx)


def _areas(u: NDArray[Any], v: NDArray[Any]) -> Any:
    """Twice the areas that two vectors span; of whole numbers modulo 2^64."""
    return u[0] * v[1] - u[1] * v[0]


def _whole_numbers(point: Doubles) -> NDArray[Any]:
    return np.array([int(value) for value in (point * WHOLE).tolist()], object)
