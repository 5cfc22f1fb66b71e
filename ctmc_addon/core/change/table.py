# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the table of changes: a row for each component, with units in the column names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..files.atomic_write import csv_text
from ..measures.measures import UNKNOWN
from ..measures.units import number_text
from .compare import ChangeRow

DIGITS = 9  # Numbers in a CSV have this many digits.
MM3_PER_ML = 1000.0
TERMINAL = 11  # The terminal shows only this many columns; files have all.
CHANGE_HEADS = (
    "name",
    "label",
    "status",
    "before",
    "after",
    "volume_before_ml",
    "volume_after_ml",
    "change_percent",
    "largest_diameter_before_mm",
    "largest_diameter_after_mm",
    "doubling_time_days",
    "x_mm",
    "y_mm",
    "z_mm",
    "distance_low_mm",
    "distance_high_mm",
)


def _change_columns(row: ChangeRow) -> dict[str, Any]:
    """Return the columns of a row by their names.

    `before` and `after` are the numbers of components, the largest in its volume first: '1', or '2+3' for several.
    """
    first, last = row.volume_before_mm3, row.volume_after_mm3
    numbers = ("+".join(str(each.number) for each in components) for components in (row.before, row.after))
    values = (
        row.name,
        row.label,
        str(row.status),
        *numbers,
        None if first is None else first / MM3_PER_ML,
        None if last is None else last / MM3_PER_ML,
        row.percent,
        row.diameter_before_mm,
        row.diameter_after_mm,
        row.doubling_time_days,
        *row.center_mm,
        *(row.distance_mm or (None, None)),
    )
    return dict(zip(CHANGE_HEADS, values, strict=True))


def written_columns(row: ChangeRow) -> dict[str, Any]:
    """Return the columns of a row for files; unknown values are None."""
    return {
        head: f"{cell:.{DIGITS}g}" if isinstance(cell, float) else cell for head, cell in _change_columns(row).items()
    }


def change_csv(rows: Sequence[ChangeRow]) -> str:
    """Return the rows as CSV; unknown values stay empty."""
    return csv_text([written_columns(row) for row in rows], CHANGE_HEADS)


def change_cells(rows: Sequence[ChangeRow]) -> list[tuple[str, ...]]:
    """Return the table for the terminal, its heads first; unknown values are a dash."""
    heads = tuple(
        head.removesuffix("_percent").replace("largest_", "").replace("_", " ") for head in CHANGE_HEADS[:TERMINAL]
    )
    cells = (tuple(_change_columns(row).values())[:TERMINAL] for row in rows)
    return [heads, *(tuple(map(_shown, CHANGE_HEADS, own)) for own in cells)]


def _shown(head: str, cell: Any) -> str:
    if cell is None or cell == "":
        return UNKNOWN
    if head == "change_percent":
        return f"{cell:+.1f} %"
    return number_text(cell) if isinstance(cell, float) else str(cell)
