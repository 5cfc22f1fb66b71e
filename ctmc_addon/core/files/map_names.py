# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the names of maps for files: one word each, all different."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from ..arrays import Floats
from ..errors import OutputError
from .file_names import printable


class NamedValues(Protocol):
    """Values on vertices for a file, such as a `SurfaceMap`."""

    @property
    def name(self) -> str:
        """Such as thickness_mm."""

    @property
    def values(self) -> Floats:
        """(V,) float32, NaN where there is no value."""


def words_of(names: Iterable[str], taken: Iterable[str] = ()) -> list[str]:
    """Return a word for each name, all different and none of `taken`.

    Examples
    --------
    >>> words_of(["thickness_mm", "distance_portal vein_mm", "x", "", "X"], ["x", "y", "z"])
    ['thickness_mm', 'distance_portal_vein_mm', 'x_2', 'map', 'X_3']
    """
    out: list[str] = []
    used = {name.casefold() for name in taken}
    for name in names:
        word = printable(name).replace(" ", "_") or "map"
        number, unique = 1, word
        while unique.casefold() in used:
            number += 1
            unique = f"{word}_{number}"
        used.add(unique.casefold())
        out.append(unique)
    return out


def require_values(surface: str, vertex_count: int, maps: Iterable[NamedValues]) -> None:
    """Raise `OutputError` unless each map has one value for each vertex of a surface."""
    for each in maps:
        if len(each.values) != vertex_count:
            raise OutputError(
                f"the map {each.name} has {len(each.values)} values, and {surface} has {vertex_count} vertices; "
                "work the map out on this surface"
            )
