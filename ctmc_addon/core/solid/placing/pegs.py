# SPDX-License-Identifier: GPL-3.0-or-later
"""Place the pegs of a cut where the section is thick enough for the peg, its hole and the walls around them.

A peg stands on part a, the side that the normal points to, and enters part b. Peg and hole share an axis that begins
inside part a. The half ball of the peg, which is smaller than that of the hole by the clearance, ends at its length.

Squares of the plane are divided repeatedly. The room at a point is its distance to everything that a hole must avoid;
between two points it changes by no more than they are apart, so squares without room are dropped early. Along an axis,
the room is sampled at a quarter of the needed room; between two samples it is at most 0.8 % less. Every length here is
a share of the peg or of the solid, so a solid of microns gets the same pegs as one of meters.

Distances are in mm, positive inside; points are (3, n) float64, RAS+ mm, and (2, n) in the plane.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles
from ...errors import SettingsError
from ...measures.units import mm_text
from ...mesh.distance.signed_distance import SignedSurface
from ...mesh.vectors import dot
from ...progress import PAUSE, Steps
from ..fields.depth import Depth
from ..fields.shapes import Bar, HalfSpace, Shape, Union
from ..request import Cut, Pegs, Point, numbers_text
from .rounding import place_text, rounded_down, step_of

MARGIN = 0.2  # Leave this many diameters of the peg as material around a hole.
FIRST_SQUARES = 16  # Begin with this many squares along the longer side of the section's box.
SIDE = 0.25  # Divide squares with a side above this share of the room that a peg needs.
LEAST_SIDE = 0.025  # Do not divide squares to a side below this share of that room.
ENOUGH = 256  # Stop dividing squares of at most `SIDE` once this many positions fit.
MOST_SQUARES = 40000  # Do not divide more squares than this.
POINTS_AT_ONCE = 1 << 18
SAMPLES = 4  # Take this many samples along an axis for each length of the needed room.
HALF_DIAGONAL = 0.7072
FARTHEST_ROUNDS = 4  # Move each of a few pegs at most this often to where it is farthest from the other pegs.
FEW = 8
REACH = 3.0  # Pegs in a hollow stay within this many needed rooms, and one more, of the surface.
LEAST_OFFERED = 0.2  # Do not suggest pegs thinner than this share of the requested diameter.


@dataclass(frozen=True)
class PlacedPegs:
    """Pegs of one cut.

    Parameters
    ----------
    pegs : Shape
        Shape to add to part a.
    holes : Shape
        Shape to subtract from part b, which pegs and drains placed later avoid.
    places : (n, 3) float64
        Points where the axes meet the plane, RAS+ mm.
    notes : tuple of str
        Sentences for the user.
    bars : tuple of Bar
        Bars of the pegs.
    """

    pegs: Shape
    holes: Shape
    places: Doubles
    notes: tuple[str, ...] = ()
    bars: tuple[Bar, ...] = ()


def placed_pegs_steps(
    cut: Cut,
    pegs: Pegs,
    depth: Depth,
    sides: Sequence[HalfSpace],
    extent: NDArray[Any],
    beyond: float = 0.0,
    avoid: Sequence[Shape] = (),
    is_hollow: bool = False,
) -> Steps[PlacedPegs]:
    """Place the pegs of one cut: the deepest first, each further one far from those before.

    Parameters
    ----------
    cut : Cut
    pegs : Pegs
    depth : Depth
        Depth below the surface of the solid.
    sides : sequence of HalfSpace
        Sides of all other cuts on which the pegs lie.
    extent : (n, 3)
        Points such as the vertices of a mesh; the solid lies within their hull, grown by `beyond` mm.
    beyond : float
    avoid : sequence of Shape
        Holes placed before, such as those of other cuts and drains.
    is_hollow : bool
        Whether pegs stay near the surface.

    Returns
    -------
    PlacedPegs
        Fewer pegs than requested if no more fit, with a note.

    Raises
    ------
    SettingsError
        If the plane misses the solid, or no peg of this size fits.
    """
    plane = _Plane.of(cut, extent, beyond)
    room = _Room(depth, sides, avoid, is_hollow)
    size = _Size.of(pegs)
    at, space = yield from _places_steps(plane, room, size)
    if not len(space):
        require_met(cut, extent, beyond)
        raise SettingsError((yield from _refusal_steps(cut, pegs, plane, room)))
    apart = pegs.diameter * (1 + MARGIN) + 2 * pegs.clearance
    selected = _selected(at, space, pegs.count, apart)
    yield PAUSE
    if len(selected) < pegs.count:
        at, space = yield from _places_steps(plane, room, size, math.inf)
        selected = _selected(at, space, pegs.count, apart)
    places = plane.points(at[:, selected])
    unit = plane.unit
    starts, ends = places + unit * size.root, places - unit * size.reach
    axes = list(zip(starts.T.tolist(), ends.T.tolist(), strict=True))
    bars = [Bar(_point(start), _point(end), pegs.diameter / 2) for start, end in axes]
    holes = [replace(bar, radius=bar.radius + pegs.clearance) for bar in bars]
    note = (
        f"Only {len(selected)} of {pegs.count} pegs fit on the cut at {numbers_text(cut.point)}; "
        "thinner pegs may leave room for more"
    )
    notes = (note,) if len(selected) < pegs.count else ()
    return PlacedPegs(Union(bars), Union(holes), np.ascontiguousarray(places.T), notes, tuple(bars))


def heights_of(cut: Cut, extent: NDArray[Any], beyond: float = 0.0) -> tuple[float, float]:
    """Return the least and the greatest height of points (n, 3) above the plane of a cut, widened by `beyond` mm."""
    low, high = _range_along(extent, cut.point, HalfSpace(cut.point, cut.normal).unit[:, None])
    return low - beyond, high + beyond


def require_met(cut: Cut, extent: NDArray[Any], beyond: float = 0.0) -> None:
    """Raise a `SettingsError` if the plane of a cut misses the hull of points (n, 3), grown by `beyond` mm."""
    low, high = heights_of(cut, extent, beyond)
    if low < 0 < high:
        return
    unit = HalfSpace(cut.point, cut.normal).unit
    middle = np.array(cut.point) + unit * ((low + high) / 2)
    raise SettingsError(
        f"the cut at {numbers_text(cut.point)} misses the structure, which lies {low:.3g} to {mm_text(high, 3)} along "
        f"its normal from there; move its point, such as to {place_text(middle.tolist(), (high - low) / 10)}"
    )


def bosses_steps(placed: PlacedPegs, pegs: Pegs, wall: float, surface: SignedSurface) -> Steps[Shape]:
    """Return the material in a hollow around pegs and holes and from there to the wall.

    Parameters
    ----------
    placed : PlacedPegs
    pegs : Pegs
    wall : float
        Thickness of the wall, mm.
    surface : SignedSurface
        Surface of the structure.
    """
    distances, faces = yield from surface.distances_steps(placed.places)
    ways = surface.nearest_on(np.ascontiguousarray(placed.places.T), faces).T - placed.places
    shares = np.clip(1.0 - wall / 2 / np.abs(distances), 0.01, 1.0)[:, None]
    radius = pegs.diameter / 2 + pegs.clearance + MARGIN * pegs.diameter
    ends = placed.places + shares * ways
    ribs = [
        Bar(_point(start), _point(end), radius)
        for start, end in zip(placed.places.tolist(), ends.tolist(), strict=True)
    ]
    return Union([*(replace(bar, radius=radius) for bar in placed.bars), *ribs])


@dataclass(frozen=True)
class _Size:
    """Size of a peg: its axis goes from `root` mm inside part a to `reach` mm inside part b, with `room` mm around."""

    root: float
    reach: float
    room: float

    @classmethod
    def of(cls, pegs: Pegs) -> _Size:
        radius = pegs.diameter / 2
        return cls(radius, pegs.length - radius, radius + pegs.clearance + MARGIN * pegs.diameter)

    def samples(self) -> list[float]:
        """Return the heights of samples on the axis above the plane, farthest from the plane first."""
        count = max(1, math.ceil((self.root + self.reach) * SAMPLES / self.room))
        heights = [self.root - (self.root + self.reach) * number / count for number in range(count + 1)]
        return sorted(heights, key=lambda height: -abs(height))


@dataclass(frozen=True)
class _Room:
    """Distance to everything that a hole avoids: the surface, other cuts, other holes, and the middle of a hollow."""

    depth: Depth
    sides: Sequence[HalfSpace]
    avoid: Sequence[Shape] = ()
    is_hollow: bool = False

    def at_steps(self, points: Doubles, needed: float) -> Steps[Doubles]:
        room = yield from self.depth(points)
        if self.is_hollow:
            room = np.minimum(room, (2 + REACH) * needed - room)
        for plane in self.sides:
            room = np.minimum(room, plane.at(points))
        for shape in self.avoid:
            room = np.minimum(room, -shape.at(points))
        return room


@dataclass(frozen=True)
class _Plane:
    """The plane of a cut with its own axes, and the box in it that holds the section."""

    origin: Doubles  # (3, 1)
    unit: Doubles  # (3, 1)
    axes: tuple[Doubles, Doubles]  # (3, 1) each
    middle: Doubles  # (2,)
    spans: Doubles  # (2,)

    @classmethod
    def of(cls, cut: Cut, extent: NDArray[Any], beyond: float) -> _Plane:
        unit = HalfSpace(cut.point, cut.normal).unit[:, None]
        origin = np.array(cut.point, np.float64)[:, None]
        axes = _plane_axes(unit)
        ranges = np.array([_range_along(extent, cut.point, axis) for axis in axes]) + np.array([-beyond, beyond])
        return cls(origin, unit, axes, ranges.mean(axis=1), ranges[:, 1] - ranges[:, 0])

    def points(self, at: Doubles) -> Doubles:
        """Return points of the plane (2, n) in space, (3, n)."""
        return self.origin + self.axes[0] * at[0] + self.axes[1] * at[1]

    def first_squares(self) -> tuple[Doubles, float]:
        """Return the middles (2, n) of squares that cover the box, and their side."""
        side = float(self.spans.max()) / FIRST_SQUARES
        counts = [max(1, math.ceil(span / side)) for span in self.spans.tolist()]
        rows = [(np.arange(count) - (count - 1) / 2) * side + at for count, at in zip(counts, self.middle, strict=True)]
        return np.stack([each.ravel() for each in np.meshgrid(*rows, indexing="ij")]), side


def _plane_axes(unit: Doubles) -> tuple[Doubles, Doubles]:
    """Return two unit vectors at right angles to a unit vector and to each other, (3, 1) each."""
    x, y, z = unit[:, 0].tolist()
    least = min(range(3), key=lambda axis: abs((x, y, z)[axis]))
    flat = [(0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)][least]
    first = np.array(flat)[:, None]
    first = first / np.sqrt(dot(first, first))
    (a, b, c) = first[:, 0].tolist()
    return first, np.array([y * c - z * b, z * a - x * c, x * b - y * a])[:, None]


def _range_along(points: NDArray[Any], origin: Point, unit: Doubles) -> tuple[float, float]:
    """Return the least and the greatest coordinate of points (n, 3) along a direction (3, 1) from an origin."""
    start = np.array(origin, np.float64)[:, None]
    blocks = range(0, len(points), POINTS_AT_ONCE)
    along = [dot(points[block : block + POINTS_AT_ONCE].T.astype(np.float64) - start, unit) for block in blocks]
    return float(min(each.min() for each in along)), float(max(each.max() for each in along))


def _places_steps(plane: _Plane, room: _Room, size: _Size, enough: float = ENOUGH) -> Steps[tuple[Doubles, Doubles]]:
    """Return positions where a peg fits, (2, n), and the room along its axis, (n,); any position if `enough` is 1."""
    at, side = plane.first_squares()
    positions = np.empty((2, 0)), np.empty(0)
    while True:
        bound = size.room - HALF_DIAGONAL * side
        space = np.full(at.shape[1], np.inf)
        for height in size.samples():
            if len(space):
                here = yield from room.at_steps(plane.points(at) + plane.unit * height, size.room)
                space = np.minimum(space, here)
                near = space >= bound
                at, space = at[:, near], space[near]
        fits = np.flatnonzero(space >= size.room)
        if len(fits):
            order = fits[np.lexsort(at[:, fits])]
            positions = at[:, order], space[order]
        is_fine = enough == 1 or side <= SIDE * size.room or 4 * len(space) > MOST_SQUARES
        if (len(fits) >= enough and is_fine) or not 0 < len(space) <= MOST_SQUARES or side / 2 < LEAST_SIDE * size.room:
            return positions
        at, side = _parted(at, side)


def _parted(at: Doubles, side: float) -> tuple[Doubles, float]:
    """Divide every square into four; return their middles and their side."""
    quarter = np.array([[-1, -1, 1, 1], [-1, 1, -1, 1]]) * (side / 4)
    return (at[:, :, None] + quarter[:, None]).reshape(2, -1), side / 2


def _selected(at: Doubles, space: Doubles, count: int, apart: float) -> list[int]:
    """Return the indices of up to `count` positions that are at least `apart`, the first of equals."""
    deepest = int(space.argmax())
    selected = _far_from_each_other(at, deepest, count, apart)
    if len(selected) < count:
        end = int(_squared(at, deepest).argmax())
        alternatives = [_far_from_each_other(at, end, count, apart), _close_to_each_other(at, end, count, apart)]
        selected = max([selected, *alternatives], key=len)
    if 1 < len(selected) <= FEW:
        _move_apart(at, selected)
    return selected


def _far_from_each_other(at: Doubles, first: int, count: int, apart: float) -> list[int]:
    """Return the indices of positions, each as far as possible from those before."""
    selected = [first]
    nearest = _squared(at, first)
    while len(selected) < count:
        farthest = int(nearest.argmax())
        if nearest[farthest] < apart * apart:
            break
        selected.append(farthest)
        np.minimum(nearest, _squared(at, farthest), out=nearest)
    return selected


def _close_to_each_other(at: Doubles, first: int, count: int, apart: float) -> list[int]:
    """Return the indices of positions, each as near as allowed to those before."""
    selected = [first]
    nearest = total = _squared(at, first)
    while len(selected) < count:
        free = np.flatnonzero(nearest >= apart * apart)
        if not len(free):
            break
        selected.append(int(free[total[free].argmin()]))
        more = _squared(at, selected[-1])
        nearest, total = np.minimum(nearest, more), total + more
    return selected


def _move_apart(at: Doubles, selected: list[int]) -> None:
    """Move each selected position in turn to where it is farthest from the rest, in place."""
    for _ in range(FARTHEST_ROUNDS):
        before = list(selected)
        for number in range(len(selected)):
            nearest = np.full(at.shape[1], np.inf)
            for rest in selected[:number] + selected[number + 1 :]:
                np.minimum(nearest, _squared(at, rest), out=nearest)
            farthest = int(nearest.argmax())
            if nearest[farthest] > nearest[selected[number]]:
                selected[number] = farthest
        if selected == before:
            return


def _squared(at: Doubles, number: int) -> Doubles:
    """Return the squared distances of all positions from one of them."""
    x, y = at[0] - at[0, number], at[1] - at[1, number]
    return x * x + y * y


def _refusal_steps(cut: Cut, pegs: Pegs, plane: _Plane, room: _Room) -> Steps[str]:
    """Return why no peg fits, with pegs that would fit."""
    where = f"the cut at {numbers_text(cut.point)}"
    nothing = _Size(0.0, 0.0, LEAST_OFFERED * pegs.diameter / 10)
    met = yield from _places_steps(plane, _Room(room.depth, room.sides), nothing, 1)
    if not len(met[1]):
        return f"{where} runs between the pieces of the structure and meets none of them; move its point"
    around = f"with {mm_text(MARGIN * pegs.diameter)} around it"
    asked = f"no peg of {mm_text(pegs.diameter)} and {mm_text(pegs.length)} length fits on {where} {around}"
    for is_shorter in (False, True):
        fits = yield from _largest_steps(pegs, is_shorter, plane, room)
        if fits is not None:
            offered = f"{fits.diameter:g} {fits.length:g}"
            return f"{asked}; give --peg-mm {offered} at most, or move the cut to where more is solid"
    least = mm_text(LEAST_OFFERED * pegs.diameter)
    return f"{asked}, nor does one of {least}; make pegs much smaller, move the cut, or leave out --pegs"


def _largest_steps(pegs: Pegs, is_shorter: bool, plane: _Plane, room: _Room) -> Steps[Pegs | None]:
    """Return the thickest pegs that fit, if `is_shorter` shortened in the same ratio; None if none fit."""
    step = step_of(pegs.diameter / 5, 2)
    fits, misses = 0, math.ceil(pegs.diameter / step - 1e-6)
    least = math.ceil(LEAST_OFFERED * pegs.diameter / step)
    fitting = None
    while misses - max(fits, least - 1) > 1:
        tried = (fits + misses) // 2 if fits else least
        diameter = float(f"{tried * step:.6g}")
        length = rounded_down(pegs.length * diameter / pegs.diameter) if is_shorter else pegs.length
        thinner = replace(pegs, diameter=diameter, length=max(length, diameter / 2))
        _, space = yield from _places_steps(plane, room, _Size.of(thinner), 1)
        if len(space):
            fits, fitting = tried, thinner
        elif fits:
            misses = tried
        else:
            break
    return fitting


def _point(values: Sequence[float]) -> Point:
    x, y, z = values
    return x, y, z
