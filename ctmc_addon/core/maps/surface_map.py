# SPDX-License-Identifier: GPL-3.0-or-later
"""A map: values on the vertices of a surface with a unit, a range and a color ramp."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Bytes, Doubles, Floats
from ..mesh.rulers import distance_between
from ..mesh.triangle_mesh import TriangleMesh
from ..mesh.vectors import cross, dot
from .ramps import DIVERGING, colors_of

Point = tuple[float, float, float]
INNER = (1.0, 99.0)  # The colors cover the values between these percentiles.


class Limits(NamedTuple):
    """Limits of a map: the area below `low` or above `high` is counted; an infinite limit is ignored."""

    low: float = -math.inf
    high: float = math.inf


NO_LIMITS = Limits()


@dataclass(frozen=True)
class MapStatistics:
    """Numbers of a map; percentiles over the vertices, means and shares by area.

    Parameters
    ----------
    minimum, percentile_5, median, mean, percentile_95, maximum : float or None
        In the unit of the map; None without any value.
    share_without : float
        Share of the area without a value, 0 to 1.
    share_below, share_above : float or None
        Share of the area with a value that lies beyond the limits; None without that limit.
    """

    minimum: float | None
    percentile_5: float | None
    median: float | None
    mean: float | None
    percentile_95: float | None
    maximum: float | None
    share_without: float
    share_below: float | None = None
    share_above: float | None = None


@dataclass(frozen=True, eq=False)
class SurfaceMap:
    """Values on the vertices of a surface.

    Parameters
    ----------
    name : str
        Name of the attribute, column and property in files, such as thickness_mm.
    unit : str
    values : (V,) float32
        NaN for no value.
    range : (low, high) float
        Values of the first and the last color.
    ramp : str
        A key of `RAMPS`.
    statistics : MapStatistics
    limits : Limits
    nearest : (point, point), optional
        Nearest two points of the surface and of its target, RAS+ mm.
    notes : tuple of str
    """

    name: str
    unit: str
    values: Floats
    range: tuple[float, float]
    ramp: str
    statistics: MapStatistics
    limits: Limits = NO_LIMITS
    nearest: tuple[Point, Point] | None = None
    notes: tuple[str, ...] = ()

    @cached_property
    def colors(self) -> Bytes:
        """Color of every vertex, (V, 3) uint8 sRGB."""
        return colors_of(self.values, self.range, self.ramp)

    @property
    def nearest_distance(self) -> float | None:
        """Distance of the nearest two points, mm; 0 if the surfaces cross; None without such points."""
        return None if self.nearest is None else distance_between(*self.nearest)

    def about(self) -> dict[str, Any]:
        """Return all but the values as plain data for JSON."""
        low, high = (number if math.isfinite(number) else None for number in self.limits)
        return {
            "name": self.name,
            "unit": self.unit,
            "range": list(self.range),
            "ramp": self.ramp,
            "limits": [low, high],
            "nearest": None if self.nearest is None else [list(point) for point in self.nearest],
            "nearest_mm": self.nearest_distance,
        }


def vertex_areas(mesh: TriangleMesh) -> Doubles:
    """Return a third of the area of the triangles around each vertex, (V,) float64, in squares of the mesh's unit."""
    first, second, third = (mesh.vertices[mesh.faces[:, at]].T.astype(np.float64) for at in range(3))
    normals = cross(second - first, third - first)
    areas = np.sqrt(dot(normals, normals)) / 6
    count = len(mesh.vertices)
    shares = np.zeros(count)
    for at in range(3):
        shares += np.bincount(mesh.faces[:, at], areas, count)
    return shares


