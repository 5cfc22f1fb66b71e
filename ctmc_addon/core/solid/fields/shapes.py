# SPDX-License-Identifier: GPL-3.0-or-later
"""Shapes with an exact distance everywhere: half spaces and round bars.

Distances are in mm, positive inside. Points are (3, n) float64, RAS+ mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...arrays import Doubles
from ...mesh.vectors import dot
from ..request import Point

Box = tuple[Doubles, Doubles]  # Lowest and highest corner, (3,) each.
Plane = tuple[Point, float]  # The unit normal, into the shape, and the height above the origin along it, mm.


class Shape(Protocol):
    """A shape in space."""

    @property
    def box(self) -> Box | None:
        """Box that holds the shape; None if it is unbounded."""

    @property
    def planes(self) -> tuple[Plane, ...]:
        """Planes that the surface lies on."""

    def at(self, points: Doubles) -> Doubles:
        """Return the signed distance of points (3, n) to the surface, (n,), positive inside."""


@dataclass(frozen=True)
class HalfSpace:
    """The side of a plane that the normal, of any length, points to."""

    point: Point
    normal: Point

    @property
    def unit(self) -> Doubles:
        """Normal of length 1, (3,)."""
        normal = np.array(self.normal, np.float64)
        return normal / np.sqrt(dot(normal, normal))

    @property
    def turned(self) -> HalfSpace:
        """The other side of the plane."""
        x, y, z = self.normal
        return HalfSpace(self.point, (-x, -y, -z))

    @property
    def box(self) -> None:
        """None, because it is unbounded."""

    @property
    def planes(self) -> tuple[Plane, ...]:
        """Its plane."""
        x, y, z = self.unit.tolist()
        return (((x, y, z), float(dot(self.unit, np.array(self.point)))),)

    def at(self, points: Doubles) -> Doubles:
        """Return the height of points above the plane."""
        return np.asarray(dot(points - np.array(self.point)[:, None], self.unit[:, None]))


@dataclass(frozen=True)
class Bar:
    """A round bar.

    Parameters
    ----------
    start, end : (x, y, z) float
        Ends of its axis, RAS+ mm.
    radius : float
    """

    start: Point
    end: Point
    radius: float

    @property
    def box(self) -> Box:
        """Box that holds it."""
        both = np.array([self.start, self.end], np.float64)
        return both.min(axis=0) - self.radius, both.max(axis=0) + self.radius

    @property
    def planes(self) -> tuple[Plane, ...]:
        """Empty, because the surface is round."""
        return ()

    def at(self, points: Doubles) -> Doubles:
        """Return the signed distance to a bar with half balls beyond both ends."""
        start, along = np.array(self.start)[:, None], np.subtract(self.end, self.start)[:, None]
        from_start = points - start
        share = np.clip(dot(from_start, along) / dot(along, along), 0.0, 1.0)
        off = from_start - share * along
        return self.radius - np.sqrt(dot(off, off))


@dataclass(frozen=True)
class Union:
    """The union of shapes."""

    shapes: Sequence[Shape]

    @property
    def box(self) -> Box | None:
        """Box that holds all shapes; None if one is unbounded."""
        boxes = [shape.box for shape in self.shapes]
        lows, highs = [box[0] for box in boxes if box is not None], [box[1] for box in boxes if box is not None]
        return (np.minimum.reduce(lows), np.maximum.reduce(highs)) if len(lows) == len(boxes) else None

    @property
    def planes(self) -> tuple[Plane, ...]:
        """Planes of all shapes."""
        return tuple(plane for shape in self.shapes for plane in shape.planes)

    def at(self, points: Doubles) -> Doubles:
        """Return the signed distance; where shapes overlap, a lower bound of it inside."""
        out = self.shapes[0].at(points)
        for shape in self.shapes[1:]:
            np.maximum(out, shape.at(points), out=out)
        return out
