# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the distance of two points, and the angle at the second of three."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .vectors import cross


def distance_between(start: ArrayLike, end: ArrayLike) -> float:
    """Return the distance of two points, in their unit.

    Examples
    --------
    >>> distance_between((0.0, 0.0, 0.0), (3.0, 4.0, 12.0))
    13.0
    """
    return _length(np.subtract(end, start, dtype=np.float64))


def angle_at(first: ArrayLike, corner: ArrayLike, last: ArrayLike) -> float:
    """Return the angle at `corner` between the other two points, 0 to 180 degrees; NaN where two are the same.

    By Kahan's formula, which is as exact for small angles and straight ones as for right ones.

    Examples
    --------
    >>> angle_at((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 2.0, 0.0))
    90.0
    """
    u, v = (np.subtract(point, corner, dtype=np.float64) for point in (first, last))
    lengths = _length(u), _length(v)
    if not min(lengths):
        return math.nan
    u, v = u / lengths[0], v / lengths[1]
    return math.degrees(2 * math.atan2(_length(u - v), _length(u + v)))


def _length(vector: NDArray[np.float64]) -> float:
    return math.sqrt(float((vector * vector).sum()))


def where_ray_hits(
    vertices: NDArray[np.float32], faces: NDArray[np.int32], start: NDArray[np.float64], along: NDArray[np.float64]
) -> float | None:
    """Return how many times `along` lies between the start of a ray and the first triangle that it meets, or None.

    Parameters
    ----------
    vertices : (V, 3) float32
    faces : (F, 3) int32
    start, along : (3,) float64

    Examples
    --------
    >>> corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    >>> where_ray_hits(corners, np.array([[0, 1, 2]], np.int32), np.array([0.25, 0.25, 3.0]), np.array([0, 0, -2.0]))
    1.5
    """
    # Seen along the ray, which is the point 0, only triangles whose box holds it can be met.
    side = np.zeros(3)
    side[np.abs(along).argmin()] = 1.0
    across = cross(along, side)
    axes = (across, cross(along, across))
    seen = [((vertices - start) * axis).sum(axis=1) for axis in axes]
    held = np.arange(len(faces))
    for heights in seen:
        for sign in (1, -1):
            a, b, c = (sign * heights[faces[held, corner]] for corner in range(3))
            held = held[(a <= 0) | (b <= 0) | (c <= 0)]
    ways = []
    for a, b, c in vertices[faces[held]].astype(np.float64):
        normal = cross(b - a, c - a)
        steepness = float((normal * along).sum())
        if steepness == 0.0:
            continue
        way = float((normal * (a - start)).sum()) / steepness
        point = start + way * along
        inside = [float((normal * cross(end - begin, point - begin)).sum()) for begin, end in ((a, b), (b, c), (c, a))]
        if way >= 0 and min(inside) >= 0:
            ways.append(way)
    return min(ways, default=None)
