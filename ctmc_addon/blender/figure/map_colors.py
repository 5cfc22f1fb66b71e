# SPDX-License-Identifier: GPL-3.0-or-later
"""Show a map of surfaces in a figure: their colors, with a bar."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace

from ...core import Reconstruction, SettingsError, map_measure
from ...core.maps import SurfaceMap
from ..maps import StoredMap
from .spec import ColorScale, FigureStyle


def style_with_map(style: FigureStyle, results: Sequence[Reconstruction], name: str = "") -> FigureStyle:
    """Return a style that shows a map of surfaces; the colors have the range and ramp of the first that has it.

    Parameters
    ----------
    style : FigureStyle
    results : sequence of Reconstruction
        Surfaces with maps; objects made from them have the maps too.
    name : str
        Name of the map; by default the first.

    Raises
    ------
    SettingsError
        If no surface has the map.
    """
    names = list(dict.fromkeys(each.name for result in results for each in result.maps))
    name = name or next(iter(names), "")
    colors = scale_shown(results, name)
    if colors is None:
        there = f"the maps are {', '.join(names)}" if names else "the surfaces have none"
        raise SettingsError(f"there is no map {name}; {there}")
    return replace(style, colors=colors)


def scale_shown(results: Sequence[Reconstruction], name: str) -> ColorScale | None:
    """Return the colors of a map on several surfaces; None if none of them has it."""
    shown = [each for result in results for each in result.maps if each.name == name]
    return scale_of(shown) if shown else None


def scale_of(maps: Sequence[SurfaceMap | StoredMap]) -> ColorScale:
    """Return the colors of a map on several surfaces: those of the first.

    Parameters
    ----------
    maps : sequence of SurfaceMap or StoredMap
        Maps with the same name.
    """
    first = maps[0]
    low, high = first.range
    finite = [each.statistics for each in maps if each.statistics.minimum is not None]
    return ColorScale(
        name=first.name,
        title=title_of(first.name, first.unit),
        unit=first.unit,
        range=first.range,
        ramp=first.ramp,
        below=any(each.minimum is not None and each.minimum < low for each in finite),
        above=any(each.maximum is not None and each.maximum > high for each in finite),
        gaps=any(each.statistics.share_without > 0 for each in maps),
    )


def title_of(name: str, unit: str) -> str:
    """Return the name of a map in plain writing, without its unit.

    Examples
    --------
    >>> title_of("distance_portal_vein_mm", "mm"), title_of("dose", "Gy"), title_of("smallest_angle_deg", "deg")
    ('distance portal vein', 'dose', 'smallest angle')
    """
    return name.removesuffix(f"_{unit.lower()}" if unit else "").replace("_", " ")


def statistics_text(shown: SurfaceMap | StoredMap) -> str:
    """Return the numbers of a map in a sentence: 'thickness: median 2 mm, ...'."""
    about = map_measure(shown.name, shown.unit)
    return f"{title_of(shown.name, shown.unit)}: {about.text(asdict(shown.statistics))}"
