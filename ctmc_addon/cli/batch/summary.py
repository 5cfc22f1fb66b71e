# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of a batch as CSV, JSON and HTML, each written whole whenever a case is over."""

from __future__ import annotations

import base64
import html
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any
from urllib.parse import quote

from ...core import VERSION, OutputError
from ...core.files.atomic_write import write_csv, write_json, write_text
from ...core.files.mesh_files import PAGE
from .files import read_record, thumbnail_path

SUMMARY_FILES = AS_JSON, AS_CSV, AS_PAGE = "summary.json", "summary.csv", "summary.html"
LABELS_FILE = "labels.csv"  # written where a case has several labels
# Of each of several surfaces.
MEASURES = ("label", "name", "faces", "volume_mm3", "area_mm2", "parts", "closed", "self_intersections")
REFRESH = 10  # seconds after which an open page looks again while the batch runs
STYLE = (
    "body{font:15px system-ui,sans-serif;margin:2em;color:#222}table{border-collapse:collapse}"
    "th,td{padding:.3em .8em;border-bottom:1px solid #ddd;text-align:right}"
    "th:nth-child(2),td:nth-child(2),th:last-child,td:last-child{text-align:left}"
    "img{display:block;width:120px;height:90px}.failed{color:#b00020}.absent{color:#777}"
)


@dataclass
class SummaryRow:
    """One output; `status` is waiting, running, done, absent or failed, and what is not known is None."""

    case: str
    status: str = "waiting"
    faces: int | None = None
    volume_mm3: float | None = None
    self_intersections: int | None = None
    seconds: float | None = None
    error: str | None = None
    removed_components: int | None = None
    collapsed_components: int | None = None
    collapsed_mm3: float | None = None
    surfaces: list[dict[str, Any]] = field(default_factory=list)  # only of a case with several labels

    def fill(self, record: dict[str, Any] | None) -> None:
        """Fill the row from an output's JSON."""
        if record is None:
            self.status, self.error = "failed", "the case left no JSON; is the disk full?"
            return
        self.status = record["status"]
        self.faces, self.volume_mm3 = record["faces"], record["volume_mm3"]
        self.seconds, self.error = record["seconds"], record["error"]
        self.self_intersections = record.get("self_intersections")  # not in records of older versions
        surfaces = record.get("surfaces", ())
        self.surfaces = [{name: surface.get(name) for name in MEASURES} for surface in surfaces]
        made = [each for each in surfaces or [record] if "collapsed_components" in each]
        if made:
            collapsed = [each["collapsed_components"] for each in made]
            self.removed_components = sum(each["removed_components"] for each in made)
            self.collapsed_components = sum(each["count"] for each in collapsed)
            self.collapsed_mm3 = sum(each["mm3"] for each in collapsed)


def write_summary(folder: Path, rows: Sequence[SummaryRow], over: bool) -> None:
    """Write summary.csv, summary.json and summary.html.

    Parameters
    ----------
    folder : Path
        Of the batch.
    rows : sequence of SummaryRow
    over : bool
        Whether the batch is; while it runs, a file that cannot be replaced is left until the next case is over,
        as a spreadsheet that has summary.csv open keeps others from it on Windows.
    """
    plain = [{name: value for name, value in asdict(row).items() if name != "surfaces" or value} for row in rows]
    cases = [{name: value for name, value in row.items() if name != "surfaces"} for row in plain]
    labels = [{"case": row.case, **surface} for row in rows for surface in row.surfaces]
    files: list[tuple[Callable[..., None], str, tuple[Any, ...]]] = [
        (write_json, AS_JSON, (plain,)),
        (write_csv, AS_CSV, (cases, [field.name for field in fields(SummaryRow) if field.name != "surfaces"])),
        (write_text, AS_PAGE, (html_text(folder, rows, over),)),
    ]
    if labels:
        files.append((write_csv, LABELS_FILE, (labels, ["case", *MEASURES])))
    for write, name, content in files:
        try:
            write(folder / name, *content)
        except OutputError:
            if over:
                raise


