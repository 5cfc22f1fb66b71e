# SPDX-License-Identifier: GPL-3.0-or-later
"""Requests for maps: quantities, their limits, and the colors of the map that is shown."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from ..errors import SettingsError
from ..measures.measures import MEASURES, PRINT_MEASURES
from .quantity import Quantity
from .ramps import RAMPS
from .surface_map import Limits

TAKEN = {
    *(each.name for each in (*MEASURES, *PRINT_MEASURES)),
    *("name", "version", "label", "label_name", "alpha", "alpha_choice", "threshold", "voxels_visited", "smoothing"),
    *("slice_steps", "wrong_side", "neighbors", "stages", "settings", "spacing_mm", "maps", "print", "notes", "time"),
    "solid",
    *("case", "status", "error", "reading", "format", "space", "run", "seconds", "memory_bytes", "files", "file_bytes"),
}
"""Names that reports and the records of a batch already use."""


@dataclass(frozen=True, eq=False)
class MapRequest:
    """Maps to make on every surface.

    Parameters
    ----------
    quantities : tuple of Quantity
    limits : mapping of str to Limits
        Limits by the name of a map.
    shown : str
        Name of the map whose colors files and figures show; by default the first.
    range : (low, high) float, optional
        Values of the first and the last color of the shown map; by default round numbers around nearly all values.
    ramp : str, optional
        Color ramp of the shown map; by default that of its quantity.

    Raises
    ------
    SettingsError
        For two maps with the same name, a name that no map has, an empty range or an unknown ramp.
    """

    quantities: tuple[Quantity, ...]
    limits: Mapping[str, Limits] = field(default_factory=dict)
    shown: str = ""
    range: tuple[float, float] | None = None
    ramp: str | None = None

    def __post_init__(self) -> None:
        """Check the names; set the shown map."""
        names = [quantity.name for quantity in self.quantities]
        for name, count in Counter(name.lower() for name in names).items():
            if count > 1:
                raise SettingsError(f"two maps are called {name}; give each a name of its own")
        for name in names:
            if name in TAKEN:
                raise SettingsError(f"a map cannot be called {name}, as reports have that; give it another name")
        for name in (*self.limits, *([self.shown] if self.shown else [])):
            if name not in names:
                there = f"the maps are {', '.join(names)}" if names else "no map is asked for, such as --thickness"
                raise SettingsError(f"there is no map {name}; {there}")
        for name, (low, high) in self.limits.items():
            if not low <= high:
                raise SettingsError(f"the limits of {name} are {low:g} and {high:g}; give the lower one first")
        if self.range is not None and not -math.inf < self.range[0] < self.range[1] < math.inf:
            low, high = self.range
            raise SettingsError(
                f"the colors cannot run from {low:g} to {high:g}; give two numbers, the lower one first"
            )
        if self.ramp is not None and self.ramp not in RAMPS:
            raise SettingsError(f"there is no color ramp {self.ramp}; choose {', '.join(RAMPS)}")
        if (self.range or self.ramp) and not names:
            raise SettingsError("a range or ramp colors a map, and none is asked for; add one, such as --thickness")
        if names and not self.shown:
            object.__setattr__(self, "shown", names[0])

    @classmethod
    def of(cls, maps: MapRequest | Iterable[Quantity]) -> MapRequest:
        """Return a request for quantities, or the given request."""
        return maps if isinstance(maps, MapRequest) else cls(tuple(maps))

    def __bool__(self) -> bool:
        """Whether there is any map."""
        return bool(self.quantities)
