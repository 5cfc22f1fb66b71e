# SPDX-License-Identifier: GPL-3.0-or-later
"""summary.html: totals, a histogram and a table that sorts, filters and searches, without a network.

Without scripts it is a plain table. Thumbnails are loaded when they come into view, from the folder beside the page.
"""

from __future__ import annotations

import html
import math
import statistics
from collections.abc import Callable, Sequence
from typing import NamedTuple
from urllib.parse import quote

from ....core import VERSION, Place, measures_in, unit_of
from ....core.files.mesh_files import PAGE
from ..files import ABSENT, DONE, THUMBNAILS
from .page_parts import SCRIPT, STYLE
from .rows import NOTES_BETWEEN, SummaryRow, counts, known

REFRESH = 10  # seconds after which an open page looks again while the batch runs
MOST_BINS = 30
BAR, WIDTH, HEIGHT = 16, 240, 90  # of the histogram, pixels: at least, but for the last

MEMORY = "memory, MiB"
NUMBER = ' class="number"'


class Cell(NamedTuple):
    """A cell: what stands in it as HTML, and by what it is sorted."""

    content: str
    key: float | str | None = None


# The head of every column, and whether it holds numbers.
MEASURED = measures_in(Place.PAGE)
COLUMNS = (
    ("", False), ("case", False), ("status", False), *((each.head, each.name != "closed") for each in MEASURED),
    ("spacing, mm", True), ("seconds", True), (MEMORY, True), ("look at", False), ("notes", False),
    ("error", False),
)  # fmt: skip


def html_text(rows: Sequence[SummaryRow], over: bool) -> str:
    """Return the page; it names no file but thumbnails and pages of cases that lie beside it."""
    refresh = "" if over else f'<meta http-equiv="refresh" content="{REFRESH}">'
    table = [row for row in rows if row.status != ABSENT]
    absent = [row for row in rows if row.status == ABSENT]
    lines = [
        f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">{refresh}',
        '<meta name="viewport" content="width=device-width"><meta name="color-scheme" content="light dark">',
        f"<title>CTMC batch</title><style>{STYLE}</style></head><body>",
        f"<h1>{counts(rows)}</h1><p>ctmc {VERSION}</p>",
        *map(cohort, labels_of(rows)),
        controls(table),
        f"<table id=cases><thead><tr>{''.join(map(head_cell, COLUMNS))}</tr></thead><tbody>",
        *map(html_row, table),
        "</tbody></table>",
        absent_list(absent),
        f"<script>{SCRIPT}</script></body></html>",
    ]
    return "\n".join(line for line in lines if line) + "\n"


def head_cell(column: tuple[str, bool]) -> str:
    """Return the head of a column."""
    name, is_number = column
    return f"<th{NUMBER * is_number}>{name}</th>"


def html_row(row: SummaryRow) -> str:
    """Return one case with its picture, if it has one."""
    text = " ".join([row.case, row.status, row.notes, row.outlier, row.error or ""]).lower()
    classes = f"{row.status}{' outlier' * bool(row.outlier)}"
    cells = "".join(map(cell_text, cells_of(row), COLUMNS))
    return f'<tr class="{classes}" data-text="{html.escape(text)}">{cells}</tr>'


def cell_text(cell: Cell, column: tuple[str, bool]) -> str:
    """Return a cell with what it is sorted by, where that is not its text."""
    key = "" if cell.key is None else f' data-key="{html.escape(str(cell.key))}"'
    return f"<td{NUMBER * column[1]}{key}>{cell.content}</td>"


