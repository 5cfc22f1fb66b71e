# SPDX-License-Identifier: GPL-3.0-or-later
"""Make a flat foot below a part: a vertical prism around everything within the height of the foot, and wider.

Its outline has a side for each of `DIRECTIONS`, as far out as the part reaches there. It also reaches under the center
of mass of the part, so that the part stands. A drain whose axis would end in the foot is continued through it.

Distances are in mm, positive inside; points are (3, n) float64, RAS+ mm.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Doubles
from ...mesh.topology import FACES_PER_STEP
from ...mesh.triangle_mesh import TriangleMesh
from ...mesh.vectors import dot
from ...progress import PAUSE, Steps
from ..fields.lattice import Lattice
from ..fields.shapes import Bar, Box, Plane, Shape
from ..request import Point


def _directions() -> Doubles:
    """Return evenly spaced directions in the plane, (2, 64), without angles, so that bits are equal everywhere."""
    around = np.array([[1.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, -1.0]])
    for _ in range(4):
        between = around + np.roll(around, -1, axis=1)
        between /= np.sqrt(between[0] * between[0] + between[1] * between[1])
        around = np.stack([around, between], axis=2).reshape(2, -1)
    return around


DIRECTIONS = _directions()
LEVEL_GAP = 1 / 64  # A foot is lower or higher than its part by this many steps, so that their sides never coincide.
STEPS_UNDER_CENTER = 2.0  # The outline is this many steps beyond the center of mass, because rims lose up to one.


def outline_of(at: Doubles) -> Doubles:
    """Return how far points (2, n) reach along each direction, (64,)."""
    reach = np.full(DIRECTIONS.shape[1], -np.inf)
    for number, (x, y) in enumerate(DIRECTIONS.T.tolist()):
        reach[number] = (at[0] * x + at[1] * y).max(initial=-np.inf)
    return reach


@dataclass(frozen=True, eq=False)
class Foot:
    """A vertical prism.

    Parameters
    ----------
    reach : (64,) float64
        Distance of its sides from the origin along `DIRECTIONS`, mm.
    low, high : float
        Range along z.
    cell : float
        Height of a lattice cell, mm: for samples up to this far above the lower side, only that side counts, so that it
        is flat even in a foot of less than two steps.
    holes : sequence of Shape
        Holes to keep free.
    """

    reach: Doubles
    low: float
    high: float
    cell: float
    holes: Sequence[Shape] = ()

    @property
    def box(self) -> Box:
        """Box that holds it."""
        right, back, left, front = self.reach[:: len(self.reach) // 4].tolist()
        return np.array([-left, -front, self.low]), np.array([right, back, self.high])

    @property
    def planes(self) -> tuple[Plane, ...]:
        """Its lower and its upper side."""
        return ((0.0, 0.0, 1.0), self.low), ((0.0, 0.0, -1.0), -self.high)

    def at(self, points: Doubles) -> Doubles:
        """Return the signed distance; less near edges and holes."""
        above = points[2] - self.low
        out = np.where((above > 0) & (above <= self.cell), above, np.minimum(above, self.high - points[2]))
        for (x, y), reach in zip(DIRECTIONS.T.tolist(), self.reach.tolist(), strict=True):
            np.minimum(out, reach - (points[0] * x + points[1] * y), out=out)
        for hole in self.holes:
            np.minimum(out, -hole.at(points), out=out)
        return out

    def with_holes(self, bars: Iterable[Bar]) -> Foot:
        """Return the foot with holes that continue the bars that would end in it."""
        gone_on = [bar for bar in map(self._through, bars) if bar is not None]
        return Foot(self.reach, self.low, self.high, self.cell, gone_on)

    def _through(self, bar: Bar) -> Bar | None:
        """Return the rest of a bar, from its end to where its half ball leaves the foot; None if it has left it."""
        end, along = np.array(bar.end), np.subtract(bar.end, bar.start)
        along = along / np.sqrt(dot(along, along))
        (across_x, across_y), (x, y, z) = DIRECTIONS, end.tolist()
        room = np.append(self.reach - (across_x * x + across_y * y), [z - self.low, self.high - z])
        x, y, z = along.tolist()
        rate = np.append(across_x * x + across_y * y, [-z, z])
        out = rate > 0
        if (room <= -bar.radius).any() or not out.any():
            return None
        length = float(((room[out] + bar.radius) / rate[out]).min())
        x, y, z = (end + length * along).tolist()
        return Bar(bar.end, (x, y, z), bar.radius)


def foot_steps(mesh: TriangleMesh, center: Point, base: float, lattice: Lattice, is_single: bool) -> Steps[Foot]:
    """Make the foot of a part.

    Parameters
    ----------
    mesh : TriangleMesh
        The closed surface of the part, RAS+ mm.
    center : (x, y, z) float
        Its center of mass.
    base : float
        Height of the foot, and by how much it is wider than the part there, mm.
    lattice : Lattice
        A foot is at least as high as its step along z.
    is_single : bool
        Whether there is one structure, so that no foot of equal height lies below a second one.
    """
    scale = np.sqrt((lattice.affine[:3, :3] ** 2).sum(axis=0))
    steps = np.abs(lattice.affine[2, :3]) / scale * lattice.sides_mm
    step, cell = float(steps.max()), float(steps[0] + steps[1] + steps[2])
    low = float(mesh.vertices[:, 2].min()) - (LEVEL_GAP if is_single else -LEVEL_GAP) * step
    high = low + max(base, step)
    places = mesh.vertices[mesh.vertices[:, 2] <= high, :2].T.astype(np.float64)
    reach = np.maximum(outline_of(places), (yield from _crossing_steps(mesh, high)))
    under = outline_of(np.array(center[:2])[:, None]) + STEPS_UNDER_CENTER * max(lattice.sides_mm)
    return Foot(np.maximum(reach + base, under), low, high, cell)


def _crossing_steps(mesh: TriangleMesh, height: float) -> Steps[Doubles]:
    """Return how far the section of a mesh at a height reaches along each direction, (64,)."""
    reach = np.full(DIRECTIONS.shape[1], -np.inf)
    below = mesh.vertices[:, 2] <= height
    for start in range(0, len(mesh.faces), FACES_PER_STEP):
        faces = mesh.faces[start : start + FACES_PER_STEP]
        is_below = below[faces]
        faces = faces[is_below.any(axis=1) & ~is_below.all(axis=1)]
        for first, last in ((0, 1), (1, 2), (2, 0)):
            ends = faces[:, [first, last]]
            ends = ends[below[ends[:, 0]] != below[ends[:, 1]]]
            a, b = (mesh.vertices[ends[:, end]].T.astype(np.float64) for end in (0, 1))
            share = (height - a[2]) / (b[2] - a[2])
            reach = np.maximum(reach, outline_of(a[:2] + share * (b[:2] - a[:2])))
        yield PAUSE
    return reach
