# SPDX-License-Identifier: GPL-3.0-or-later
"""What a summary knows of each output: a row with a column for each field, units in the names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from ....core.files.mesh_files import PAGE
from ..files import ABSENT, DONE, FAILED, RUNNING, WAITING, thumbnail_path

# Of each of several surfaces.
MEASURES = (
    "label", "name", "faces", "volume_mm3", "area_mm2", "components", "closed", "self_intersections",
    "mean_hu", "sd_hu",
)  # fmt: skip
NOTES_BETWEEN = " | "
HIDDEN = ("of_case", "surfaces", "page", "thumbnail", "labels_as_one")  # no columns


@dataclass
class SummaryRow:
    """One output; `status` is waiting, running, done, absent or failed, and what is not known is None.

    Columns are only added, at the end: scripts read them.
    """

    case: str
    status: str = WAITING
    faces: int | None = None
    volume_mm3: float | None = None
    seconds: float | None = None
    error: str | None = None
    label: int | None = None
    components: int | None = None
    closed: bool | None = None
    area_mm2: float | None = None
    spacing_x_mm: float | None = None
    spacing_y_mm: float | None = None
    spacing_z_mm: float | None = None
    self_intersections: int | None = None
    removed_components: int | None = None
    collapsed_components: int | None = None
    collapsed_mm3: float | None = None
    mean_hu: float | None = None
    sd_hu: float | None = None
    memory_bytes: int | None = None
    notes: str = ""
    outlier: str = ""
    of_case: str = ""  # the case, which has a row for each of its outputs
    surfaces: list[dict[str, Any]] = field(default_factory=list)  # only of a case with several labels
    page: bool = False  # whether there is a page of the case
    thumbnail: bool = False
    labels_as_one: bool = False  # Otsu's threshold made one surface of all labels

    def fill(self, record: Mapping[str, Any] | None, folder: Path | None = None) -> None:
        """Fill the row from an output's JSON, and say whether its page and thumbnail lie in the folder."""
        if record is None:
            self.status, self.error = FAILED, "the case left no JSON; is the disk full?"
            return
        self.status = record["status"]
        self.faces, self.volume_mm3 = record["faces"], record["volume_mm3"]
        self.seconds, self.error = record["seconds"], record["error"]
        self.label = record.get("settings", {}).get("label")
        surfaces = record.get("surfaces", ())
        self.surfaces = [{name: surface.get(name) for name in MEASURES} for surface in surfaces]
        of_all = surfaces[0] if surfaces else record
        self.components = total(surfaces or [record], "components")
        self.area_mm2 = total(surfaces or [record], "area_mm2")
        self.self_intersections = total(surfaces or [record], "self_intersections")
        made = [each for each in surfaces or [record] if "collapsed_components" in each]
        if made:
            collapsed = [each["collapsed_components"] for each in made]
            self.removed_components = sum(each["removed_components"] for each in made)
            self.collapsed_components = sum(each["count"] for each in collapsed)
            self.collapsed_mm3 = sum(each["mm3"] for each in collapsed)
        shapes = [surface.get("closed") for surface in surfaces or [record]]
        self.closed = None if None in shapes else all(shapes)
        self.spacing_x_mm, self.spacing_y_mm, self.spacing_z_mm = of_all.get("spacing_mm") or (None, None, None)
        inside = record if len(surfaces) != 1 else of_all
        self.mean_hu, self.sd_hu = inside.get("mean_hu"), inside.get("sd_hu")
        self.memory_bytes = record.get("memory_bytes")
        self.notes = NOTES_BETWEEN.join(record.get("notes", ()))
        self.page = f"{self.case}{PAGE}" in (record.get("files") or ())
        self.labels_as_one = bool(record.get("labels_as_one"))
        self.thumbnail = folder is not None and self.status == DONE and thumbnail_path(folder, self.case).is_file()

    def columns(self) -> dict[str, Any]:
        """Return what stands in the CSV and the JSON."""
        return {name: getattr(self, name) for name in COLUMNS}


COLUMNS = tuple(each.name for each in fields(SummaryRow) if each.name not in HIDDEN)


def total(surfaces: Sequence[Mapping[str, Any]], name: str) -> Any:
    """Return the sum over surfaces of what a report calls so; None where one does not say."""
    values = [surface.get(name) for surface in surfaces]
    known = [value for value in values if value is not None]
    return sum(known) if known and len(known) == len(values) else None


def amount(rows: Sequence[SummaryRow]) -> str:
    """Return how many rows there are: '20 cases', or '40 outputs' of as many or fewer cases."""
    what = "case" if len({row.of_case or row.case for row in rows}) == len(rows) else "output"
    return f"{len(rows)} {what}{'s' * (len(rows) != 1)}"


def counts(rows: Sequence[SummaryRow]) -> str:
    """Return how many are in each state: '20 cases: 17 done, 2 absent, 1 failed'."""
    states = [row.status for row in rows]
    order = (DONE, ABSENT, FAILED, RUNNING, WAITING)
    texts = [f"{states.count(state)} {state}" for state in order if state in states]
    cases = len({row.of_case or row.case for row in rows})
    of_cases = f" of {cases} case{'s' * (cases != 1)}" if cases != len(rows) else ""
    return f"{amount(rows)}{of_cases}: {', '.join(texts)}"


def numbers(row: SummaryRow) -> list[str]:
    """Triangles, milliliters, self-intersections and seconds for a person; an open surface has no volume."""
    return [
        "" if row.faces is None else f"{row.faces}",
        milliliters(row.volume_mm3) if row.volume_mm3 is not None else "-" if row.faces else "",
        "" if row.self_intersections is None else f"{row.self_intersections}",
        "" if row.seconds is None else f"{row.seconds:.1f}",
    ]


def milliliters(volume_mm3: float | None) -> str:
    """Return a volume for a person."""
    return "-" if volume_mm3 is None else f"{volume_mm3 / 1000:.3f}"
