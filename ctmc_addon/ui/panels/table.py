# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the closed panel Measurements: measures of all surfaces, the same as those of `ctmc measure`."""

from __future__ import annotations

import bpy

from ...core import HU, Place, StructureRow, measures_in
from ...core.volume import ValueKind
from .. import jobs
from ..state import session
from ..translations import translate
from .layout import SubPanel, draw_job, draw_name, draw_pair, prepare
from .results import measure_text

TABLE = "ctmc.table"


class CTMC_PT_table(SubPanel, bpy.types.Panel):
    """Panel with a row for every surface."""

    bl_idname = "CTMC_PT_table"
    bl_label = "Measurements"

    def draw(self, context: bpy.types.Context) -> None:
        prepare(self.layout, lock=False)
        job = jobs.running(TABLE)
        if job is not None:
            draw_job(self.layout, job)
        else:
            self.layout.operator(TABLE, icon="DRIVER_DISTANCE")
        layout = self.layout.column()
        layout.enabled = not jobs.locked()
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
    unit = HU if kind == ValueKind.HU else ""
    return [
        (translate(each.label), measure_text(each, row.surface, unit))
        for each in measures_in(Place.TABLE)
        if each.unit != HU or row.surface.inside is not None
    ]


register, unregister = bpy.utils.register_classes_factory((CTMC_PT_table,))
