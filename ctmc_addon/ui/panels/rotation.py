# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the closed panel Rotation Test: levels, step, rounds, and the table."""

from __future__ import annotations

from typing import Any

import bpy

from .. import jobs
from ..state import session
from ..translations import translate
from .layout import SubPanel, draw_job, draw_pair, prepare


class CTMC_PT_rotation(SubPanel, bpy.types.Panel):
    """Panel for the timed turntable."""

    bl_idname = "CTMC_PT_rotation"
    bl_label = "Rotation Test"

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout.column(), context.scene.ctmc
        prepare(self.layout, lock=False)
        prepare(layout)
        for name in ("rotation_kind", "rotation_levels", "rotation_step", "rotation_rounds"):
            layout.prop(settings, name)
        job = jobs.running("ctmc.rotation_test")
        if job is not None:
            draw_job(self.layout, job)
        else:
            self.layout.operator("ctmc.rotation_test", icon="FILE_3D")
        layout = self.layout.column()
        layout.enabled = not jobs.locked()
        table = session.of(context.scene).rotation
        if table is not None:
            draw_table(layout, table.rows(translate("Round"), translate("Average"), translate("Saving")))
            row = draw_pair(layout, context)
            row.operator("ctmc.rotation_copy", icon="COPYDOWN")
            row.operator("ctmc.rotation_save", icon="FILE_TICK")


def draw_table(layout: Any, rows: list[list[str]]) -> None:
    """Draw text in columns."""
    flow = layout.box().grid_flow(row_major=True, columns=len(rows[0]), even_columns=True, align=True)
    for row in rows:
        for cell in row:
            flow.label(text=cell, translate=False)


register, unregister = bpy.utils.register_classes_factory((CTMC_PT_rotation,))
