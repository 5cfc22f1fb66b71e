# SPDX-License-Identifier: GPL-3.0-or-later
"""Shapes with an exact distance everywhere: planes, round bars.

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
Plane = tuple[Point, float]  # Its normal of length 1, into the shape, and its height along that from the origin, mm.


class Shape(Protocol):
    """A shape in space."""

    @property
    def box(self) -> Box | None:
        """Box that holds it; None for one without end."""

    @property
    def planes(self) -> tuple[Plane, ...]:
        """Planes that its surface lies on."""

    def at(self, points: Doubles) -> Doubles:
        """Return the distance of points (3, n) to the shape's surface, (n,), positive inside."""


@dataclass(frozen=True)
class HalfSpace:
    """What lies on the side of a plane that the normal, of any length, points to."""

    point: Point
    normal: Point

    @property
    def unit(self) -> Doubles:
        """Normal of length 1, (3,)."""
        normal = np.array(self.normal, np.float64)
        return normal / np.sqrt(dot(normal, normal))

    @property
    def turned(self) -> HalfSpace:
        """What lies on the other side of the plane."""
        x, y, z = self.normal
        return HalfSpace(self.point, (-x, -y, -z))

    @property
    def box(self) -> None:
        """None: it has no end."""

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
        """None: it is round."""
        return ()

    def at(self, points: Doubles) -> Doubles:
        """Return the distance to a bar with half balls beyond both ends."""
        start, along = np.array(self.start)[:, None], np.subtract(self.end, self.start)[:, None]
        from_start = points - start
        share = np.clip(dot(from_start, along) / dot(along, along), 0.0, 1.0)
        off = from_start - share * along
        return self.radius - np.sqrt(dot(off, off))


@dataclass(frozen=True)
class Union:
    """What lies in any of several shapes."""

    shapes: Sequence[Shape]

    @property
    def box(self) -> Box | None:
        """Box that holds all of them."""
        boxes = [shape.box for shape in self.shapes]
        lows, highs = [box[0] for box in boxes if box is not None], [box[1] for box in boxes if box is not None]
        return (np.minimum.reduce(lows), np.maximum.reduce(highs)) if len(lows) == len(boxes) else None

    @property
    def planes(self) -> tuple[Plane, ...]:
        """Those of its shapes."""
        return tuple(plane for shape in self.shapes for plane in shape.planes)

    def at(self, points: Doubles) -> Doubles:
        """Return the distance outside, and a lower bound of it inside where shapes overlap."""
        out = self.shapes[0].at(points)
        for shape in self.shapes[1:]:
            np.maximum(out, shape.at(points), out=out)
        return out
