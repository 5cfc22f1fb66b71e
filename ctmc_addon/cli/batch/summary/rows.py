# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the summary's row for each output, with a column for each field and units in the names."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ....core import PRINT_MEASURES, Measure, Place, columns_in, combined, measures_in
from ....core.files.mesh_files import PAGE
from ..files import ABSENT, DONE, FAILED, RUNNING, WAITING, thumbnail_path

NOTES_BETWEEN = " | "
SHOWN = Place.BATCH | Place.PAGE | Place.TOTALS | Place.LINE


@dataclass
class SummaryRow:
    """One output; `status` is waiting, running, done, absent or failed, and what is not known is None.

    `values` are its measures by name, of several surfaces combined.
    """

    case: str
    status: str = WAITING
    values: dict[str, Any] = field(default_factory=dict)
    seconds: float | None = None
    error: str | None = None
    label: int | None = None
    spacing_x_mm: float | None = None
    spacing_y_mm: float | None = None
    spacing_z_mm: float | None = None
    memory_bytes: int | None = None
    notes: str = ""
    outlier: str = ""
    of_case: str = ""  # Name of the case, which has a row for each output.
    surfaces: list[dict[str, Any]] = field(default_factory=list)  # Filled for a case with several labels.
    page: bool = False  # True if the case has a page.
    thumbnail: bool = False
    maps: dict[str, str] = field(default_factory=dict)  # Units of the maps, by name.
    printed: frozenset[str] = frozenset()  # Names of the measures of parts for print that are known.
    labels_as_one: bool = False  # Otsu's threshold made one surface of all labels

    def fill(self, record: Mapping[str, Any] | None, folder: Path | None = None) -> None:
        """Fill the row from an output's JSON, and say whether its page and thumbnail lie in the folder."""
        if record is None:
            self.status, self.error = FAILED, "the case left no JSON; is the disk full?"
            return
        self.status, self.seconds, self.error = record["status"], record["seconds"], record["error"]
        self.label = record.get("settings", {}).get("label")
        record = _with_print(record)
        surfaces = [_with_print(surface) for surface in record.get("surfaces", ())]
        every = surfaces or [record]
        self.printed = frozenset(
            each.name for each in PRINT_MEASURES if any(facts.get(each.name) is not None for facts in every)
        )
        self.maps = {each["name"]: each["unit"] for facts in every for each in facts.get("maps", ())}
        kept = (*OWN_OF_LABELS, *(each.name for each in self.measures_in(Place.LABELS)))
        self.surfaces = [{name: surface.get(name) for name in kept} for surface in surfaces]
        self.values = {each.name: _of_all(each, record, surfaces) for each in self.measures_in(SHOWN)}
        first = surfaces[0] if surfaces else record
        self.spacing_x_mm, self.spacing_y_mm, self.spacing_z_mm = first.get("spacing_mm") or (None, None, None)
        self.memory_bytes = record.get("memory_bytes")
        self.notes = NOTES_BETWEEN.join(record.get("notes", ()))
        self.page = f"{self.case}{PAGE}" in (record.get("files") or ())
        self.labels_as_one = bool(record.get("labels_as_one"))
        self.thumbnail = folder is not None and self.status == DONE and thumbnail_path(folder, self.case).is_file()

    def measures_in(self, place: Place) -> tuple[Measure, ...]:
        """Return the measures that a place shows of it."""
        return measures_in(place, self.maps.items(), printed=self.printed)

    def columns(self) -> dict[str, Any]:
        """Return the cells of the CSV and the JSON."""
        measures = _columns(self.measures_in(Place.BATCH), self.values)
        names = dict.fromkeys([*COLUMNS, *measures])
        return {name: measures[name] if name in measures else getattr(self, name) for name in names}

    def plain(self) -> dict[str, Any]:
        """Return the row as the JSON has it: its cells, and those of each of several surfaces."""
        return self.columns() | ({"surfaces": self.label_rows()} if self.surfaces else {})

    def label_rows(self) -> list[dict[str, Any]]:
        """Return the cells of the CSV of labels and of the JSON, for each of several surfaces."""
        shown = self.measures_in(Place.LABELS)
        measures = [_columns(shown, surface) for surface in self.surfaces]
        cells = [surface | own for surface, own in zip(self.surfaces, measures, strict=True)]
        names = dict.fromkeys([*LABEL_COLUMNS, *(measures[0] if measures else ())])
        return [{name: surface[name] for name in names} for surface in cells]

    def text(self, about: Measure) -> str:
        """Return a measure for a person; a dash for the volume of a surface that has none."""
        value = self.values.get(about.name)
        has_none = about.unit == "mm3" and bool(self.values.get("faces"))
        return about.text(value) if value is not None or has_none else ""


# Scripts read these: their order stays, and new measures follow.
COLUMNS = columns_in(
    Place.BATCH,
    (
        "case", "status", "faces", "volume_mm3", "seconds", "error", "label", "components", "closed", "area_mm2",
        "spacing_x_mm", "spacing_y_mm", "spacing_z_mm", "self_intersections", "removed_components",
        "collapsed_components", "collapsed_mm3", "mean_hu", "sd_hu", "memory_bytes", "notes", "outlier",
    ),
)  # fmt: skip
OWN_OF_LABELS = ("label", "name")
LABEL_COLUMNS = columns_in(Place.LABELS, (*OWN_OF_LABELS, "faces", "volume_mm3", "area_mm2", "components", "closed"))


def _with_print(record: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a record in which the facts of a part for print stand beside the rest."""
    return {**(record.get("print") or {}), **record}


def _columns(measures: Sequence[Measure], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return measures by column."""
    return {column: cell for each in measures for column, cell in each.cells(values.get(each.name)).items()}


def measures_of_rows(place: Place, rows: Sequence[SummaryRow]) -> tuple[Measure, ...]:
    """Return the measures that a place shows of any row, those of maps last."""
    maps = {name: unit for row in rows for name, unit in row.maps.items()}
    return measures_in(place, maps.items(), printed=frozenset().union(*(row.printed for row in rows)))


def _of_all(about: Measure, record: Mapping[str, Any], surfaces: Sequence[Mapping[str, Any]]) -> Any:
    """Return a measure of an output: from its JSON, else combined from its surfaces."""
    if about.name in record:
        return record[about.name]
    return combined(about, [surface.get(about.name) for surface in surfaces])


def present_values(name: str, rows: Sequence[SummaryRow]) -> list[float]:
    """Return a measure of the rows that have it as a finite number."""
    return [value for row in rows if (value := row.values.get(name)) is not None and math.isfinite(value)]


def amount(rows: Sequence[SummaryRow]) -> str:
    """Return the number of rows: '20 cases', or '40 outputs' if cases have several."""
    what = "case" if len({row.of_case or row.case for row in rows}) == len(rows) else "output"
    return f"{len(rows)} {what}{'s' * (len(rows) != 1)}"


def counts(rows: Sequence[SummaryRow]) -> str:
    """Return the number of rows in each state: '20 cases: 17 done, 2 absent, 1 failed'."""
    states = [row.status for row in rows]
    order = (DONE, ABSENT, FAILED, RUNNING, WAITING)
    texts = [f"{states.count(state)} {state}" for state in order if state in states]
    cases = len({row.of_case or row.case for row in rows})
    of_cases = f" of {cases} case{'s' * (cases != 1)}" if cases != len(rows) else ""
    return f"{amount(rows)}{of_cases}: {', '.join(texts)}"
