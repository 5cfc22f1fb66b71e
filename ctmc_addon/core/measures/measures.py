# SPDX-License-Identifier: GPL-3.0-or-later
"""The measures of a finished surface: their names, units, and where each is shown.

Keys of reports, columns of tables, lines of the panel and of the terminal are made from `MEASURES`, so a new measure is
one entry here and appears in all of them. Files keep mm, mm2 and mm3; a person reads the unit that fits (`units.py`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

from ..volume.value_kind import ValueKind
from .finished_surface import FinishedSurface as FinishedSurface
from .measure_type import GY as GY, HU as HU, UNKNOWN as UNKNOWN, Measure as Measure, Place as Place
from .units import Unit, fitting_unit, length_text, number_text, one_way_text, percent_text, sizes_text, volume_text

_TERMINAL = Place.TERMINAL | Place.SURFACES
_BATCH = Place.BATCH | Place.LABELS | Place.PAGE
_DISTANCE_TEXT = partial(length_text, digits=3)


def _collapsed_text(collapsed: Mapping[str, float]) -> str:
    volume = f" ({volume_text(collapsed['mm3'], 3)})" if collapsed["count"] else ""
    return f"{collapsed['count']:,}{volume}"


def _way_text(way: Mapping[str, float]) -> str:
    from ..mesh.distance.surface_distance import OneWayDistance

    return one_way_text(OneWayDistance(**way))


MEASURES = (
    Measure(
        "faces",
        "Triangles",
        of="measures.faces",
        where=Place.REPORT | _TERMINAL | Place.PANEL | _BATCH | Place.TOTALS | Place.LINE,
        summed="sum",
    ),
    Measure("vertices", "Vertices", of="measures.vertices", where=Place.REPORT, summed="sum"),
    Measure("full_faces", "Triangles Before Simplification", of="full_faces", where=Place.REPORT, summed="sum"),
    Measure("mean_distance_mm", "Mean Distance", "mm", of="distance.mean", where=Place.PANEL, shown=_DISTANCE_TEXT),
    Measure(
        "to_full_mm",
        "To Full Surface",
        of="distance.to_full",
        where=Place.PANEL,
        shown=_way_text,
        columns={"to_full_largest_mm": "largest", "to_full_95_mm": "percentile_95"},
    ),
    Measure(
        "from_full_mm",
        "From Full Surface",
        of="distance.from_full",
        where=Place.PANEL,
        shown=_way_text,
        columns={"from_full_largest_mm": "largest", "from_full_95_mm": "percentile_95"},
    ),
    Measure(
        "volume_mm3",
        "Volume",
        "mm3",
        of="measures.enclosed_volume",
        where=Place.REPORT | _TERMINAL | Place.TABLE | Place.PANEL | _BATCH | Place.TOTALS | Place.LINE,
    ),
    Measure(
        "area_mm2",
        "Area",
        "mm2",
        of="measures.area",
        where=Place.REPORT | _TERMINAL | Place.TABLE | Place.PANEL | _BATCH | Place.TOTALS,
        summed="sum",
    ),
    Measure("closed", "Closed", of="measures.closed", where=Place.REPORT | Place.TERMINAL | _BATCH, summed="all"),
    Measure("euler", "Euler Number", of="measures.euler", where=Place.REPORT | Place.TERMINAL, summed="sum"),
    Measure(
        "components",
        "Components",
        of="measures.bodies",
        where=Place.REPORT | _TERMINAL | Place.TABLE | _BATCH | Place.TOTALS,
        summed="sum",
    ),
    # The name in reports of 0.2, with the walls of cavities.
    Measure("parts", "Components", of="measures.components", where=Place.REPORT, summed="sum"),
    Measure(
        "removed_components",
        "Removed Components",
        of="removed_components",
        where=Place.REPORT | Place.BATCH,
        summed="sum",
    ),
    Measure(
        "collapsed_components",
        "Specks Removed",
        of="collapsed_components",
        where=Place.REPORT | Place.BATCH | Place.PANEL,
        summed="sum",
        shown=_collapsed_text,
        columns={"collapsed_components": "count", "collapsed_mm3": "mm3"},
    ),
    Measure(
        "self_intersections",
        "Self-Intersections",
        of="self_intersections",
        where=Place.REPORT | Place.PANEL | _BATCH | Place.LINE,
        summed="sum",
    ),
    Measure(
        "smallest_angle_deg", "Smallest Angle", "deg", of="measures.quality.smallest_angle_deg", where=Place.REPORT
    ),
    Measure("below_5_deg", "Triangles Below 5°", of="measures.quality.below_5", where=Place.REPORT),
    Measure("below_10_deg", "Triangles Below 10°", of="measures.quality.below_10", where=Place.REPORT),
    Measure(
        "median_radius_ratio", "Median Radius Ratio", of="measures.quality.median_radius_ratio", where=Place.REPORT
    ),
    Measure("largest_diameter_mm", "Largest Diameter", "mm", of="largest_diameter_mm", where=Place.TABLE),
    Measure("mean_hu", "Mean", HU, of="inside.mean", where=Place.TABLE | _BATCH),
    Measure("sd_hu", "Standard Deviation", HU, of="inside.deviation", where=Place.TABLE | Place.BATCH | Place.LABELS),
    Measure(
        "size_mm",
        "Size",
        "mm",
        of="measures.size",
        where=Place.REPORT | _TERMINAL | Place.TABLE | Place.PANEL | _BATCH,
        shown=partial(sizes_text, digits=3),
        columns={"size_x_mm": 0, "size_y_mm": 1, "size_z_mm": 2},
    ),
    Measure(
        "cavities",
        "Cavities",
        of="measures.cavities",
        where=Place.REPORT | _TERMINAL | Place.TABLE | _BATCH,
        summed="sum",
    ),
    Measure("max_gy", "Maximum Dose", GY, of="inside.maximum", where=Place.TABLE, kind=ValueKind.DOSE),
    Measure("d95_gy", "D95", GY, of="inside.d95", where=Place.TABLE, kind=ValueKind.DOSE),
    Measure("suv_max", "SUVmax", of="inside.maximum", where=Place.TABLE, kind=ValueKind.SUV),
    Measure("suv_peak", "SUVpeak", of="inside.peak", where=Place.TABLE, kind=ValueKind.SUV),
)
"""All measures, in the order of reports; new ones come last, because scripts read tables."""

_PRINT = _TERMINAL | Place.TABLE | Place.PANEL | _BATCH

PRINT_MEASURES = (
    Measure(
        "thinnest_wall_mm", "Thinnest Wall", "mm", of="printing.thinnest_wall_mm", where=_PRINT, shown=_DISTANCE_TEXT
    ),
    Measure("below_least_wall", "Below Least Wall", of="printing.below_least_wall", where=_PRINT, shown=percent_text),
    Measure(
        "largest_overhang_deg",
        "Largest Overhang",
        "deg",
        of="printing.largest_overhang_deg",
        where=_PRINT,
        shown="{:.3g}°".format,
    ),
    Measure("overhang_share", "Overhang above 45°", of="printing.overhang_share", where=_PRINT, shown=percent_text),
    Measure("fits_bed", "Fits the Bed", of="printing.fits_bed", where=_PRINT, summed="all"),
)
"""Measures of a part for print, by names of its facts; reports have all facts as `print`, so Place.REPORT has none."""

GRAY_VALUES = tuple(each for each in MEASURES if each.unit == HU)


_MAP_COLUMNS = {
    "min": "minimum",
    "p5": "percentile_5",
    "median": "median",
    "mean": "mean",
    "p95": "percentile_95",
    "max": "maximum",
    "share_without": "share_without",
    "share_below": "share_below",
    "share_above": "share_above",
}
"""The columns of a map, behind its name, and the parts of its statistics."""


def map_measure(name: str, unit: str) -> Measure:
    """Return the measure of a map: its statistics.

    Parameters
    ----------
    name, unit : str
        Those of the map.

    Examples
    --------
    >>> list(map_measure("thickness_mm", "mm").cells(None))[:3]
    ['thickness_mm_min', 'thickness_mm_p5', 'thickness_mm_median']
    """
    return Measure(
        name,
        name,
        unit,
        of=("maps", name, "statistics"),
        where=Place.REPORT | _TERMINAL | Place.TABLE | _BATCH,
        shown=partial(_statistics_text, unit=unit),
        columns={f"{name}_{column}": part for column, part in _MAP_COLUMNS.items()},
    )


def _statistics_text(statistics: Mapping[str, float | None], unit: str) -> str:
    """Return the numbers of a map in a line.

    Examples
    --------
    >>> parts = {"minimum": 1.0, "percentile_5": 1.1, "median": 2.0, "mean": 2.25, "percentile_95": 2.9, "maximum": 3.0}
    >>> _statistics_text({**parts, "share_without": 0.5, "share_below": 0.25}, "mm")
    'median 2 mm, mean 2.25, 1 to 3 (90 %: 1.1 to 2.9), 50 % without a value, 25 % below'
    """
    if statistics["median"] is None:
        return "no value"
    numbers, shown = map_numbers(statistics, unit)
    text = (
        f"median {numbers['median']} {shown}".rstrip() + f", mean {numbers['mean']}, {numbers['minimum']} to "
        f"{numbers['maximum']} (90 %: {numbers['percentile_5']} to {numbers['percentile_95']})"
    )
    shares = {"without a value": "share_without", "below": "share_below", "above": "share_above"}
    parts = {words: statistics.get(part) for words, part in shares.items()}
    return ", ".join([text, *(f"{percent_text(share)} {words}" for words, share in parts.items() if share)])


def map_numbers(statistics: Mapping[str, float | None], unit: str) -> tuple[dict[str, str], str]:
    """Return the known values of a map as texts, by the parts of its statistics, and the one unit of all.

    Examples
    --------
    >>> map_numbers({"median": 0.002, "maximum": 0.05, "share_without": 0.5}, "mm")
    ({'median': '2', 'maximum': '50'}, 'um')
    """
    numbers = {part: each for part, each in statistics.items() if each is not None and not part.startswith("share")}
    fitting = fitting_unit(numbers.values(), unit) if numbers else Unit(unit, 1.0, 0.0)
    return {part: number_text(value / fitting.size) for part, value in numbers.items()}, fitting.name


def _dose_measure(dose: float) -> Measure:
    """Return the measure of the volume that gets at least a dose, in percent.

    Parameters
    ----------
    dose : float
        Gy.

    Examples
    --------
    >>> _dose_measure(20.0).name, _dose_measure(7.5).label
    ('v20_gy_percent', 'V7.5 Gy')
    """
    number = f"{dose:.9g}"
    return Measure(
        f"v{number}_gy_percent",
        f"V{number} Gy",
        "%",
        of=("inside", "percent_at", dose),
        where=Place.TABLE,
        kind=ValueKind.DOSE,
    )


def measures_in(
    place: Place,
    maps: Iterable[tuple[str, str]] = (),
    kind: ValueKind | str | None = None,
    doses: Iterable[float] = (),
    printed: Collection[str] = (),
) -> tuple[Measure, ...]:
    """Return the measures that a place shows, in their order.

    Those of parts for print, of doses (Gy), and then those of maps, given by name and unit, come last.

    Parameters
    ----------
    place : Place
    maps : iterable of (name, unit)
    kind : ValueKind, optional
        Kind of the values inside, for the measures that only a dose or a PET has.
    doses : iterable of float
        Doses in Gy; the share of the volume that gets at least each dose is measured.
    printed : collection of str
        Names of those of `PRINT_MEASURES` that are known.
    """
    of_print = (each for each in PRINT_MEASURES if each.name in printed)
    every = (*MEASURES, *of_print, *map(_dose_measure, doses), *(map_measure(*about) for about in maps))
    return tuple(each for each in every if each.where & place and each.kind in (None, kind))


def doses_of(surfaces: Iterable[FinishedSurface]) -> tuple[float, ...]:
    """Return the doses, Gy, at which the volume of any surface is known, in their order."""
    doses = {dose: None for surface in surfaces for dose in getattr(surface.inside, "percent_at", ())}
    return tuple(doses)


def maps_of(surfaces: Iterable[FinishedSurface]) -> dict[str, str]:
    """Return the units of all maps of surfaces, by name."""
    return {name: each.unit for surface in surfaces for name, each in surface.maps.items()}


def printed_of(surfaces: Iterable[FinishedSurface]) -> frozenset[str]:
    """Return the names of those of `PRINT_MEASURES` that are known of any surface."""
    parts = [surface for surface in surfaces if surface.printing is not None]
    return frozenset(each.name for each in PRINT_MEASURES if any(each.value(part) is not None for part in parts))


def measure(name: str) -> Measure:
    """Return the measure of this name."""
    return next(each for each in MEASURES if each.name == name)


def values_in(place: Place, surface: FinishedSurface) -> dict[str, Any]:
    """Return the values of a surface that a place shows, by the names of the measures."""
    return {each.name: each.value(surface) for each in measures_in(place, maps_of([surface]).items())}


def columns_in(place: Place, first: Iterable[str] = (), maps: Iterable[tuple[str, str]] = ()) -> tuple[str, ...]:
    """Return the columns of a place: `first` in this order, then all the rest, those of maps last.

    Examples
    --------
    >>> columns_in(Place.LABELS, ["label", "volume_mm3"])[:3]
    ('label', 'volume_mm3', 'faces')
    """
    return tuple(dict.fromkeys([*first, *(column for each in measures_in(place, maps) for column in each.cells(None))]))


def combined(about: Measure, values: Sequence[Any]) -> Any:
    """Return the value of several surfaces combined; None if one of them is not known.

    Examples
    --------
    >>> combined(measure("components"), [2, 3]), combined(measure("closed"), [True, False])
    (5, False)
    >>> combined(measure("collapsed_components"), [{"count": 1, "mm3": 2.5}, {"count": 3, "mm3": 1.0}])
    {'count': 4, 'mm3': 3.5}
    >>> combined(measure("volume_mm3"), [2.0, 3.0])
    """
    if not values or any(value is None for value in values):
        return None
    if about.summed == "all":
        return all(values)
    if about.summed == "none":
        return values[0] if len(values) == 1 else None
    if isinstance(values[0], Mapping):
        return {part: sum(value[part] for value in values) for part in values[0]}
    return sum(values)