def cells_of(row: SummaryRow) -> list[Cell]:
    """Return the cells of a case, in the order of the columns."""
    spacing = [side for side in (row.spacing_x_mm, row.spacing_y_mm, row.spacing_z_mm) if side is not None]
    return [
        Cell(picture(row), ""),
        Cell(case_link(row) + labels_table(row), row.case),
        Cell(row.status),
        *(Cell(row.text(each), each.sort_key(row.values.get(each.name))) for each in MEASURED),
        Cell(" ".join(f"{side:.3g}" for side in spacing), max(spacing, default=None)),
        Cell("" if row.seconds is None else f"{row.seconds:.1f}"),
        Cell("" if row.memory_bytes is None else f"{row.memory_bytes / (1 << 20):.0f}"),
        Cell(html.escape(row.outlier)),
        Cell(notes_cell(row.notes), row.notes),
        Cell(html.escape(row.error or "")),
    ]


def notes_cell(notes: str) -> str:
    """Return notes, to be unfolded."""
    lines = "".join(f"<li>{html.escape(note)}</li>" for note in notes.split(NOTES_BETWEEN) if note)
    count = lines.count("<li>")
    return f"<details><summary>{count} note{'s' * (count != 1)}</summary><ul>{lines}</ul></details>" if lines else ""


def picture(row: SummaryRow) -> str:
    """Return the thumbnail, which is loaded once it is seen."""
    if not row.thumbnail:
        return ""
    source = html.escape(quote(f"{THUMBNAILS}/{row.case}.png"))
    return f'<img alt="" loading="lazy" width="120" height="90" src="{source}">'


def case_link(row: SummaryRow) -> str:
    """Return the name of a case, which leads to its page if it has one."""
    name = html.escape(row.case)
    if row.status != DONE or not row.page:
        return name
    return f'<a href="{html.escape(quote(f"{row.case}{PAGE}"))}">{name}</a>'


def labels_table(row: SummaryRow) -> str:
    """Return the surfaces of several labels, to be unfolded."""
    if not row.surfaces:
        return ""
    shown = measures_in(Place.LABELS)
    head = "".join(f"<th>{head}</th>" for head in ("label", *(each.head for each in shown)))
    lines = []
    for surface in row.surfaces:
        cells = (
            surface["name"],
            *("" if (value := surface[each.name]) is None else each.text(value) for each in shown),
        )
        lines.append(f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in cells)}</tr>")
    table = f"<table><tr>{head}</tr>{''.join(lines)}</table>"
    return f"<details><summary>{len(lines)} surfaces</summary>{table}</details>"


def controls(rows: Sequence[SummaryRow]) -> str:
    """Return the search and the filters, which show themselves where scripts run."""
    states = list(dict.fromkeys(row.status for row in rows))
    if any(row.outlier for row in rows):
        states.append("outlier")
    options = "".join(f"<option>{state}</option>" for state in states)
    return (
        '<p id=controls hidden><input id=search type=search placeholder="search" aria-label="search"> '
        f'<select id=filter aria-label="show"><option value="">all</option>{options}</select>'
        " <span id=shown></span></p>"
    )


def absent_list(rows: Sequence[SummaryRow]) -> str:
    """Return the cases that do not have the label, to be unfolded."""
    if not rows:
        return ""
    names = "".join(f"<li>{html.escape(row.case)}: {html.escape(row.error or '')}</li>" for row in rows)
    return f"<details id=absent><summary>{len(rows)} absent: without the label</summary><ul>{names}</ul></details>"


def labels_of(rows: Sequence[SummaryRow]) -> list[list[SummaryRow]]:
    """Return the rows that are done, those of each label by themselves, in the order of the labels."""
    groups: dict[int | None, list[SummaryRow]] = {}
    for row in rows:
        if row.status == DONE:
            groups.setdefault(row.label, []).append(row)
    return [groups[label] for label in sorted(groups, key=lambda label: -1 if label is None else label)]


def cohort(rows: Sequence[SummaryRow]) -> str:
    """Return the totals and the volumes of all cases with a label."""
    head = "" if rows[0].label is None else f"<h2>label {rows[0].label}</h2>"
    return f"{head}<div class=cohort>{totals_table(rows)}{histogram(known('volume_mm3', rows))}</div>"


