# SPDX-License-Identifier: GPL-3.0-or-later
"""Make summary.html: totals, a histogram and a table that sorts, filters and searches, without a network.

The page is `template/page.html` with its style, its script and the rows of summary.json; the script builds the tables.
Thumbnails are loaded when they come into view, from the folder beside the page.
"""

from __future__ import annotations

import json
import math
import re
import statistics
from collections.abc import Callable, Sequence
from importlib.resources import files
from typing import Any
from urllib.parse import quote

from ....core import VERSION, Measure, Place, measures_in, unit_of
from ....core.files.mesh_files import PAGE
from ..files import DONE, THUMBNAILS
from .rows import NOTES_BETWEEN, SummaryRow, counts, measures_of_rows, present_values

TEMPLATE = files(__package__) / "template"
RELOAD_SECONDS = 10  # An open page reloads itself this often while the batch runs.
MOST_BINS = 30


def html_text(rows: Sequence[SummaryRow], over: bool) -> str:
    """Return the page; it links only thumbnails and pages of cases beside it."""
    # Without "<" no text in the JSON ends its element.
    batch = json.dumps(_page_content(rows), ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")
    refresh = "" if over else f'<meta http-equiv="refresh" content="{RELOAD_SECONDS}">\n'
    template, style, script = ((TEMPLATE / f"page.{kind}").read_text("utf-8") for kind in ("html", "css", "js"))
    parts = {"refresh": refresh, "style": style, "script": script, "batch": batch}
    return re.sub(r"\{\{(\w+)\}\}", lambda mark: parts[mark[1]], template)


def _page_content(rows: Sequence[SummaryRow]) -> dict[str, Any]:
    """Return the data of the script: the rows of summary.json with texts and links, and totals of each label."""
    shown, of_labels = (measures_of_rows(place, rows) for place in (Place.PAGE, Place.LABELS))
    return {
        "title": counts(rows),
        "version": VERSION,
        "notes_between": NOTES_BETWEEN,
        "measures": [  # Those that all surfaces must fulfil are truth values.
            {"head": each.head, "columns": list(each.cells(None)), "number": each.summed != "all"} for each in shown
        ],
        "surface_heads": [each.head for each in of_labels],
        "rows": [_page_row(row, shown, of_labels) for row in rows],
        "cohorts": [_cohort(group) for group in _by_label(rows)],
    }


def _page_row(row: SummaryRow, shown: Sequence[Measure], of_labels: Sequence[Measure]) -> dict[str, Any]:
    """Return a row of summary.json with its texts for a person, and the links to its page and thumbnail."""
    content = row.plain() | {"texts": [row.text(each) for each in shown]}
    for surface, values in zip(content.get("surfaces", ()), row.surfaces, strict=True):
        measured = [(each, values.get(each.name)) for each in of_labels]
        surface["texts"] = ["" if value is None else each.text(value) for each, value in measured]
    has_page = row.status == DONE and row.page
    content["page"] = quote(f"{row.case}{PAGE}") if has_page else None
    content["picture"] = quote(f"{THUMBNAILS}/{row.case}.png") if row.thumbnail else None
    return content


def _by_label(rows: Sequence[SummaryRow]) -> list[list[SummaryRow]]:
    """Return the rows that are done, grouped by their label, in the order of the labels."""
    groups: dict[int | None, list[SummaryRow]] = {}
    for row in rows:
        if row.status == DONE:
            groups.setdefault(row.label, []).append(row)
    return [groups[label] for label in sorted(groups, key=lambda label: -1 if label is None else label)]


def _cohort(rows: Sequence[SummaryRow]) -> dict[str, Any]:
    """Return the totals and the histogram of all cases with a label."""
    return {"label": rows[0].label, "totals": _totals(rows), "histogram": histogram(present_values("volume_mm3", rows))}


def _totals(done: Sequence[SummaryRow]) -> list[list[str]]:
    """Return lines of texts: a name, the number of cases, sum, median, least and most."""
    seconds = [row.seconds for row in done if row.seconds is not None]
    memory = [row.memory_bytes / (1 << 20) for row in done if row.memory_bytes is not None]
    measured: list[tuple[str, Sequence[float], Callable[[float], str]]] = [
        *((each.head, present_values(each.name, done), each.text) for each in measures_in(Place.TOTALS)),
        ("seconds", seconds, _short),
    ]
    lines = [
        [name, str(len(values)), *(text(fact(values)) for fact in (sum, statistics.median, min, max))]
        for name, values, text in measured
        if values
    ]
    if memory:  # Its sum says nothing.
        facts = (_short(fact(memory)) for fact in (statistics.median, min, max))
        lines.append(["memory, MiB", str(len(memory)), "", *facts])
    return lines


def _short(number: float) -> str:
    """Return a number for a person.

    Examples
    --------
    >>> _short(1234567.0), _short(1423.64), _short(0.51234)
    ('1234567', '1423.6', '0.512')
    """
    if number == int(number):
        return f"{int(number)}"
    return f"{number:.1f}" if abs(number) >= 100 else f"{number:.3g}"


def bins_of(values: Sequence[float]) -> tuple[float, float, list[int]]:
    """Return the start of a histogram, the width of its bins, and the number of values in each.

    Bins are 1, 2 or 5 times a power of ten wide, about as many as the square root of the number of values, twice.

    Examples
    --------
    >>> bins_of([1.0, 2.0, 2.5, 9.0])
    (0.0, 2.0, [1, 2, 0, 0, 1])
    """
    low, high = min(values), max(values)
    bins = min(MOST_BINS, 2 * math.isqrt(len(values)))
    rough = (high - low) / bins or abs(high) or 1.0
    power = 10.0 ** math.floor(math.log10(rough))
    width = next(power * step for step in (1, 2, 5, 10) if power * step >= rough * (1 - 1e-9))
    first, last = math.floor(low / width), math.floor(high / width)
    heights = [0] * (last - first + 1)
    for value in values:
        heights[min(last, max(first, math.floor(value / width))) - first] += 1
    return first * width, width, heights


def histogram(volumes_mm3: Sequence[float]) -> dict[str, Any] | None:
    """Return a histogram of volumes in the unit that fits the largest; None for fewer than two."""
    if len(volumes_mm3) < 2:
        return None
    unit = unit_of(max(volumes_mm3), "mm3")
    start, width, heights = bins_of([volume / unit.size for volume in volumes_mm3])
    return {"start": start, "width": width, "heights": heights, "unit": unit.name, "cases": len(volumes_mm3)}
