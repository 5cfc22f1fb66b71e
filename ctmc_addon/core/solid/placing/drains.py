# SPDX-License-Identifier: GPL-3.0-or-later
"""Place the drains of a hollow: round holes from a cavity straight out through its wall.

A drain at a point goes the shortest way out, toward the nearest point of the outer surface. From a point in the wall it
first goes inward to the cavity. Two automatic drains go straight down from the lowest point of the largest cavity and
straight up from the highest; if that way passes through much more than the wall, as in a spike, they go the shortest
way out too.

Distances are in mm, positive inside; points are RAS+ mm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Doubles
from ...errors import SettingsError
from ...measures.units import mm_text
from ...mesh.distance.signed_distance import SignedSurface
from ...mesh.vectors import dot
from ...progress import Steps
from ..fields.depth import Depth
from ..fields.shapes import Bar, HalfSpace, Shape, Union
from ..request import Drain, Point, numbers_text
from .cubes import deepest_steps
from .hollows import Cavities, cavities_steps
from .outer import OuterSurfaces
from .rounding import place_text, placed, rounded_down, rounded_up

AUTO_DIAMETER_MM = 4.0
WALL_PER_DIAMETER = 2.0  # A hole this much deeper than wide is hard to clean.
STEP = 0.05  # Samples along a way through a wall are this share of the radius, or of a thinner wall, apart.
AT_SURFACE = 1e-3  # A point within this share of the radius from the surface lies on it.
WALL_PER_DEPTH = 2.1  # Suggest a wall that leaves a cavity slightly thicker than the wall.
MOST_SAMPLES = 4096
BEYOND = np.arange(1.0, 4.25, 0.25)  # Try to end a drain this far beyond the surface, in radii.
TOUCHING = 0.999  # A half ball is out of the wall at this share of its radius from the surface.
TOO_FAR = 3.0  # A way straight up or down is at most this many times as long as the wall is thick.
INWARD = (2.0, 1.5, 1.0, 0.5)  # Depths of a better point to suggest, as multiples of the depth where a drain begins.


@dataclass(frozen=True)
class PlacedDrains:
    """Drains of one solid.

    Parameters
    ----------
    bars : tuple of Bar
        Bars from inside a cavity to beyond the surface, to be subtracted.
    notes : tuple of str
        Sentences for the user.
    """

    bars: tuple[Bar, ...]
    notes: tuple[str, ...] = ()

    @property
    def shape(self) -> Shape:
        """Union of all drains, to be subtracted; there is at least one."""
        return Union(self.bars)


def auto_diameter(wall: float) -> float:
    """Return the diameter of automatic drains, mm: 4, or half of the wall if that is more.

    Powder and resin flow out of two holes of 4 mm, and a hole with that ratio can be cleaned.

    Examples
    --------
    >>> auto_diameter(2.0), auto_diameter(12.0)
    (4.0, 6.0)
    """
    return max(AUTO_DIAMETER_MM, wall / WALL_PER_DIAMETER)


def notes_at_cuts(bars: Sequence[Bar], planes: Sequence[HalfSpace]) -> list[str]:
    """Return notes on drains that meet a cut, where they become notches in the rims of both parts.

    Examples
    --------
    >>> cut, drain = HalfSpace((0.0, 0.0, 1.0), (0.0, 0.0, 1.0)), Bar((5.0, 0.0, 3.0), (9.0, 0.0, 3.0), 2.5)
    >>> notes_at_cuts([drain], [cut])
    ['The drain at 5 0 3 meets the cut at 0 0 1; move the cut along its normal by -0.5 mm.']
    """
    notes = []
    for bar in bars:
        ends = np.array([bar.start, bar.end]).T
        for plane in planes:
            low, high = sorted(plane.at(ends).tolist())
            up, down = high + bar.radius, bar.radius - low  # Moves that free the cut of the drain.
            if up > 0 and down > 0:
                where, cut = place_text(bar.start, bar.radius), numbers_text(plane.point)
                move = rounded_up(up, 2) if up < down else -rounded_up(down, 2)
                notes.append(
                    f"The drain at {where} meets the cut at {cut}; move the cut along its normal by {mm_text(move)}."
                )
    return notes


def drains_steps(
    drains: Sequence[Drain], surface: SignedSurface, depth: Depth, wall: float = 0.0, thicken: float = 0.0
) -> Steps[PlacedDrains]:
    """Place the drains of a solid.

    Parameters
    ----------
    drains : sequence of Drain
    surface : SignedSurface
        Closed surface of the structure.
    depth : Depth
        Depth below the surface of the thickened structure, before it is made hollow.
    wall : float
        Thickness of the wall of the hollow, mm; 0 if only existing cavities are opened.
    thicken : float
        Offset of the surface outward, mm.

    Returns
    -------
    PlacedDrains

    Raises
    ------
    SettingsError
        For a point outside or one that reaches no cavity, and for a wall that leaves no cavity.
    """
    outer = OuterSurfaces()
    yield from outer.prepare_steps(surface)
    vertices = surface.mesh.vertices
    box = [vertices.min(axis=0).astype(np.float64) - thicken, vertices.max(axis=0).astype(np.float64) + thicken]
    solid = _Solid(surface, outer, depth, wall, thicken, np.minimum(*box), np.maximum(*box))
    bars: list[Bar] = []
    notes: list[str] = []
    for drain in drains:
        if drain.point is None:
            added, sentences = yield from _auto_steps(drain.diameter / 2, solid)
            bars += added
            notes += sentences
        else:
            bars.append((yield from _given_steps(drain.point, drain.diameter / 2, solid)))
    return PlacedDrains(tuple(bars), tuple(notes))


@dataclass(frozen=True)
class _Solid:
    surface: SignedSurface
    outer: OuterSurfaces
    depth: Depth
    wall: float
    thicken: float
    low: Doubles
    high: Doubles

    def step(self, radius: float) -> float:
        """Return the distance between samples along a way for a drain with this radius."""
        return STEP * min(radius, self.wall or radius)

    def material_steps(self, points: Doubles) -> Steps[Doubles]:
        below = yield from self.depth(points)
        return np.minimum(below, self.wall - below) if self.wall else below


@dataclass(frozen=True)
class _Start:
    """A point, the direction out from it, the length to the surface, and the outer surface that it meets."""

    point: Doubles  # (3,)
    way: Doubles  # (3,)
    length: float
    outer: SignedSurface


def _given_steps(point: Point, radius: float, solid: _Solid) -> Steps[Bar]:
    """Place the drain at a point."""
    bar = yield from _from_point_steps(np.array(point, np.float64), radius, solid)
    if bar is not None:
        return bar
    place = np.array(point, np.float64)
    distance, face = yield from solid.surface.distances_steps(place[None], 1)
    outside = float(distance[0]) - solid.thicken
    remedy = yield from _remedy_steps(place, float(distance[0]), int(face[0]), radius, solid)
    where = f"a drain at {numbers_text(point)}"
    if outside >= 0:
        raise SettingsError(f"{where} lies {mm_text(outside, 3)} outside the surface; {remedy}")
    inner = f", whose wall is {mm_text(solid.wall)}" if solid.wall else ", which is not hollow"
    raise SettingsError(f"{where} reaches no cavity of the solid{inner}; {remedy}")


def _from_point_steps(point: Doubles, radius: float, solid: _Solid) -> Steps[Bar | None]:
    """Return the drain at a point, the shortest way out; None if it is outside or reaches no cavity."""
    surface = yield from solid.outer.around_steps(point, solid.thicken)
    if surface is None:
        return None
    start = yield from _start_steps(point, surface, solid.thicken, radius)
    before = yield from _to_cavity_steps(start, solid, radius)
    if before is None:
        return None
    return (yield from _bar_steps(start, before, radius, solid))


def _start_steps(point: Doubles, surface: SignedSurface, thicken: float, radius: float) -> Steps[_Start]:
    """Return the shortest way out through an outer surface that was moved outward."""
    distance, face = yield from surface.distances_steps(point[None], 1)
    nearest = surface.nearest_on(point[:, None], face)[:, 0]
    way = nearest - point if distance[0] < 0 else point - nearest
    length = float(np.sqrt(dot(way, way)))
    if length < AT_SURFACE * radius:
        way = _normal_of(surface, int(face[0]))
        length = float(np.sqrt(dot(way, way)))
    return _Start(point, way / length, thicken - float(distance[0]), surface)


def _to_cavity_steps(start: _Start, solid: _Solid, radius: float) -> Steps[float | None]:
    """Return how far before the point the axis begins inside the cavity; below 0 beyond it, None without a cavity."""
    longest = float((solid.high - solid.low).max())
    step = max(solid.step(radius), longest / MOST_SAMPLES)
    offsets = np.arange(max(2, math.ceil(longest / step))) * step
    column = start.point[:, None] - start.way[:, None] * offsets
    material = yield from solid.material_steps(column)
    distances, _ = yield from start.outer.distances_steps(column.T)
    inside = distances < solid.thicken
    open_places = np.flatnonzero((material <= 0) & inside)
    if not len(open_places) or not inside[: open_places[0]].all():
        return None
    first = int(open_places[0])
    return float(offsets[first]) + (step if first else 0.0)


def _bar_steps(start: _Start, before: float, radius: float, solid: _Solid) -> Steps[Bar]:
    """Return the bar from inside the cavity to where its half ball is out of the wall.

    As far as possible, the first half ball keeps out of the wall on the other side of the cavity.
    """
    begin = start.point - start.way * before
    room = max(0.0, -float((yield from solid.material_steps(begin[:, None]))[0]))
    begin = begin + start.way * min(room, max(0.0, radius - room))
    ends = start.point[:, None] + start.way[:, None] * (start.length + radius * BEYOND)
    distances, _ = yield from start.outer.distances_steps(ends.T, 1)
    out = np.flatnonzero(distances - solid.thicken >= radius * TOUCHING)
    end = ends[:, out[0] if len(out) else int(distances.argmax())]
    return Bar(_point(begin), _point(end), radius)


def _remedy_steps(point: Doubles, distance: float, face: int, radius: float, solid: _Solid) -> Steps[str]:
    """Return a point at which a drain works, near the given one or the deepest, or a different remedy."""
    nearest = solid.surface.nearest_on(point[:, None], np.array([face]))[:, 0]
    normal = _normal_of(solid.surface, face)
    inward = -normal / float(np.sqrt(dot(normal, normal)) or 1.0)
    start = nearest if distance - solid.thicken >= 0 else point
    for share in INWARD:
        better = np.array(placed((start + inward * (share * max(solid.wall, radius))).tolist(), radius))
        if (yield from _from_point_steps(better, radius, solid)) is not None:
            return f"give a point inside, such as {numbers_text(better.tolist())}"
    best, deepest = yield from deepest_steps(solid.depth, solid.low, solid.high)
    better = np.array(placed(best.tolist(), radius))
    if (yield from _from_point_steps(better, radius, solid)) is not None:
        return f"give a point inside, such as {numbers_text(better.tolist())}"
    if not solid.wall:
        return "add --hollow, or leave out the drain"
    return _thinner(deepest)


def _thinner(deepest: float) -> str:
    """Return the remedy for a wall that is too thick for a solid this deep."""
    if deepest <= 0:
        return "leave out --hollow"
    thinner = rounded_down(deepest / WALL_PER_DEPTH, 2)
    return (
        f"its deepest place lies {mm_text(deepest, 3)} below the surface: give a thinner wall, such as "
        f"--hollow {thinner:g}"
    )


def _auto_steps(radius: float, solid: _Solid) -> Steps[tuple[list[Bar], list[str]]]:
    """Place a drain at the lowest point of the largest cavity and one at the highest."""
    best, deepest = yield from deepest_steps(solid.depth, solid.low, solid.high)
    if deepest <= solid.wall:
        raise SettingsError(f"a wall of {mm_text(solid.wall)} leaves no cavity for --drain auto; {_thinner(deepest)}")
    cavities = yield from cavities_steps(solid.depth, solid.wall, solid.low, solid.high)
    if not cavities.points.shape[1]:
        cavities = Cavities(best[:, None], cavities.side, 0)
    bars, notes = [], []
    for up in (-1.0, 1.0):
        point = yield from _end_steps(cavities, up, radius, solid)
        around = yield from solid.outer.around_steps(point, solid.thicken)
        surface = around or solid.surface
        way = np.array([0.0, 0.0, up])
        length = yield from _straight_steps(point, way, surface, solid, TOO_FAR * solid.wall + cavities.side, radius)
        if length is None:
            start = yield from _start_steps(point, surface, solid.thicken, radius)
            place = "highest" if up > 0 else "lowest"
            notes.append(
                f"The drain at the {place} point takes the shortest way out; "
                "the straight way passes through more material."
            )
        else:
            start = _Start(point, way, length, surface)
        bars.append((yield from _bar_steps(start, 0.0, radius, solid)))
    if cavities.further:
        count = f"{cavities.further} other cavities have" if cavities.further > 1 else "1 other cavity has"
        notes.append(f"--drain auto opens the largest cavity; {count} no drain")
    return bars, notes


def _end_steps(cavities: Cavities, up: float, radius: float, solid: _Solid) -> Steps[Doubles]:
    """Return the lowest or highest point of a cavity, (3,); in a flat end, the middle of the widest part."""
    heights = cavities.points[2] * up
    end = cavities.points[:, heights > heights.max() - cavities.side / 2]
    inner = end - np.array([[0.0], [0.0], [up * radius]])
    room = np.minimum((yield from solid.depth(inner)), solid.wall + radius)
    end = end[:, room >= room.max() - cavities.side / 2]
    offsets = end - end.mean(axis=1, keepdims=True)
    return np.array(end[:, int(dot(offsets, offsets).argmin())])


def _straight_steps(
    point: Doubles, way: Doubles, surface: SignedSurface, solid: _Solid, longest: float, radius: float
) -> Steps[float | None]:
    """Return the length of the way from a point in a cavity out of the wall; None if it exceeds `longest`."""
    step = solid.step(radius)
    offsets = np.arange(math.ceil(longest / step) + 2) * step
    column = point[:, None] + way[:, None] * offsets
    distances, _ = yield from surface.distances_steps(column.T, 1)
    outside = np.flatnonzero(distances >= solid.thicken)
    return float(offsets[outside[0]]) if len(outside) else None


def _normal_of(surface: SignedSurface, face: int) -> Doubles:
    """Return the normal of a face, of any length, (3,)."""
    a, b, c = surface.mesh.vertices[surface.mesh.faces[face]].astype(np.float64)
    (ux, uy, uz), (vx, vy, vz) = (b - a).tolist(), (c - a).tolist()
    return np.array([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx])


def _point(values: Doubles) -> Point:
    x, y, z = values.tolist()
    return x, y, z
