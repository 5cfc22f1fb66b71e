# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a mouse drags a handle in space, from the ray under it; world space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Ray = tuple[Sequence[float], Sequence[float]]
"""Origin and direction."""
ALONG_VIEW = 0.02  # Squared sine of the angle between axis and ray below which no place on the axis is told.


def place_on_axis(ray: Ray, point: NDArray[np.float64], axis: NDArray[np.float64]) -> float | None:
    """Return how far along an axis of length 1, from a point on it, the ray passes nearest; None along the view.

    Examples
    --------
    >>> place_on_axis(((0, -9, 4), (0, 1, 0)), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    4.0
    """
    origin, direction = _unit_ray(ray)
    cosine = float((direction * axis).sum())
    if 1.0 - cosine * cosine < ALONG_VIEW:
        return None
    way = point - origin
    return float(((direction * cosine - axis) * way).sum() / (1.0 - cosine * cosine))


def place_on_plane(ray: Ray, point: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return where the ray meets the plane through a point, (3,); None if it runs along the plane.

    Examples
    --------
    >>> place_on_plane(((1, -9, 4), (0, 1, 0)), np.zeros(3), np.array([0.0, 1.0, 0.0])).tolist()
    [1.0, 0.0, 4.0]
    """
    origin, direction = _unit_ray(ray)
    cosine = float((direction * normal).sum())
    if abs(cosine) < 1e-6:
        return None
    return np.asarray(origin + direction * (float(((point - origin) * normal).sum()) / cosine))


def _unit_ray(ray: Ray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    origin, direction = (np.array(each, np.float64) for each in ray)
    return origin, direction / np.sqrt((direction * direction).sum())
