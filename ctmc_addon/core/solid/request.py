# SPDX-License-Identifier: GPL-3.0-or-later
"""Requests for solids: what is done to the fields of structures before parts are extracted from them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from ..errors import SettingsError

Point = tuple[float, float, float]
LARGEST_MM = 1000.0
MOST_PEGS = 64
MOST_CUTS = 8


class Combining(Enum):
    """Ways to make one structure of several."""

    MERGE = "merge"
    SUBTRACT = "subtract"
    INTERSECT = "intersect"


@dataclass(frozen=True)
class Drain:
    """A round hole through a wall.

    Parameters
    ----------
    diameter : float
        Millimeters.
    point : (x, y, z) float, optional
        RAS+ mm, inside the cavity or the wall; None places two, at the lowest and the highest point.
    """

    diameter: float
    point: Point | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        _require_length("the diameter of a drain", self.diameter)
        _require_finite("the point of a drain", self.point or ())


@dataclass(frozen=True)
class Cut:
    """A plane that cuts in two.

    Parameters
    ----------
    point : (x, y, z) float
        RAS+ mm, on the plane.
    normal : (x, y, z) float
        Points to the side of part a; of any length but 0.
    """

    point: Point
    normal: Point

    def __post_init__(self) -> None:
        """Check the numbers."""
        _require_finite("the point of a cut", self.point)
        _require_finite("the normal of a cut", self.normal)
        if not any(self.normal):
            raise SettingsError("the normal of a cut is 0 0 0; give its direction, such as 0 0 1")


@dataclass(frozen=True)
class Pegs:
    """Pegs between the two sides of every cut.

    Parameters
    ----------
    count : int
        Pegs on each cut.
    diameter, length : float
        Of a peg, mm; the length is what stands out from the cut, its round end included.
    clearance : float
        Gap between a peg and its hole, mm.
    """

    count: int
    diameter: float = 5.0
    length: float = 5.0
    clearance: float = 0.2

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not 1 <= self.count <= MOST_PEGS:
            raise SettingsError(f"{self.count} pegs are not possible; give 1 to {MOST_PEGS}")
        _require_length("the diameter of a peg", self.diameter)
        _require_length("the length of a peg", self.length)
        if self.length < self.diameter / 2:
            raise SettingsError(
                f"a peg of {self.length:g} mm is shorter than its round end; give at least {self.diameter / 2:g} mm"
            )
        if not 0 <= self.clearance <= LARGEST_MM:
            raise SettingsError(f"a clearance of {self.clearance:g} mm is not possible; give 0 to {LARGEST_MM:g}")


@dataclass(frozen=True)
class Combination:
    """Several structures made one.

    Parameters
    ----------
    how : Combining
    name : str
        Of the new structure.
    of : tuple of str
        Names or numbers of the structures; those after the first are taken away from it by `Combining.SUBTRACT`.
    """

    how: Combining
    name: str
    of: tuple[str, ...]

    def __post_init__(self) -> None:
        """Check the names."""
        if not self.name or len(self.of) < 2 or not all(self.of):
            raise SettingsError(f"--{self.how.value} takes a name and two structures or more, such as both=left,right")


@dataclass(frozen=True)
class SolidRequest:
    """What to do to structures before they are extracted, in this order.

    Parameters
    ----------
    thicken : float
        Moves the surface outward, mm; inward where negative.
    hollow : float
        Leaves a wall of this thickness below the surface, mm; 0 leaves all.
    drains : tuple of Drain
    cuts : tuple of Cut
    pegs : Pegs, optional
        On every cut.
    combinations : tuple of Combination
    base : float
        Height of a flat foot below the lowest point, mm.
    least_wall : float
        Walls that are thinner are thickened to this, mm.
    bed : (x, y, z) float, optional
        Space of the printer, mm; parts that do not fit are told.

    Raises
    ------
    SettingsError
        For numbers that make no solid.
    """

    thicken: float = 0.0
    hollow: float = 0.0
    drains: tuple[Drain, ...] = ()
    cuts: tuple[Cut, ...] = ()
    pegs: Pegs | None = None
    combinations: tuple[Combination, ...] = ()
    base: float = 0.0
    least_wall: float = 0.0
    bed: Point | None = None

    def __post_init__(self) -> None:
        """Check numbers, and what needs something else."""
        if not abs(self.thicken) <= LARGEST_MM:
            raise SettingsError(f"--thicken takes -{LARGEST_MM:g} to {LARGEST_MM:g} mm, not {self.thicken:g}")
        for name, value in (("hollow", self.hollow), ("base", self.base), ("least-wall", self.least_wall)):
            if not 0 <= value <= LARGEST_MM:
                raise SettingsError(f"--{name} takes 0 to {LARGEST_MM:g} mm, not {value:g}")
        if self.pegs is not None and not self.cuts:
            raise SettingsError("pegs join the sides of a cut; add --cut")
        if len(self.cuts) > MOST_CUTS:
            raise SettingsError(f"{len(self.cuts)} cuts are too many; give at most {MOST_CUTS}")
        if any(drain.point is None for drain in self.drains) and not self.hollow:
            raise SettingsError("--drain auto opens a hollow; add --hollow, or give the point of the drain")
        if self.bed is not None and not all(0 < side < math.inf for side in self.bed):
            raise SettingsError(f"a bed of {_numbers(self.bed)} mm is not possible; give three sides above 0")

    def __bool__(self) -> bool:
        """Return whether the shape of any structure changes."""
        return bool(
            self.thicken or self.hollow or self.drains or self.cuts or self.combinations or self.base or self.least_wall
        )


def _require_length(name: str, value: float) -> None:
    if not 0 < value <= LARGEST_MM:
        raise SettingsError(f"{name} is above 0 and at most {LARGEST_MM:g} mm, not {value:g}")


def _require_finite(name: str, values: Iterable[float]) -> None:
    if not all(math.isfinite(value) for value in values):
        raise SettingsError(f"{name} is {_numbers(values)}; give three numbers, mm")


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{value:g}" for value in values)
