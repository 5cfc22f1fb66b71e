# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the slice on the page CT: its position, window and level, objects of it; and cuts on the page Results."""

from __future__ import annotations

from typing import Any

import bpy

from ....blender.slices import is_slice
from ....core.volume import ValueKind, slice_at, slice_position_text
from ...state.ct import volumes
from ...translations import translate
from ..layout import block, draw_pair, draw_shape_change

# Window and level in HU, as radiologists set them.
WINDOWS = (("Bone", 2000.0, 300.0), ("Soft Tissue", 400.0, 40.0), ("Lung", 1500.0, -600.0))


def draw_slice(layout: Any, context: bpy.types.Context) -> None:
    """Draw plane, position, window and level of the slice in the viewport."""
    view, volume = context.scene.ctmc_view, volumes.current(context.scene)
    assert volume is not None, "the page asks for one"
    row = layout.row()
    row.use_property_split = False  # Three words need the whole width.
    row.prop(view, "plane", expand=True)
    row = layout.row(align=True)
    row.prop(view, "position", slider=True)
    row.operator("ctmc.slice_step", text="", icon="TRIA_LEFT").by = -1
    row.operator("ctmc.slice_step", text="", icon="TRIA_RIGHT").by = 1
    shown_slice = slice_at(volume, view.plane, view.position)
    text = translate("Slice {number} of {count}, {place}")
    position = slice_position_text(volume, shown_slice)
    text = text.format(number=shown_slice.index + 1, count=shown_slice.count, place=position)
    layout.label(text=text, translate=False)
    column = layout.column(align=True)
    column.active = not (
        volume.kind == ValueKind.LABEL and context.scene.ctmc.use_label
    )  # The slice is shown in their colors.
    unit = " [HU]" if volume.kind == ValueKind.HU else ""
    column.prop(view, "window", text=translate("Window") + unit, translate=False)
    column.prop(view, "level", text=translate("Level") + unit, translate=False)
    if volume.kind == ValueKind.HU:
        row = layout.row(align=True)
        for name, window, level in WINDOWS:
            button = row.operator("ctmc.window", text=name)
            button.window, button.level = window, level
    row = draw_pair(layout, context)
    row.use_property_split = False
    row.prop(view, "show_slice", text="Show Slice")
    row.prop(view, "show_letters", text="Letters")
    column = layout.column(align=True)
    row = draw_pair(column, context)
    row.operator("ctmc.add_slice", icon="MESH_PLANE")
    row.operator("ctmc.add_slice", text="Add Three", icon="EMPTY_AXIS").three = True
    column.operator("ctmc.pick_point", icon="PIVOT_CURSOR")
    obj = context.view_layer.objects.active
    if is_slice(obj):
        draw_shape_change(layout, context, obj)


def draw_cuts(room: Any, _context: bpy.types.Context) -> None:
    """Draw the buttons that cut a surface at the slice, and a box out of it."""
    column = block(room).column(align=True)
    column.operator("ctmc.cut_at_slice", icon="MOD_BOOLEAN")  # Its German words need the line, like those below.
    column.operator("ctmc.flip_cut", icon="UV_SYNC_SELECT")
    column.operator("ctmc.cut_away", icon="SELECT_SUBTRACT")
    row = column.row(align=True)
    row.operator("ctmc.flip_cut_away", icon="UV_SYNC_SELECT")
    row.operator("ctmc.remove_cut_away", text="", icon="X")
