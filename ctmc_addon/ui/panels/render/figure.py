# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw a figure for print on the page Render: contents, page, look, and the button."""

from __future__ import annotations

from typing import Any

import bpy

from ... import jobs
from ...operators.render.figure import shown_surfaces
from ...properties.render.figure import FRAMES
from ...translations import OURS, translate
from ..layout import block, draw_job

OPERATORS = {
    "figure": "ctmc.figure",
    "sheet": "ctmc.figure_sheet",
    "deviation": "ctmc.figure_deviation",
    "turntable": "ctmc.figure_turntable",
}


def draw_figure(room: Any, context: bpy.types.Context) -> None:
    """Draw the settings of a figure, and the button that makes it."""
    panel = context.scene.ctmc_figure
    layout = block(room)
    layout.prop(panel, "kind")
    _draw_subject(layout, panel)
    _draw_page(layout, panel)
    _draw_look(layout, context, panel)
    job = jobs.running(*OPERATORS.values())
    if job is not None:
        draw_job(room, job)
    else:
        room.operator(OPERATORS[panel.kind], icon="RENDER_STILL")


def _draw_subject(layout: Any, panel: Any) -> None:
    """Draw the contents of this kind of figure, and its own settings."""
    column = layout.column(align=True)
    if panel.kind == "sheet":
        for name in ("strides", "alphas", "levels"):
            _draw_switched(column, panel, name)
        layout.prop(panel, "sheet_deviation")
    elif panel.kind == "turntable":
        for name in ("film", "seconds", "fps", "revolutions"):
            column.prop(panel, name)
    if panel.kind == "deviation" or (panel.kind == "sheet" and panel.sheet_deviation):
        layout.prop(panel, "limit_mm")


def _draw_switched(layout: Any, panel: Any, name: str) -> None:
    """Draw a line of text behind its switch."""
    row = layout.row(heading=translate(panel.bl_rna.properties[name].name), heading_ctxt=OURS)
    row.prop(panel, f"use_{name}", text="")
    value = row.row()
    value.active = getattr(panel, f"use_{name}")
    value.prop(panel, name, text="")


def _draw_page(layout: Any, panel: Any) -> None:
    """Draw width, resolution and background."""
    kind = "figure" if panel.kind == "deviation" else panel.kind
    column = layout.column(align=True)
    column.prop(panel, f"{kind}_width_mm")
    column.prop(panel, f"{kind}_dpi")
    if panel.kind != "turntable" or panel.film == FRAMES:
        column.prop(panel, "transparent")
    column.prop(panel, "dark")


def _draw_look(layout: Any, context: bpy.types.Context, panel: Any) -> None:
    """Draw style, the camera's angles and writing; the engine is that of the page."""
    column = layout.column()
    mapped = panel.kind == "deviation" or (panel.kind == "sheet" and panel.sheet_deviation)
    style = column.column()
    style.active = not mapped
    style.prop(panel, "style")
    if panel.kind in ("figure", "turntable") and len(shown_surfaces(context)) > 1:
        column.prop(panel, "hiding_opacity", slider=True)
        column.prop(panel, "explode")
    angles = layout.column(align=True)
    angles.prop(panel, "azimuth")
    angles.prop(panel, "elevation")
    column = layout.column(heading=translate("Show"), heading_ctxt=OURS)
    column.prop(panel, "scale_bar")
    column.prop(panel, "orientation")
    _draw_switched(layout, panel, "caption")
    layout.prop(panel, "write_blend")
