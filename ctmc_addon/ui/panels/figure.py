# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the closed panel Figure: contents, page, look, and the button."""

from __future__ import annotations

from typing import Any

import bpy

from .. import jobs
from ..operators.figure import shown_surfaces
from ..properties.figure import FRAMES
from ..translations import OURS, translate
from .layout import SubPanel, draw_job, prepare
from .render import draw_render

OPERATORS = {
    "figure": "ctmc.figure",
    "sheet": "ctmc.figure_sheet",
    "deviation": "ctmc.figure_deviation",
    "turntable": "ctmc.figure_turntable",
}


class CTMC_PT_figure(SubPanel, bpy.types.Panel):
    """Panel for figures for print."""

    bl_idname = "CTMC_PT_figure"
    bl_label = "Figure"

    def draw(self, context: bpy.types.Context) -> None:
        panel = context.scene.ctmc_figure
        prepare(self.layout, lock=False)
        layout = self.layout.column()
        prepare(layout)
        layout.prop(panel, "kind")
        _draw_subject(layout, panel)
        _draw_page(layout, panel)
        _draw_look(layout, context, panel)
        job = jobs.running(*OPERATORS.values())
        if job is not None:
            draw_job(self.layout, job)
        else:
            self.layout.operator(OPERATORS[panel.kind], icon="RENDER_STILL")
        draw_render(self.layout, context)


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
    """Draw style, engine, camera and writing."""
    column = layout.column()
    mapped = panel.kind == "deviation" or (panel.kind == "sheet" and panel.sheet_deviation)
    style = column.column()
    style.active = not mapped
    style.prop(panel, "style")
    column.prop(panel, "engine")
    if panel.kind in ("figure", "turntable") and len(shown_surfaces(context)) > 1:
        column.prop(panel, "hiding_opacity", slider=True)
    angles = layout.column(align=True)
    angles.operator_menu_enum("ctmc.figure_view", "side", icon="CAMERA_DATA")
    angles.prop(panel, "azimuth")
    angles.prop(panel, "elevation")
    column = layout.column(heading=translate("Show"), heading_ctxt=OURS)
    column.prop(panel, "scale_bar")
    column.prop(panel, "orientation")
    _draw_switched(layout, panel, "caption")
    layout.prop(panel, "write_blend")


register, unregister = bpy.utils.register_classes_factory((CTMC_PT_figure,))
