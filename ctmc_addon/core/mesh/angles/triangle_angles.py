# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the quality of triangles for simulation: their smallest angle, and their radius ratio.

Angles are compared by their tangents, which take no more than the basic operations and so have the same bits on every
machine. A triangle without area has an angle of 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arithmetic import tangent
from ...arrays import Doubles

LIMITS_DEG = (5.0, 10.0)
"""Angles below which the share of the triangles is counted, degrees."""
# Radius ratios are counted in bins by the highest bits of their float32: each is a 4096th of an octave wide.
ONE_BITS, DROPPED_BITS, OCTAVES = 0x3F800000, 11, 64
BINS = OCTAVES << (23 - DROPPED_BITS)


@dataclass(frozen=True)
class TriangleQuality:
    """Quality of the triangles of a surface.

    Parameters
    ----------
    smallest_angle_deg : float
        The smallest of all angles, degrees; at most 60.
    below_5, below_10 : float
        Share of the triangles with an angle below 5 and below 10 degrees, from 0 to 1.
    median_radius_ratio : float
        Median over the triangles of the circumradius over twice the inradius: 1 is equilateral, larger is worse, and
        infinity has no area. It is VTK's and PyVista's `radius_ratio` (Stimpson et al. 2007, The Verdict Geometric
        Quality Library, SAND2007-1751). The lower of two middle values counts, rounded down by at most 0.025 %.
    """

    smallest_angle_deg: float
    below_5: float
    below_10: float
    median_radius_ratio: float


class QualitySums:
    """Counts of the triangles of a surface that comes in blocks; where it is cut decides nothing."""

    def __init__(self) -> None:
        self._tangent = math.inf
        self._below = [0] * len(LIMITS_DEG)
        self._bins = np.zeros(BINS, np.int64)

    def add(self, corners: Sequence[Doubles], vectors: Doubles) -> None:
        """Count triangles.

        Parameters
        ----------
        corners : three (n, 3) float64
        vectors : (n, 3) float64
            Vectors of length twice the area, as `face_vectors` returns them.
        """
        if not len(vectors):
            return
        doubled, squares = np.sqrt(squared_length(vectors)), squared_sides(corners)
        tangents = smallest_tangents(doubled, squares)
        self._tangent = min(self._tangent, float(tangents.min()))
        for at, degrees in enumerate(LIMITS_DEG):
            self._below[at] += int(np.count_nonzero(tangents < tangent(degrees)))
        bits = _radius_ratios(doubled, squares).astype(np.float32).view(np.int32)
        number = np.clip((bits - ONE_BITS) >> DROPPED_BITS, 0, BINS - 1)
        self._bins += np.bincount(number, minlength=BINS)

    def quality(self) -> TriangleQuality | None:
        """The quality of all triangles; None without any."""
        count = int(self._bins.sum())
        if not count:
            return None
        middle = int(np.searchsorted(np.cumsum(self._bins), (count + 1) // 2))
        edge = np.array((middle << DROPPED_BITS) + ONE_BITS, np.int32).view(np.float32)
        below_5, below_10 = (below / count for below in self._below)
        ratio = float(edge) if middle < BINS - 1 else math.inf
        return TriangleQuality(degrees_of(self._tangent), below_5, below_10, ratio)


def squared_length(vectors: NDArray[Any]) -> NDArray[Any]:
    """Return the squared length of vectors, (...,) from (..., 3)."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    return np.asarray(x * x + y * y + z * z)


def squared_sides(corners: Sequence[Doubles]) -> tuple[Doubles, Doubles, Doubles]:
    """Return the squared lengths of the sides of triangles, three (...,) from three corners (..., 3)."""
    a, b, c = corners
    return squared_length(b - a), squared_length(c - b), squared_length(a - c)


def doubled_areas(corners: Sequence[Doubles]) -> Doubles:
    """Return twice the area of triangles, (...,) from three corners (..., 3); the bits are those of `face_vectors`."""
    a, b, c = corners
    (ux, uy, uz), (vx, vy, vz) = (np.moveaxis(side - a, -1, 0) for side in (b, c))
    normal = np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], axis=-1)
    return np.asarray(np.sqrt(squared_length(normal)))


def smallest_tangents(doubled: Doubles, squares: Sequence[Doubles]) -> Doubles:
    """Return the tangent of the smallest angle of every triangle, from twice its area and its squared sides.

    The smallest angle faces the shortest side a: its tangent is 4 area / (b^2 + c^2 - a^2).

    Examples
    --------
    >>> corners = np.array([[[0.0, 0, 0]], [[2, 0, 0]], [[0, 1, 0]]])
    >>> smallest_tangents(doubled_areas(corners), squared_sides(corners))
    array([0.5])
    """
    first, second, third = squares
    shortest = np.minimum(np.minimum(first, second), third)
    twice = first + second + third - 2.0 * shortest
    return np.asarray(2.0 * doubled / np.where(twice > 0, twice, 1.0))


def _radius_ratios(doubled: Doubles, squares: Sequence[Doubles]) -> Doubles:
    """Return circumradius over twice the inradius, (...,): a b c (a + b + c) / (16 area^2); infinity without area.

    Examples
    --------
    >>> corners = np.array([[[0.0, 0, 0]], [[4, 0, 0]], [[0, 3, 0]]])
    >>> _radius_ratios(doubled_areas(corners), squared_sides(corners))
    array([1.25])
    """
    a, b, c = (np.sqrt(square) for square in squares)
    below = 4.0 * doubled * doubled
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ratio = a * b * c * (a + b + c) / below
    return np.where(below > 0, np.minimum(ratio, 1e38), 1e38)


def degrees_of(tangent: float) -> float:
    """Return the angle of a tangent, degrees."""
    return math.degrees(math.atan(tangent))