def totals_table(done: Sequence[SummaryRow]) -> str:
    """Return sums, medians and ranges of cases that are done."""
    columns: list[tuple[str, Sequence[float], Callable[[float], str]]] = [
        *((each.head, known(each.name, done), each.text) for each in measures_in(Place.TOTALS)),
        ("seconds", [row.seconds for row in done if row.seconds is not None], short),
        (MEMORY, [row.memory_bytes / (1 << 20) for row in done if row.memory_bytes is not None], short),
    ]
    lines = []
    for name, values, text in columns:
        if values:
            of_all = "" if name == MEMORY else text(sum(values))
            facts = (str(len(values)), of_all, *(text(fact(values)) for fact in (statistics.median, min, max)))
            lines.append(f"<tr><th>{name}</th>{''.join(f'<td>{fact}</td>' for fact in facts)}</tr>")
    head = "<tr><th></th><th>cases</th><th>sum</th><th>median</th><th>least</th><th>most</th></tr>"
    return f"<table class=totals>{head}{''.join(lines)}</table>"


def short(number: float) -> str:
    """Return a number for a person.

    Examples
    --------
    >>> short(1234567.0), short(1423.64), short(0.51234)
    ('1234567', '1423.6', '0.512')
    """
    if number == int(number):
        return f"{int(number)}"
    return f"{number:.1f}" if abs(number) >= 100 else f"{number:.3g}"


def bins_of(values: Sequence[float]) -> tuple[float, float, list[int]]:
    """Return where a histogram begins, how wide its bins are, and how many values each has.

    Bins are 1, 2 or 5 times a power of ten wide, about as many as the square root of the number of values, twice.

    Examples
    --------
    >>> bins_of([1.0, 2.0, 2.5, 9.0])
    (0.0, 2.0, [1, 2, 0, 0, 1])
    """
    low, high = min(values), max(values)
    wanted = min(MOST_BINS, 2 * math.isqrt(len(values)))
    rough = (high - low) / wanted or abs(high) or 1.0
    power = 10.0 ** math.floor(math.log10(rough))
    width = next(power * step for step in (1, 2, 5, 10) if power * step >= rough * (1 - 1e-9))
    first, last = math.floor(low / width), math.floor(high / width)
    heights = [0] * (last - first + 1)
    for value in values:
        heights[min(last, max(first, math.floor(value / width))) - first] += 1
    return first * width, width, heights


def histogram(volumes_mm3: Sequence[float]) -> str:
    """Return a histogram of volumes as SVG, in the unit that fits the largest; none of a single one."""
    if len(volumes_mm3) < 2:
        return ""
    unit = unit_of(max(volumes_mm3), "mm3")
    start, width, heights = bins_of([volume / unit.size for volume in volumes_mm3])
    most, bar = max(heights), max(BAR, WIDTH // len(heights))
    wide = bar * len(heights)
    bars = []
    for at, number in enumerate(heights):
        high = HEIGHT * number / most
        title = f"{start + at * width:g} to {start + (at + 1) * width:g} {unit.name}: {number}"
        bars.append(
            f'<rect x="{bar * at}" y="{HEIGHT - high:.1f}" width="{bar - 2}" height="{high:.1f}">'
            f"<title>{title}</title></rect>"
        )
    end = start + len(heights) * width
    box = f"0 0 {wide} {HEIGHT + 20}"
    return (
        f'<figure><svg viewBox="{box}" width="{wide}" height="{HEIGHT + 20}" role="img">{"".join(bars)}'
        f'<text x="0" y="{HEIGHT + 15}">{start:g}</text><text x="{wide}" y="{HEIGHT + 15}" text-anchor="end">{end:g}'
        f"</text></svg><figcaption>volumes of {len(volumes_mm3)} cases, {unit.name}; {width:g} {unit.name} a bar, the "
        f"highest {most}</figcaption></figure>"
    )
