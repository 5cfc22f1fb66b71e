# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the table of a batch as CSV, JSON and HTML, each as a whole, repeatedly while cases end."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ....core import OutputError
from ....core.files.atomic_write import write_csv, write_json, write_text
from .outliers import mark_outliers
from .page import html_text
from .rows import COLUMNS, LABEL_COLUMNS, SummaryRow

SUMMARY_FILES = AS_JSON, AS_CSV, AS_PAGE = "summary.json", "summary.csv", "summary.html"
LABELS_FILE = "labels.csv"  # It is written if a case has several labels.


def write_summary(folder: Path, rows: Sequence[SummaryRow], over: bool) -> None:
    """Write summary.csv, summary.json and summary.html.

    Parameters
    ----------
    folder : Path
        Of the batch.
    rows : sequence of SummaryRow
        Which of them are outliers is found here.
    over : bool
        Whether the batch is; while it runs, a file that cannot be replaced is left until the next time,
        as a spreadsheet that has summary.csv open keeps others from it on Windows.
    """
    mark_outliers(rows)
    labels = [{"case": row.case, **surface} for row in rows for surface in row.label_rows()]
    files: list[tuple[Callable[..., None], str, tuple[Any, ...]]] = [
        (write_json, AS_JSON, ([row.plain() for row in rows],)),
        (write_csv, AS_CSV, _with_all_columns([row.columns() for row in rows], COLUMNS)),
        (write_text, AS_PAGE, (html_text(rows, over),)),
    ]
    if labels:
        files.append((write_csv, LABELS_FILE, _with_all_columns(labels, ("case", *LABEL_COLUMNS))))
    else:
        _remove_labels_file(folder)
    for write, name, content in files:
        try:
            write(folder / name, *content)
        except OutputError:
            if over:
                raise


def _with_all_columns(
    lines: Sequence[Mapping[str, Any]], first: Sequence[str]
) -> tuple[list[dict[str, Any]], tuple[str, ...]]:
    """Return lines with one set of columns: `first`, then those of any line, empty where a line has none."""
    columns = tuple(dict.fromkeys([*first, *(name for line in lines for name in line)]))
    return [{name: line.get(name) for name in columns} for line in lines], columns


def _remove_labels_file(folder: Path) -> None:
    """Remove a table of labels that an older run left; any other file of that name stays."""
    path = folder / LABELS_FILE
    with suppress(OSError, UnicodeDecodeError):
        with path.open(encoding="utf-8") as stream:
            head = stream.readline().rstrip("\n").split(",")
        if head[:4] == ["case", *LABEL_COLUMNS[:3]]:  # other versions have others after these
            path.unlink()


def write_summary_if_possible(folder: Path, rows: Sequence[SummaryRow]) -> None:
    """Write the last summary of a batch that is interrupted; on a full disk the older one stays."""
    try:
        write_summary(folder, rows, True)
    except OutputError:
        pass
