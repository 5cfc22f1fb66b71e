# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the fold Measurements of the page Results: measures of all surfaces, the same as those of `ctmc measure`."""

from __future__ import annotations

from typing import Any

import bpy

from ....core import GY, HU, FinishedSurface, Measure, Place, StructureRow, measures_in, printed_of
from ....core.volume import ValueKind
from ....reporting.formatting import count
from ... import jobs
from ...state import session
from ...translations import translate
from ..layout import block, draw_job, draw_name, draw_pair

TABLE = "ctmc.table"


def draw_measurements(room: Any, context: bpy.types.Context) -> None:
    """Draw the button that measures every surface, and a box for each."""
    job = jobs.running(TABLE)
    if job is not None:
        draw_job(room, job)
    else:
        block(room).operator(TABLE, icon="DRIVER_DISTANCE")
    layout = block(room)
    table = session.of(context.scene).table
    if table is None:
        return
    rows, kind = table
    for row in rows:
        column = layout.box().column(align=True)
        column.scale_y = 0.85
        column.label(text=row.name, translate=False)
        for name, value in facts_of(row, kind):
            draw_name(column, name, 0.55).label(text=value, translate=False)
    row = draw_pair(layout, context)
    row.operator("ctmc.table_copy", icon="COPYDOWN")
    row.operator("ctmc.table_save", icon="FILE_TICK")


def facts_of(row: StructureRow, kind: ValueKind) -> list[tuple[str, str]]:
    """Return names and values of a row, without unknown gray values."""
    return [
        (translate(each.label), measure_text(each, row.surface, kind.mark))
        for each in measures_in(Place.TABLE, kind=kind, printed=printed_of([row.surface]))
        if each.unit != HU or row.surface.inside is not None
    ]


def measure_text(about: Measure, surface: FinishedSurface, unit: str = "") -> str:
    """Return a measure of a surface in the panel's language; `unit` is that of gray values."""
    value = about.value(surface)
    if about.unit == "mm3" and surface.measures is not None and not surface.measures.closed:
        return translate("- (open)")
    if isinstance(value, bool):
        return translate(about.text(value))
    if isinstance(value, int):
        return count(value)
    shown = {HU: unit, GY: GY}.get(about.unit, "")
    return f"{about.text(value)} {shown}".rstrip()
