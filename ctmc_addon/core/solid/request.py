# SPDX-License-Identifier: GPL-3.0-or-later
"""Requests for solids: operations on the fields of structures before parts are extracted."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from enum import Enum
from typing import Any, TypeVar

from ..described import Described, descriptions, plain, setting
from ..errors import SettingsError
from ..measures.units import length_text, mm_text

Point = tuple[float, float, float]
LARGEST_MM = 1000.0
MOST_PEGS = 64
MOST_CUTS = 6
Item = TypeVar("Item")


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
        object.__setattr__(self, "diameter", _length("the diameter of a drain", self.diameter))
        if self.point is not None:
            object.__setattr__(self, "point", _point("the point of a drain", self.point))


@dataclass(frozen=True)
class Cut:
    """A plane that cuts structures in two.

    Parameters
    ----------
    point : (x, y, z) float
        RAS+ mm, on the plane.
    normal : (x, y, z) float
        Points to the side of part a; any length except 0.
    """

    point: Point
    normal: Point

    def __post_init__(self) -> None:
        """Check the numbers."""
        object.__setattr__(self, "point", _point("the point of a cut", self.point))
        object.__setattr__(self, "normal", _point("the normal of a cut", self.normal))
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
        Diameter of a peg, and its length beyond the cut including the round end, mm.
    clearance : float
        Gap between a peg and its hole, mm.
    """

    count: int
    diameter: float = 5.0
    length: float = 5.0
    clearance: float = 0.2

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (1 <= self.count <= MOST_PEGS and self.count == int(self.count)):
            raise SettingsError(f"{self.count:g} pegs on a cut are not possible; give 1 to {MOST_PEGS}")
        object.__setattr__(self, "count", int(self.count))
        object.__setattr__(self, "diameter", _length("the diameter of a peg", self.diameter))
        object.__setattr__(self, "length", _length("the length of a peg", self.length))
        object.__setattr__(self, "clearance", float(self.clearance))
        if self.length < self.diameter / 2:
            raise SettingsError(
                f"a peg of {mm_text(self.length)} is shorter than its round end; give it a length of at least "
                f"{mm_text(self.diameter / 2)}, or a smaller diameter"
            )
        if not 0 <= self.clearance <= LARGEST_MM:
            raise SettingsError(
                f"the clearance of a peg is from 0 to {mm_text(LARGEST_MM)}, not {self.clearance:g}; such as 0.2"
            )


@dataclass(frozen=True)
class Combination:
    """Several structures combined into one.

    Parameters
    ----------
    how : Combining
    name : str
        Name of the new structure.
    of : tuple of str
        Names or numbers of the structures; `Combining.SUBTRACT` subtracts the later ones from the first.
    """

    how: Combining
    name: str
    of: tuple[str, ...]

    def __post_init__(self) -> None:
        """Check the names."""
        object.__setattr__(self, "how", Combining(self.how))
        object.__setattr__(self, "of", tuple(map(str, self.of)))
        if not self.name or len(self.of) < 2 or not all(self.of):
            how = self.how.value
            raise SettingsError(f"{how} takes a name and two structures or more, such as {how} both=left,right")


