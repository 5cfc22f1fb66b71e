# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes, areas and lengths for a person, in the unit that fits their size; files keep mm, mm2 and mm3.

A setting is said in mm, as flags and fields take it (`mm_text`); a place in mm, as finely as samples lie
(`position_text`). No other module writes a unit behind a number; `tests/core/measures/test_units.py` reads the sources.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from ..mesh.distance.surface_distance import OneWayDistance, SurfaceDistance

DIGITS = 4


class Unit(NamedTuple):
    """A unit, its size and the smallest number that is shown in it, both in mm, mm2 or mm3."""

    name: str
    size: float
    smallest: float


# The largest unit first.
UNITS = {
    "mm3": (Unit("ml", 1000.0, 1000.0), Unit("mm3", 1.0, 1e-3), Unit("um3", 1e-9, 0.0)),
    "mm2": (Unit("cm2", 100.0, 100.0), Unit("mm2", 1.0, 1e-3), Unit("um2", 1e-6, 0.0)),
    "mm": (Unit("mm", 1.0, 0.1), Unit("um", 1e-3, 0.0)),
}


def unit_of(number: float, unit: str) -> Unit:
    """Return the unit in which a number of mm, mm2 or mm3 is shown; 0 stays in that unit.

    Examples
    --------
    >>> unit_of(2500.0, "mm3").name, unit_of(0.02, "mm3").name, unit_of(2e-5, "mm3").name, unit_of(0.0, "mm3").name
    ('ml', 'mm3', 'um3', 'mm3')
    """
    if not number:
        return next(each for each in UNITS[unit] if each.name == unit)
    return next((each for each in UNITS[unit] if abs(number) >= each.smallest), UNITS[unit][-1])


def fitting_unit(numbers: Iterable[float], unit: str) -> Unit:
    """Return the one unit in which numbers are shown, by the largest of them; what is no size keeps its unit.

    Examples
    --------
    >>> fitting_unit([0.0004, -0.02], "mm").name, fitting_unit([0.0004], "Gy")
    ('um', Unit(name='Gy', size=1.0, smallest=0.0))
    """
    return unit_of(max(numbers, key=abs), unit) if unit in UNITS else Unit(unit, 1.0, 0.0)


def number_text(number: float, digits: int = DIGITS) -> str:
    """Return a number with a number of digits, and all digits before the point.

    No comma is between thousands, which half of the world reads as a decimal point.

    Examples
    --------
    >>> number_text(0.045678), number_text(45678.9), number_text(9999.9)
    ('0.04568', '45679', '10000')
    """
    return f"{number:.0f}" if abs(number) >= 10 ** (digits - 1) else f"{number:.{digits}g}"


def volume_text(volume_mm3: float, digits: int = DIGITS) -> str:
    """Return a volume in ml, in mm3 below 1 ml, or in um3 below 0.001 mm3.

    Examples
    --------
    >>> volume_text(12345.67), volume_text(999.5), volume_text(0.02), volume_text(2e-5)
    ('12.35 ml', '999.5 mm3', '0.02 mm3', '20000 um3')
    """
    return sizes_text((volume_mm3,), "mm3", digits)


def length_text(length_mm: float, digits: int = DIGITS) -> str:
    """Return a length in mm, or in um below 0.1 mm.

    Examples
    --------
    >>> length_text(432.1), length_text(0.1), length_text(0.01234, 3)
    ('432.1 mm', '0.1 mm', '12.3 um')
    """
    return sizes_text((length_mm,), "mm", digits)


def text_beside(number: float, neighbors: Iterable[float | None], unit: str) -> str:
    """Return a number of mm, mm2 or mm3 in the unit that fits the largest of it and its neighbors (None if unknown).

    Examples
    --------
    >>> text_beside(890.8, [3006.0], "mm3"), text_beside(0.0, [0.02, None], "mm3")
    ('0.8908 ml', '0 mm3')
    """
    fitting = fitting_unit([number, *(each for each in neighbors if each is not None)], unit)
    return f"{number_text(number / fitting.size)} {fitting.name}"


def sizes_text(numbers: Sequence[float], unit: str = "mm", digits: int = DIGITS) -> str:
    """Return numbers of mm, mm2 or mm3 in the one unit that fits the largest.

    Examples
    --------
    >>> sizes_text((12.0, 3.5, 0.02)), sizes_text((0.05, 0.02))
    ('12 x 3.5 x 0.02 mm', '50 x 20 um')
    >>> [sizes_text((area,), "mm2") for area in (12345.67, 55.5, 2e-4)]
    ['123.5 cm2', '55.5 mm2', '200 um2']
    """
    fitting = unit_of(max(numbers, key=abs), unit)
    return f"{' x '.join(number_text(number / fitting.size, digits) for number in numbers)} {fitting.name}"


