# SPDX-License-Identifier: GPL-3.0-or-later
"""A measure: its name, its unit, the way to its value, its text, and the places that show it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, asdict, dataclass, field, is_dataclass
from enum import Flag, auto
from typing import Any

from ..volume.value_kind import ValueKind
from .finished_surface import FinishedSurface
from .units import UNITS, number_text, sizes_text

HU, GY = "HU", "Gy"
"""The unit of gray values, where they are not HU that of their kind; and the unit of a dose."""
UNKNOWN = "-"


class Place(Flag):
    """The places that show measures."""

    REPORT = auto()
    """The JSON of a reconstruction and of a batch's case."""
    TERMINAL = auto()
    """The summary of one surface on the terminal."""
    SURFACES = auto()
    """The table of several surfaces on the terminal."""
    TABLE = auto()
    """The table of structures: `ctmc measure` and the panel Measurements."""
    PANEL = auto()
    """The panel Results."""
    BATCH = auto()
    """summary.csv and summary.json of a batch."""
    LABELS = auto()
    """labels.csv of a batch, and the list of surfaces on its page."""
    PAGE = auto()
    """summary.html of a batch."""
    TOTALS = auto()
    """The sums and ranges over all cases on that page."""
    LINE = auto()
    """The lines and the table of a batch on the terminal."""


@dataclass(frozen=True)
class Measure:
    """A measure of a surface, and where it is shown.

    Parameters
    ----------
    name : str
        The key in JSON, and the column where `columns` does not say others.
    label : str
        The name that a person reads.
    unit : str
        mm, mm2, mm3, deg, HU, Gy, or nothing.
    of : str or tuple of str
        The way to it from a `FinishedSurface`, such as `measures.area`; a tuple where a name may hold a dot.
    where : Place
    summed : str
        Combination of several surfaces' values: `sum`, `all`, or `none` if only a single one's is known.
    shown : callable, optional
        Returns the text of a value that is known; by default by its type and unit.
    columns : mapping of str to int or str
        The columns of a value of several parts, and the index or key of each part.
    kind : ValueKind, optional
        Kind of the values inside without which it is not shown.
    """

    name: str
    label: str
    unit: str = ""
    _: KW_ONLY
    of: str | tuple[Any, ...]
    where: Place
    summed: str = "none"
    shown: Callable[[Any], str] | None = None
    columns: Mapping[str, int | str] = field(default_factory=dict)
    kind: ValueKind | None = None

    def value(self, surface: FinishedSurface) -> Any:
        """Return the value for JSON; None where it is not known, or infinite, which JSON does not have."""
        value: Any = surface
        for step in self.of.split(".") if isinstance(self.of, str) else self.of:
            value = value.get(step) if isinstance(value, Mapping) else getattr(value, str(step), None)
        if isinstance(value, float) and not math.isfinite(value):
            return None
        if is_dataclass(value) and not isinstance(value, type):
            return asdict(value)
        return list(value) if isinstance(value, tuple) else value

    def cells(self, value: Any) -> dict[str, Any]:
        """Return the parts of a value by their columns.

        Examples
        --------
        >>> from .measures import measure
        >>> measure("size_mm").cells([3.0, 2.0, 1.0])
        {'size_x_mm': 3.0, 'size_y_mm': 2.0, 'size_z_mm': 1.0}
        """
        if not self.columns:
            return {self.name: value}
        return {column: None if value is None else value[part] for column, part in self.columns.items()}

    def text(self, value: Any) -> str:
        """Return a value as a person reads it, in the unit that fits.

        Examples
        --------
        >>> from .measures import measure
        >>> measure("volume_mm3").text(0.02), measure("volume_mm3").text(None), measure("closed").text(True)
        ('0.02 mm3', '-', 'yes')
        """
        if value is None:
            return UNKNOWN
        if self.shown is not None:
            return self.shown(value)
        if isinstance(value, bool):
            return "yes" if value else "no"
        if self.unit in UNITS:
            return sizes_text(value if isinstance(value, Sequence) else (value,), self.unit)
        return f"{value}" if isinstance(value, int) else number_text(value)

    @property
    def head(self) -> str:
        """The head of a column or line for a person, such as 'volume', 'mean HU' and 'Euler number'."""
        lower = self.label.lower().replace("euler", "Euler")
        return f"{lower} {HU}" if self.unit == HU and not self.columns else lower

    def table_cells(self, value: Any, unit: str = HU) -> dict[str, Any]:
        """Return the parts of a value by their columns in the table of structures, whose volumes are in ml.

        `unit` is that of the gray values, for the heads.

        Examples
        --------
        >>> from .measures import measure
        >>> measure("volume_mm3").table_cells(5000.0), measure("mean_hu").table_cells(40.0, "gray")
        ({'volume_ml': 5.0}, {'mean_gray': 40.0})
        """
        if self.unit == HU and not self.columns:
            return {self.name.replace("hu", unit.lower()): value}
        if self.unit not in ("mm2", "mm3") or self.columns:
            return self.cells(value)
        largest = UNITS[self.unit][0]
        return {self.name.replace(self.unit, largest.name): None if value is None else value / largest.size}