def statistics_of(values: Floats, areas: Doubles, limits: Limits = NO_LIMITS) -> MapStatistics:
    """Return the statistics of values, weighted by areas where `MapStatistics` says so.

    Parameters
    ----------
    values : (V,) float32
    areas : (V,) float64
        From `vertex_areas`.
    limits : Limits

    Examples
    --------
    >>> values = np.array([1, 2, 3, np.nan], np.float32)
    >>> statistics_of(values, np.array([1.0, 1, 2, 4]), Limits(low=1.5))
    MapStatistics(minimum=1.0, percentile_5=1.1, median=2.0, mean=2.25, percentile_95=2.9, maximum=3.0, \
share_without=0.5, share_below=0.25, share_above=None)
    """
    there = ~np.isnan(values)
    whole = float(areas.sum()) or 1.0
    finite, weights = values[there].astype(np.float64), areas[there]
    weight = float(weights.sum())
    without = 1.0 - weight / whole if len(values) else 1.0
    if not len(finite):
        return MapStatistics(None, None, None, None, None, None, 1.0)
    lowest, low, median, high, highest = (float(each) for each in np.percentile(finite, (0, 5, 50, 95, 100)))
    mean = float((finite * weights).sum() / weight) if weight else float(finite.mean())
    beyond = shares_beyond(values, areas, limits)
    return MapStatistics(lowest, low, median, mean, high, highest, max(0.0, without), *beyond)


def shares_beyond(values: Floats, areas: Doubles, limits: Limits) -> tuple[float | None, float | None]:
    """Return the shares of the area with a value that lie below and above limits; None without that limit.

    Parameters
    ----------
    values : (V,) float32
    areas : (V,) float64
    limits : Limits

    Examples
    --------
    >>> shares_beyond(np.array([1, 2, 3, np.nan], np.float32), np.array([1.0, 1, 2, 4]), Limits(1.5, 2.5))
    (0.25, 0.5)
    """
    there = ~np.isnan(values)
    finite, weights = values[there].astype(np.float64), areas[there]
    whole = float(weights.sum()) or 1.0
    below, above = (
        float(weights[outside].sum() / whole) if math.isfinite(limit) else None
        for limit, outside in ((limits.low, finite < limits.low), (limits.high, finite > limits.high))
    )
    return below, above


def range_of(values: Floats, ramp: str) -> tuple[float, float]:
    """Return a range of round numbers around nearly all values, with 0 in the middle for a diverging ramp.

    Examples
    --------
    >>> range_of(np.linspace(0.3, 7.7, 100).astype(np.float32), "viridis")
    (0.0, 8.0)
    >>> range_of(np.full(9, 7, np.float32), "magma"), range_of(np.zeros(9, np.float32), "light")
    ((0.0, 8.0), (0.0, 1.0))
    >>> range_of(np.array([-3.0, 1.0], np.float32), "coolwarm"), range_of(np.array([np.nan], np.float32), "magma")
    ((-3.0, 3.0), (0.0, 1.0))
    """
    finite = values[np.isfinite(values)]
    if not len(finite):
        return 0.0, 1.0
    low, high = (float(each) for each in np.percentile(finite, INNER))
    most = step_up(max(abs(low), abs(high)))
    if ramp in DIVERGING:
        return -most, most
    if low == high:  # All values are equal, as without simplification; 0 is the second end.
        return (-most, 0.0) if low < 0 else (0.0, most if low else 1.0)
    if low >= 0 and low < high / 2:
        return 0.0, step_up(high)
    step = step_up(max(high - low, abs(high) * 1e-6)) / 10
    return _rounded(math.floor(low / step) * step), _rounded(math.ceil(high / step) * step)


def step_up(value: float) -> float:
    """Return the smallest of 1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8 times a power of ten that is not below `value`.

    Examples
    --------
    >>> step_up(0.31), step_up(7.0)
    (0.4, 8.0)
    """
    power = float("1e" + f"{max(value, 1e-9):.15e}".partition("e")[2])
    steps = (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10)
    return _rounded(next(step * power for step in steps if step * power >= value * (1 - 1e-6)))


def _rounded(value: float) -> float:
    return float(f"{value:.6g}") + 0.0
