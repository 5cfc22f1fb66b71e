"""The closed panel Figure: what is made, on which page, how it looks, and the button."""

from __future__ import annotations

from typing import Any

import bpy

from .. import jobs
from ..operators.figure import shown_surfaces
from ..properties.figure import FRAMES
from ..translations import OURS, translate
from .layout import SubPanel, draw_job, prepare

OPERATORS = {
    "figure": "ctmc.figure",
    "sheet": "ctmc.figure_sheet",
    "deviation": "ctmc.figure_deviation",
    "turntable": "ctmc.figure_turntable",
}


class CTMC_PT_figure(SubPanel, bpy.types.Panel):
    """Figures for print."""

    bl_idname = "CTMC_PT_figure"
    bl_label = "Figure"

    def draw(self, context: bpy.types.Context) -> None:
        """Kind, what it shows, page, look; then the button."""
        chosen = context.scene.ctmc_figure
        prepare(self.layout, lock=False)
        layout = self.layout.column()
        prepare(layout)
        layout.prop(chosen, "kind")
        draw_subject(layout, chosen)
        draw_page(layout, chosen)
        draw_look(layout, context, chosen)
        job = jobs.running(*OPERATORS.values())
        if job is not None:
            draw_job(self.layout, job)
        else:
            self.layout.operator(OPERATORS[chosen.kind], icon="RENDER_STILL")


def draw_subject(layout: Any, chosen: Any) -> None:
    """What this kind of figure is of, and what it alone asks for."""
    column = layout.column(align=True)
    if chosen.kind == "sheet":
        for name in ("strides", "alphas", "levels"):
            draw_switched(column, chosen, name)
        layout.prop(chosen, "sheet_deviation")
    elif chosen.kind == "turntable":
        for name in ("film", "seconds", "fps", "revolutions"):
            column.prop(chosen, name)
    if chosen.kind == "deviation" or (chosen.kind == "sheet" and chosen.sheet_deviation):
        layout.prop(chosen, "limit_mm")


def draw_switched(layout: Any, chosen: Any, name: str) -> None:
    """A line of text behind its switch."""
    row = layout.row(heading=translate(chosen.bl_rna.properties[name].name), heading_ctxt=OURS)
    row.prop(chosen, f"use_{name}", text="")
    value = row.row()
    value.active = getattr(chosen, f"use_{name}")
    value.prop(chosen, name, text="")


def draw_page(layout: Any, chosen: Any) -> None:
    """Width, resolution, background."""
    kind = "figure" if chosen.kind == "deviation" else chosen.kind
    column = layout.column(align=True)
    column.prop(chosen, f"{kind}_width_mm")
    column.prop(chosen, f"{kind}_dpi")
    if chosen.kind != "turntable" or chosen.film == FRAMES:
        column.prop(chosen, "transparent")


def draw_look(layout: Any, context: bpy.types.Context, chosen: Any) -> None:
    """Style, engine, camera, what is written."""
    column = layout.column()
    mapped = chosen.kind == "deviation" or (chosen.kind == "sheet" and chosen.sheet_deviation)
    style = column.column()
    style.active = not mapped
    style.prop(chosen, "style")
    column.prop(chosen, "engine")
    if chosen.kind in ("figure", "turntable") and len(shown_surfaces(context)) > 1:
        column.prop(chosen, "opacity", slider=True)
    angles = layout.column(align=True)
    angles.operator_menu_enum("ctmc.figure_view", "side", icon="CAMERA_DATA")
    angles.prop(chosen, "azimuth")
    angles.prop(chosen, "elevation")
    column = layout.column(heading=translate("Show"), heading_ctxt=OURS)
    column.prop(chosen, "scale_bar")
    column.prop(chosen, "orientation")
    draw_switched(layout, chosen, "caption")
    layout.prop(chosen, "write_blend")


register, unregister = bpy.utils.register_classes_factory((CTMC_PT_figure,))
