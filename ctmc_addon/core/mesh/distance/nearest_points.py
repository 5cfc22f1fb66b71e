# SPDX-License-Identifier: GPL-3.0-or-later
"""Nearest points of triangles, and of segments, to each other. Vectors are columns: a coordinate a row."""

from __future__ import annotations

import numpy as np

from ...arrays import Doubles, Flags, Indices
from ..vectors import cross, dot

FACE, EDGE, CORNER = (
    0,
    1,
    4,
)  # Parts of a triangle: its inside, the first of its edges ab, bc, ca, the first of a, b, c.


def nearest_points(points: Doubles, a: Doubles, b: Doubles, c: Doubles) -> tuple[Doubles, Indices]:
    """Return the point of each triangle abc that is nearest to its own point, (3, n), and the part it lies on, (n,).

    Parameters
    ----------
    points, a, b, c : (3, n) float64

    Examples
    --------
    >>> a, b, c = np.eye(3)[:, :, None]
    >>> nearest, part = nearest_points(np.array([[3.0], [0.0], [0.0]]), a, b, c)
    >>> nearest.ravel().tolist(), part.tolist()
    ([1.0, 0.0, 0.0], [4])
    """
    corners = (a, b, c)
    sides = (b - a, c - b, a - c)
    normal = cross(sides[0], sides[1])
    size = dot(normal, normal)
    inside = size > 0
    nearest, part, least = np.empty_like(points), np.full(points.shape[1], FACE), np.full(points.shape[1], np.inf)
    for number, (start, along) in enumerate(zip(corners, sides, strict=True)):
        offset = points - start
        inside &= dot(cross(along, offset), normal) >= 0
        length = dot(along, along)
        share = np.clip(dot(offset, along) / np.where(length > 0, length, 1), 0, 1)
        foot = np.where(share < 1, start + along * share, corners[(number + 1) % 3])
        squared = dot(points - foot, points - foot)
        nearer = squared < least
        least[nearer] = squared[nearer]
        nearest[:, nearer] = foot[:, nearer]
        on = np.where(share <= 0, CORNER + number, np.where(share < 1, EDGE + number, CORNER + (number + 1) % 3))
        part[nearer] = on[nearer]
    height = dot(points - a, normal) / np.where(inside, size, 1)
    nearest = np.where(inside, points - normal * height, nearest)
    part[inside] = FACE
    return nearest, part


def nearest_of_segments(p: Doubles, q: Doubles, r: Doubles, s: Doubles) -> tuple[Doubles, Doubles]:
    """Return the nearest points of the segments pq and rs, each (3, n) (Ericson, Real-Time Collision Detection, 5.1.9).

    Examples
    --------
    >>> p, q, r, s = np.array([[-1.0, 0, 0], [1, 0, 0], [0, -1, 2], [0, 1, 2]])[:, :, None]
    >>> [point.ravel().tolist() for point in nearest_of_segments(p, q, r, s)]
    [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]]
    """
    first, second, between = q - p, s - r, p - r
    a, e, f = dot(first, first), dot(second, second), dot(second, between)
    b, c = dot(first, second), dot(first, between)
    determinant = a * e - b * b
    one_a, one_e = np.where(a > 0, a, 1), np.where(e > 0, e, 1)
    skew = determinant > 1e-14 * a * e
    at = np.where(skew, np.clip((b * f - c * e) / np.where(skew, determinant, 1), 0, 1), 0)
    at_second = np.where(e > 0, (b * at + f) / one_e, 0)
    beyond = (at_second < 0) | (at_second > 1) | (e <= 0)
    at_second = np.clip(at_second, 0, 1)
    at = np.where(beyond, np.clip((b * at_second - c) / one_a, 0, 1), at)
    at = np.where(a > 0, at, 0)
    return p + first * at, r + second * at_second


def pierced(p: Doubles, q: Doubles, a: Doubles, b: Doubles, c: Doubles) -> tuple[Flags, Doubles]:
    """Return which segments pq pass through their triangle abc, (n,), and where, (3, n).

    Segments in the plane of their triangle do not; use their nearest points.
    """
    normal = cross(b - a, c - a)
    above, below = dot(p - a, normal), dot(q - a, normal)
    through = (above >= 0) & (below <= 0) | (above <= 0) & (below >= 0)
    drop = above - below
    through &= drop != 0
    at = p + (q - p) * (above / np.where(drop != 0, drop, 1))
    for start, end in ((a, b), (b, c), (c, a)):
        through &= dot(cross(end - start, at - start), normal) >= 0
    return through, at
