# SPDX-License-Identifier: GPL-3.0-or-later
"""Print the table of an experiment, and write it as CSV, JSON and Markdown into a folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...core.files.atomic_write import csv_text, write_json, write_text
from ..machine.machine import machine, versions
from ..terminal import listing, table
from .plot import Plot

Row = dict[str, Any]
FILES = AS_JSON, AS_CSV, AS_PAGE, PLOT = "table.json", "table.csv", "table.md", "plot.png"


@dataclass(frozen=True)
class Column:
    """A column that is shown: its title, and the text that it shows of a row."""

    title: str
    show: Callable[[Row], str]


def figures(title: str, key: str, digits: int, unit: float = 1.0) -> Column:
    """Return a column of numbers, `row[key] / unit` with `digits` decimal digits, and '-' for None."""
    return Column(title, lambda row: "-" if row[key] is None else f"{row[key] / unit:.{digits}f}")


LEVEL = Column("level", lambda row: f"{row['level_percent']:g} %")
TRIANGLES = figures("triangles", "faces", 0)
VOLUME_ML = figures("volume, ml", "volume_mm3", 3, 1000)
MEAN_MM, MAX_MM = figures("mean, mm", "mean_mm", 4), figures("max, mm", "max_mm", 3)
WAYS = (
    figures("to full surface: 95 %, mm", "to_full_p95_mm", 3),
    figures("to full surface: max, mm", "to_full_max_mm", 3),
    figures("from full surface: 95 %, mm", "from_full_p95_mm", 3),
    figures("from full surface: max, mm", "from_full_max_mm", 3),
    figures("specks removed", "collapsed_components", 0),
)
"""Both ways of a distance, and the components that are left out of it."""


@dataclass(frozen=True)
class ExperimentTable:
    """An experiment's result.

    Parameters
    ----------
    title : str
    facts : sequence of (name, fact)
        Input, settings, and how times and distances were taken; an empty name continues the fact before.
    columns : sequence of Column
        The columns that are shown.
    rows : sequence of dict
        The content of table.json and table.csv.
    plot : Plot
    pictures : sequence of (file name, caption)
        Further pictures beside the table.
    """

    title: str
    facts: Sequence[tuple[str, str]]
    columns: Sequence[Column]
    rows: Sequence[Row]
    plot: Plot
    pictures: Sequence[tuple[str, str]] = ()
    machine_facts: tuple[tuple[str, str], ...] = field(
        default_factory=lambda: (("machine", machine()), ("versions", versions()))
    )

    @property
    def cells(self) -> list[list[str]]:
        """Return the shown table, its titles first."""
        shown = [[column.show(row) for column in self.columns] for row in self.rows]
        return [[column.title for column in self.columns], *shown]

    def printed(self) -> str:
        """Return machine, table and facts for a terminal."""
        return f"{self.title}\n{listing(self.machine_facts)}\n\n{table(self.cells)}\n\n{listing(self.facts)}"

    def markdown(self) -> str:
        """Return title, machine, table, facts and pictures as Markdown."""
        lines: list[str] = []
        for name, fact in self.facts:
            # A name of its own opens a point, an empty one continues it.
            lines.append(f"- {name}: {_escaped(fact)}" if name else f"  {_escaped(fact)}")
        rows = [" | ".join(_escaped(cell) for cell in row) for row in self.cells]
        rule = " | ".join(["---", *["---:"] * (len(self.columns) - 1)])
        body = [f"| {row} |" for row in (rows[0], rule, *rows[1:])]
        pictures = [f"![{caption}]({name})" for name, caption in ((PLOT, self.plot.caption), *self.pictures)]
        head = [f"## {self.title}", "", _escaped("; ".join(fact for _, fact in self.machine_facts)), ""]
        return "\n".join([*head, *body, "", *lines, "", *pictures, ""])

    def write(self, folder: Path) -> None:
        """Write the files of the table."""
        rows = [{**row, **dict(self.machine_facts)} for row in self.rows]
        self.plot.write(folder / PLOT)
        write_json(folder / AS_JSON, rows)
        write_text(folder / AS_CSV, as_csv(rows))
        write_text(folder / AS_PAGE, self.markdown())


def as_csv(rows: Sequence[Row]) -> str:
    """Return rows as CSV; a list becomes a column for each of its values, None stays empty.

    Examples
    --------
    >>> print(as_csv([{"level_percent": 50, "rounds": [0.25, 0.5], "engine": None}]), end="")
    level_percent,rounds_1,rounds_2,engine
    50,0.25,0.5,
    """
    flat = []
    for row in rows:
        cells: Row = {}
        for name, value in row.items():
            many = {f"{name}_{at + 1}": item for at, item in enumerate(value)} if isinstance(value, list) else None
            cells |= {name: value} if many is None else many
        flat.append(cells)
    names = list(dict.fromkeys(name for row in flat for name in row))
    return csv_text(flat, names)


def _escaped(text: str) -> str:
    """Return text that Markdown leaves as it is, inside a table too."""
    return "".join("\\" + letter if letter in "\\`*_|<>" else letter for letter in text)


def runs_text(repeats: int) -> str:
    """Return the number of timed runs as text.

    Examples
    --------
    >>> runs_text(5), runs_text(1)
    ('median of 5 runs of each, in turn', 'one run of each')
    """
    return "one run of each" if repeats == 1 else f"median of {repeats} runs of each, in turn"


def plain(value: float) -> float | int:
    """Return a whole number without its point."""
    return int(value) if float(value).is_integer() else value


def unique(values: Sequence[Any], first: Any = None) -> list[Any]:
    """Return the values in their order, each once, `first` ahead of all if it is given.

    Examples
    --------
    >>> unique([50, 90, 50], first=0)
    [0, 50, 90]
    """
    return list(dict.fromkeys(values if first is None else [first, *values]))
