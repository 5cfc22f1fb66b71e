# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the page Draw: structures from clicks and strokes, the tools, and edits of a whole structure."""

from __future__ import annotations

from typing import Any

import bpy

from ...core.volume import ValueKind
from ..operators.ct.slice_object import other_mode_text
from ..properties.surface.structures import LABEL
from ..state.ct import volumes
from ..state.draw import drawings
from ..state.draw.tools import tool_of
from ..translations import translate
from ..viewport.draw.draw_tools import TOOLS
from .layout import PagePanel, begin, draw_pair, draw_status, draw_text, holds_hu, is_narrow


class CTMC_PT_draw(PagePanel, bpy.types.Panel):
    """Page for structures that are drawn on the CT."""

    bl_idname = "CTMC_PT_draw"
    bl_label = "Draw"
    page = "DRAW"

    def draw(self, context: bpy.types.Context) -> None:
        layout, drawing = begin(self.layout), context.scene.ctmc_draw
        volume = volumes.current(context.scene)
        if volume is None or volume.kind == ValueKind.LABEL:
            text = "Load a CT first" if volume is None else "Load the CT of these labels first"
            layout.label(text=translate(text), icon="INFO", translate=False)
            draw_status(self.layout, context)
            return
        draw_tools(layout, context)
        draw_structures(layout, context.scene.ctmc)
        draw_settings(layout, context, drawing)
        _draw_edits(layout, context, drawing)
        draw_status(self.layout, context)


def draw_tools(layout: Any, context: bpy.types.Context) -> None:
    """Draw a button for each tool; the active one is pressed."""
    active = tool_of(context)
    column = layout.column(align=True)
    for pair in (TOOLS[:2], TOOLS[2:]):
        row = column.column(align=True) if is_narrow(context) else column.row(align=True)
        for tool in pair:
            button = row.operator("ctmc.draw_tool", text=tool.bl_label, depress=tool.bl_idname == active)
            button.tool = tool.bl_idname
    column.operator("ctmc.quad_view", icon="VIEW_ORTHO")


def draw_structures(layout: Any, settings: Any) -> None:
    """Draw the list of drawn structures, with buttons to add and to remove."""
    row = layout.row()
    row.template_list("CTMC_UL_drawn", "", settings, "labels", settings, "label_index", rows=3)
    column = row.column(align=True)
    column.operator("ctmc.draw_add", text="", icon="ADD")
    column.operator("ctmc.remove_structure", text="", icon="REMOVE")


def draw_settings(layout: Any, context: bpy.types.Context, drawing: Any) -> None:
    """Draw the settings of the active tool."""
    tool = tool_of(context)
    column = layout.column(align=True)
    if tool in ("ctmc.brush", "ctmc.eraser"):
        column.prop(drawing, "radius_mm")
        column.prop(drawing, "ball")
        column.prop(drawing, "on_surfaces")
    elif tool == "ctmc.scissors":
        column.prop(drawing, "depth_mm")
    else:
        column.prop(drawing, "method")
        column.prop(drawing, "hu_per_mm" if drawing.method == "compete" else "opening_mm")
        column.prop(drawing, "reach_mm")
    column = layout.column(align=True)
    needs_range = drawing.method == "connected" and tool not in ("ctmc.brush", "ctmc.eraser", "ctmc.scissors")
    row = column.row()
    row.enabled = not needs_range
    row.prop(drawing, "use_range")
    limits = column.column(align=True)
    limits.active = drawing.use_range or needs_range
    unit = " [HU]" if holds_hu(context.scene) else ""
    limits.prop(drawing, "low", text=translate("From") + unit, translate=False)
    limits.prop(drawing, "high", text=translate("To") + unit, translate=False)


def _draw_edits(layout: Any, context: bpy.types.Context, drawing: Any) -> None:
    """Draw the edits of the whole structure: each button with its number."""
    column = layout.column(align=True)
    column.use_property_split = False
    row = draw_pair(column, context)
    row.operator("ctmc.draw_margin", icon="MOD_SOLIDIFY")
    row.prop(drawing, "margin_mm", text="")
    row = draw_pair(column, context)
    row.operator("ctmc.draw_islands", text="Islands", icon="STICKY_UVS_DISABLE")
    row.prop(drawing, "islands_mm3", text="mm3", translate=False)
    row = draw_pair(column, context)
    row.operator("ctmc.draw_islands", text="Largest Only", icon="SHADING_BBOX").largest = True
    row.operator("ctmc.draw_holes", icon="MESH_CIRCLE")
    column.operator("ctmc.draw_between", icon="IPO_EASE_IN_OUT")
    settings = context.scene.ctmc
    if sum(line.kind == LABEL for line in settings.labels) > 1:
        column = layout.column(align=True)
        column.prop(drawing, "combination")
        column.prop_search(drawing, "other", settings, "labels")
        column.operator("ctmc.draw_combine", icon="SELECT_EXTEND")
    if context.mode != "OBJECT":
        draw_text(layout, context, translate(other_mode_text(context)), "INFO")
    elif drawings.active(context.scene) is None:
        draw_text(layout, context, translate("Choose Grow and click on a slice, or draw with the brush"), "INFO")


class CTMC_UL_drawn(bpy.types.UIList):
    """A line of a drawn structure: its eye, color and name."""

    bl_idname = "CTMC_UL_drawn"

    def filter_items(self, context: Any, data: Any, name: str) -> tuple[list[int], list[int]]:
        """Show only the lines of drawn structures."""
        lines = getattr(data, name)
        return [self.bitflag_filter_item * (drawings.drawn_by(context.scene, line) is not None) for line in lines], []

    def draw_item(
        self,
        context: Any,
        layout: Any,
        _data: Any,
        item: Any,
        _icon: int,
        _active_data: Any,
        _active_property: str,
        _index: int,
        _flag: int,
    ) -> None:
        drawn = drawings.drawn_by(context.scene, item)
        row = layout.row(align=True)
        row.use_property_split = False
        if drawn is not None:
            row.prop(drawn, "shown", text="", icon="HIDE_OFF" if drawn.shown else "HIDE_ON", emboss=False)
        color = row.row()
        color.ui_units_x = 1.2
        color.prop(item, "color", text="")
        row.prop(item, "name", text="", emboss=False, placeholder=translate("Name"))


register, unregister = bpy.utils.register_classes_factory((CTMC_UL_drawn,))