def write_summary_if_possible(folder: Path, rows: Sequence[SummaryRow]) -> None:
    """Write the last summary of a batch that is interrupted; on a full disk the older one stays."""
    try:
        write_summary(folder, rows, True)
    except OutputError:
        pass


def html_text(folder: Path, rows: Sequence[SummaryRow], over: bool) -> str:
    """One page that needs no other file, the thumbnails inside it."""
    refresh = "" if over else f'<meta http-equiv="refresh" content="{REFRESH}">'
    lines = [
        f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">{refresh}',
        f"<title>CTMC batch</title><style>{STYLE}</style></head><body>",
        f"<h1>{counts(rows)}</h1><p>ctmc {VERSION}</p><table>",
        "<tr><th></th><th>case</th><th>status</th><th>triangles</th><th>volume, ml</th>"
        "<th>self-intersections</th><th>seconds</th><th>error</th>"
        "</tr>",
        *(html_row(folder, row) for row in rows),
        "</table></body></html>",
    ]
    return "\n".join(lines) + "\n"


def html_row(folder: Path, row: SummaryRow) -> str:
    """One case with its picture, if it has one."""
    cells = [
        picture(folder, row),
        case_link(folder, row) + labels_table(row),
        row.status,
        *numbers(row),
        html.escape(row.error or ""),
    ]
    return f'<tr class="{row.status}">' + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"


def case_link(folder: Path, row: SummaryRow) -> str:
    """The name of a case, which leads to its page if it has one."""
    name, page = html.escape(row.case), f"{row.case}{PAGE}"
    if row.status != "done" or page not in ((read_record(folder, row.case) or {}).get("files") or ()):
        return name
    return f'<a href="{html.escape(quote(page))}">{name}</a>'


def labels_table(row: SummaryRow) -> str:
    """Return the surfaces of several labels, to be unfolded."""
    if not row.surfaces:
        return ""
    lines = [
        f"<tr><td>{html.escape(surface['name'])}</td><td>{surface['faces']}</td><td>{milliliters(surface)}</td></tr>"
        for surface in row.surfaces
    ]
    head = "<tr><th>label</th><th>triangles</th><th>volume, ml</th></tr>"
    return f"<details><summary>{len(lines)} surfaces</summary><table>{head}{''.join(lines)}</table></details>"


def milliliters(surface: Mapping[str, Any]) -> str:
    """Return the volume of a surface for a person."""
    return "-" if surface["volume_mm3"] is None else f"{surface['volume_mm3'] / 1000:.3f}"


def picture(folder: Path, row: SummaryRow) -> str:
    """Return the thumbnail as part of the page."""
    if row.status != "done":
        return ""
    try:
        png = thumbnail_path(folder, row.case).read_bytes()
    except OSError:
        return ""
    return f'<img alt="" src="data:image/png;base64,{base64.b64encode(png).decode("ascii")}">'


def numbers(row: SummaryRow) -> list[str]:
    """Triangles, milliliters, self-intersections and seconds for a person; an open surface has no volume."""
    return [
        "" if row.faces is None else f"{row.faces}",
        f"{row.volume_mm3 / 1000:.3f}" if row.volume_mm3 is not None else "-" if row.faces else "",
        "" if row.self_intersections is None else f"{row.self_intersections}",
        "" if row.seconds is None else f"{row.seconds:.1f}",
    ]


def counts(rows: Sequence[SummaryRow]) -> str:
    """Return how many are in each state: '20 cases: 17 done, 2 absent, 1 failed'."""
    states = [row.status for row in rows]
    order = ("done", "absent", "failed", "running", "waiting")
    texts = [f"{states.count(state)} {state}" for state in order if state in states]
    return f"{len(rows)} case{'s' * (len(rows) != 1)}: {', '.join(texts)}"


def row_of(folder: Path, name: str) -> SummaryRow:
    """Return the row of an output that is over."""
    row = SummaryRow(name)
    row.fill(read_record(folder, name))
    return row
