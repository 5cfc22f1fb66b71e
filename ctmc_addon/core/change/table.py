# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the table of changes: a row for each component, with units in the column names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from ..files.atomic_write import csv_text
from ..measures.measures import UNKNOWN
from ..measures.units import number_text, percent_change_text, text_beside
from .compare import ChangeRow
from .components import Component

DIGITS = 9  # A number in a CSV has this many digits.
MM3_PER_ML = 1000.0


class _Column(NamedTuple):
    """A column of the table.

    Parameters
    ----------
    name : str
        Name in files.
    value : callable
        Returns the cell of a row; None if unknown.
    head : str
        Name in the terminal; a column without it is only in files.
    text : callable
        Returns the text of a row's cell, if known, for the terminal.
    """

    name: str
    value: Callable[[ChangeRow], Any]
    head: str = ""
    text: Callable[[ChangeRow, Any], str] = lambda _, cell: str(cell)


def _numbers(components: Sequence[Component]) -> str:
    """Return the numbers of components, the largest in its volume first: '1', or '2+3' for several."""
    return "+".join(str(each.number) for each in components)


def _in_ml(volume_mm3: float | None) -> float | None:
    return None if volume_mm3 is None else volume_mm3 / MM3_PER_ML


def _volume_text(row: ChangeRow, volume_ml: float) -> str:
    """Return one of both volumes, in the unit that fits the larger one."""
    return text_beside(volume_ml * MM3_PER_ML, (row.volume_before_mm3, row.volume_after_mm3), "mm3")


def _diameter_text(row: ChangeRow, diameter_mm: float) -> str:
    return text_beside(diameter_mm, (row.diameter_before_mm, row.diameter_after_mm), "mm")


_COLUMNS = (
    _Column("name", lambda row: row.name, "name"),
    _Column("label", lambda row: row.label, "label"),
    _Column("status", lambda row: str(row.status), "status"),
    _Column("before", lambda row: _numbers(row.before), "before"),
    _Column("after", lambda row: _numbers(row.after), "after"),
    _Column("volume_before_ml", lambda row: _in_ml(row.volume_before_mm3), "volume before", _volume_text),
    _Column("volume_after_ml", lambda row: _in_ml(row.volume_after_mm3), "volume after", _volume_text),
    _Column("change_percent", lambda row: row.percent, "change", lambda _, change: percent_change_text(change)),
    _Column("largest_diameter_before_mm", lambda row: row.diameter_before_mm, "diameter before", _diameter_text),
    _Column("largest_diameter_after_mm", lambda row: row.diameter_after_mm, "diameter after", _diameter_text),
    _Column(
        "doubling_time_days",
        lambda row: row.doubling_time_days,
        "doubling time days",
        lambda _, days: number_text(days),
    ),
    _Column("x_mm", lambda row: row.center_mm[0]),
    _Column("y_mm", lambda row: row.center_mm[1]),
    _Column("z_mm", lambda row: row.center_mm[2]),
    _Column("distance_low_mm", lambda row: row.distance_mm and row.distance_mm[0]),
    _Column("distance_high_mm", lambda row: row.distance_mm and row.distance_mm[1]),
)
CHANGE_HEADS = tuple(each.name for each in _COLUMNS)


def _change_columns(row: ChangeRow) -> dict[str, Any]:
    """Return the columns of a row by their names."""
    return {each.name: each.value(row) for each in _COLUMNS}


def written_columns(row: ChangeRow) -> dict[str, Any]:
    """Return the columns of a row for files; unknown values are None."""
    return {
        head: f"{cell:.{DIGITS}g}" if isinstance(cell, float) else cell for head, cell in _change_columns(row).items()
    }


def change_csv(rows: Sequence[ChangeRow]) -> str:
    """Return the rows as CSV; unknown values stay empty."""
    return csv_text([written_columns(row) for row in rows], CHANGE_HEADS)


def change_cells(rows: Sequence[ChangeRow]) -> list[tuple[str, ...]]:
    """Return the table for a person, its heads first, in units that fit; unknown values are a dash."""
    shown = [each for each in _COLUMNS if each.head]
    return [tuple(each.head for each in shown), *(tuple(_text(row, each) for each in shown) for row in rows)]


def _text(row: ChangeRow, about: _Column) -> str:
    cell = about.value(row)
    return UNKNOWN if cell is None or cell == "" else about.text(row, cell)
