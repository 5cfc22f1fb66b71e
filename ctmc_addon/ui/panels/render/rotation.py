# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the rotation test on the page Render: levels, step, rounds, and the table."""

from __future__ import annotations

from typing import Any

import bpy

from ... import jobs
from ...state import session
from ...translations import translate
from ..layout import block, draw_job, draw_pair


def draw_rotation(room: Any, context: bpy.types.Context) -> None:
    """Draw the settings of the timed turntable, its button and its table."""
    layout, settings = block(room), context.scene.ctmc
    for name in ("rotation_kind", "rotation_levels", "rotation_step", "rotation_rounds"):
        layout.prop(settings, name)
    job = jobs.running("ctmc.rotation_test")
    if job is not None:
        draw_job(room, job)
    else:
        room.operator("ctmc.rotation_test", icon="FILE_3D")
    layout = block(room)
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
