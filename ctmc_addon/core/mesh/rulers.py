# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the distance of two points, and the angle at the second of three."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray


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