@dataclass(frozen=True)
class SolidRequest(Described):
    """Operations on structures before parts are extracted.

    Parameters
    ----------
    drains : tuple of Drain
    cuts : tuple of Cut
    pegs : Pegs, optional
        Pegs on every cut.
    combinations : tuple of Combination

    Raises
    ------
    SettingsError
        For numbers that cannot make a solid.

    Examples
    --------
    >>> solid = SolidRequest(hollow=2, drains=(Drain(4),))
    >>> solid.to_dict()
    {'hollow': 2.0, 'drains': [{'diameter': 4.0}]}
    >>> SolidRequest.from_dict(solid.to_dict()) == solid
    True
    """

    thicken: float = setting(
        0.0,
        "Distance by which the surface moves outward, inward if negative. 0 = none",
        label="Thicken",
        caption=lambda length: f"thicken {length_text(length)}",
        unit="mm",
        low=-LARGEST_MM,
        high=LARGEST_MM,
    )
    hollow: float = setting(
        0.0,
        "Thickness of the wall below the surface; everything deeper becomes a cavity. 0 = not hollow",
        label="Hollow",
        caption=lambda length: f"hollow {length_text(length)}",
        unit="mm",
        low=0.0,
        high=LARGEST_MM,
    )
    drains: tuple[Drain, ...] = ()
    cuts: tuple[Cut, ...] = ()
    pegs: Pegs | None = None
    combinations: tuple[Combination, ...] = ()
    base: float = setting(
        0.0,
        "Height of a flat foot at the lowest point; the foot is wider than the part by the same length. 0 = none",
        label="Base",
        caption=lambda length: f"base {length_text(length)}",
        unit="mm",
        low=0.0,
        high=LARGEST_MM,
    )
    least_wall: float = setting(
        0.0,
        "Thickness to which thinner walls are thickened. 0 = none",
        label="Least Wall",
        caption=lambda length: f"least wall {length_text(length)}",
        unit="mm",
        low=0.0,
        high=LARGEST_MM,
    )
    bed: tuple[float, float, float] | None = setting(
        None,
        "Space of the printer along x, y and z; parts that do not fit are reported",
        label="Bed",
        unit="mm",
        low=0.0,
        low_open=True,
        size=3,
        start=(220.0, 220.0, 250.0),
        without="not checked",
    )

    def __post_init__(self) -> None:
        """Check numbers, and operations that need a second one."""
        super().__post_init__()
        for name in ("drains", "cuts", "combinations"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if self.pegs is not None and not self.cuts:
            raise SettingsError("pegs join the two sides of a cut; add a cut, or leave out the pegs")
        if len(self.cuts) > MOST_CUTS:
            raise SettingsError(f"{len(self.cuts)} cuts are too many; give at most {MOST_CUTS}")
        if any(drain.point is None for drain in self.drains) and not self.hollow:
            raise SettingsError(
                "a drain without a point opens a hollow; give the wall of a hollow above 0, or the point of the drain"
            )

    def __bool__(self) -> bool:
        """Return whether the shape of any structure changes."""
        return bool(self.drains or self.cuts or self.combinations or any(getattr(self, name) for name in LENGTHS))

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON, without fields at their default."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: _plain(value) for name, value in values.items() if value != getattr(_DEFAULT, name)}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> SolidRequest:
        """Return the request from the plain data of `to_dict`.

        Raises
        ------
        SettingsError
            For an unknown name, and for numbers that cannot make a solid.
        """
        names = [field.name for field in fields(cls)]
        unknown = sorted(set(values) - set(names))
        if unknown:
            raise SettingsError(f"a solid has no {unknown[0]!r}; it has {', '.join(names)}")
        own = dict(values)
        several: dict[str, Callable[..., Any]] = {"drains": Drain, "cuts": Cut, "combinations": Combination}
        for name, kind in several.items():
            if name in own:
                own[name] = tuple(_made(kind, each) for each in own[name])
        if own.get("pegs") is not None:
            own["pegs"] = _made(Pegs, own["pegs"])
        return cls(**own)


_DEFAULT = SolidRequest()
LENGTHS = tuple(name for name, about in descriptions(SolidRequest).items() if about.caption is not None)
"""Lengths that change the shape of every structure; flags, properties and texts are made from them."""


def _plain(value: Any) -> Any:
    if isinstance(value, (Drain, Cut, Pegs, Combination)):
        own = {name: each.value if isinstance(each, Enum) else plain(each) for name, each in asdict(value).items()}
        return {name: each for name, each in own.items() if each is not None}
    return [_plain(each) for each in value] if isinstance(value, tuple) else value


def _made(kind: Callable[..., Item], values: Mapping[str, Any]) -> Item:
    try:
        return kind(**values)
    except (TypeError, ValueError) as error:
        raise SettingsError(f"a solid cannot be made of {values!r} ({error}); see SolidRequest.to_dict") from error


def numbers_text(values: Iterable[float]) -> str:
    """Return numbers, such as a point's, as a command line takes them."""
    return " ".join(f"{value:g}" for value in values)


def require_different_cuts(cuts: Sequence[Cut]) -> None:
    """Raise a `SettingsError` if two cuts are the same plane, because no part lies between them."""
    for number, cut in enumerate(cuts):
        if any(_same_plane(cut, earlier) for earlier in cuts[:number]):
            raise SettingsError(
                f"the cut at {numbers_text(cut.point)} is given twice; leave one out, or move it by a millimeter"
            )


def _same_plane(first: Cut, second: Cut) -> bool:
    """Return whether two cuts are the same plane, to 0.01 mm and a thousandth of a radian."""
    normals = [_unit(cut.normal) for cut in (first, second)]
    cosine = sum(a * b for a, b in zip(*normals, strict=True))
    height = sum(a * (q - p) for a, p, q in zip(normals[0], first.point, second.point, strict=True))
    return abs(cosine) > 1 - 5e-7 and abs(height) < 0.01


def _unit(normal: Point) -> Point:
    length = math.sqrt(sum(each * each for each in normal))
    x, y, z = (each / length for each in normal)
    return x, y, z


def _length(name: str, value: float) -> float:
    if not 0 < value <= LARGEST_MM:
        raise SettingsError(f"{name} is above 0 and at most {mm_text(LARGEST_MM)}, not {value:g}")
    return float(value)


def _point(name: str, values: Iterable[float]) -> Point:
    """Return a point as floats; raise a `SettingsError` unless it has three finite numbers."""
    numbers = tuple(map(float, values))
    if len(numbers) != 3 or not all(map(math.isfinite, numbers)):
        raise SettingsError(f"{name} is {' '.join(f'{each:g}' for each in numbers)}; give three numbers, mm")
    return numbers[0], numbers[1], numbers[2]