def mm_text(length_mm: float, digits: int = 6) -> str:
    """Return a length in mm, as flags and fields take it.

    Examples
    --------
    >>> mm_text(0.02), mm_text(1.23456, 3)
    ('0.02 mm', '1.23 mm')
    """
    return f"{length_mm:.{digits}g} mm"


def spacing_text(spacing_mm: Iterable[float], digits: int = 4) -> str:
    """Return the sides of a voxel in mm, as `--spacing` takes them.

    Examples
    --------
    >>> spacing_text((0.7421875, 0.7421875, 5.0)), spacing_text((0.002, 0.002, 0.004))
    ('0.7422 x 0.7422 x 5 mm', '0.002 x 0.002 x 0.004 mm')
    """
    return f"{' x '.join(f'{side:.{digits}g}' for side in spacing_mm)} mm"


def position_text(place_mm: Iterable[float], between_mm: float, decimals: int = 1) -> str:
    """Return a place in mm with this many decimals, or more where samples lie closer.

    Parameters
    ----------
    place_mm : iterable of float
    between_mm : float
        Distance of two samples.
    decimals : int

    Examples
    --------
    >>> position_text((12.345, -0.04, 7.0), 0.7), position_text((0.0123, 0.0, 0.2), 0.004)
    ('12.3, 0.0, 7.0 mm', '0.012, 0.000, 0.200 mm')
    """
    exponent = int(f"{between_mm:e}".partition("e")[2])
    shown = max(decimals, -exponent)
    return f"{', '.join(f'{round(side, shown) + 0.0:.{shown}f}' for side in place_mm)} mm"


def percent_text(share: float) -> str:
    """Return a share from 0 to 1 in percent.

    Examples
    --------
    >>> percent_text(0.1234), percent_text(0.00012), percent_text(1.0), percent_text(0.0)
    ('12.3 %', '0.012 %', '100 %', '0 %')
    """
    return f"{100 * share:.3g} %"


def percent_change_text(percent: float) -> str:
    """Return a change in percent with its sign.

    Examples
    --------
    >>> percent_change_text(237.5), percent_change_text(-3.0)
    ('+237.5 %', '-3.0 %')
    """
    return f"{percent:+.1f} %"


def specks_text(count: int, volume_mm3: float) -> str:
    """Return how many small components simplification removed, and what they enclosed.

    Examples
    --------
    >>> specks_text(9204, 811.73), specks_text(1, 0.3)
    ('9,204 specks removed (812 mm3 in total)', '1 speck removed (0.3 mm3)')
    """
    volume = volume_text(float(f"{volume_mm3:.3g}"))
    return f"1 speck removed ({volume})" if count == 1 else f"{count:,} specks removed ({volume} in total)"


def one_way_text(way: OneWayDistance) -> str:
    """Return the largest distance of one way, with the one that 95 % stay within, in one unit.

    Examples
    --------
    >>> from ..mesh.distance.surface_distance import OneWayDistance
    >>> one_way_text(OneWayDistance(0.05, 0.194, 0.5824)), one_way_text(OneWayDistance(largest=0.0123))
    ('0.582 mm (95 %: 0.194)', '12.3 um (95 %: 0)')
    """
    unit = unit_of(way.largest, "mm")
    most, within = (number_text(number / unit.size, 3) for number in (way.largest, way.percentile_95))
    return f"{most} {unit.name} (95 %: {within})"


def distance_phrases(distance: SurfaceDistance) -> list[str]:
    """Return both ways of a distance in words, and the components that are not among them.

    Examples
    --------
    >>> from ..mesh.distance.surface_distance import LostComponents, OneWayDistance, SurfaceDistance
    >>> ways = OneWayDistance(0.05, 0.194, 0.5824), OneWayDistance(0.1, 0.39, 3.8)
    >>> for phrase in distance_phrases(SurfaceDistance(*ways, LostComponents(562, 1.9))):
    ...     print(phrase)
    to the full surface at most 0.582 mm (95 %: 0.194)
    from the full surface at most 3.8 mm (95 %: 0.39)
    562 specks removed (1.9 mm3 in total)
    """
    phrases = [
        f"to the full surface at most {one_way_text(distance.to_full)}",
        f"from the full surface at most {one_way_text(distance.from_full)}",
    ]
    lost = distance.lost
    return phrases + ([specks_text(lost.count, lost.volume)] if lost.count else [])
