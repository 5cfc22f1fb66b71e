# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the closed panel Slice: the position of the shown slice, its window and level."""

from __future__ import annotations

import bpy

from ....blender.slices import is_slice
from ....core.volume import ValueKind, slice_at, slice_position_text
from ... import jobs
from ...state import surfaces, volumes
from ...translations import translate
from ..layout import SubPanel, draw_pair, draw_shape_change, prepare

# Window and level in HU, as radiologists set them.
WINDOWS = (("Bone", 2000.0, 300.0), ("Soft Tissue", 400.0, 40.0), ("Lung", 1500.0, -600.0))


class CTMC_PT_slice(SubPanel, bpy.types.Panel):
    """Panel for the slice in the viewport."""

    bl_idname = "CTMC_PT_slice"
    bl_label = "Slice"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return volumes.current(context.scene) is not None

    def draw_header(self, context: bpy.types.Context) -> None:
        self.layout.enabled = not jobs.locked()
        self.layout.prop(context.scene.ctmc_view, "show_slice", text="")

    def draw(self, context: bpy.types.Context) -> None:
        layout, view = self.layout, context.scene.ctmc_view
        volume = volumes.current(context.scene)
        assert volume is not None, "poll asks for one"
        prepare(layout)
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
        layout.prop(view, "show_letters")
        column = layout.column(align=True)
        row = draw_pair(column, context)
        row.operator("ctmc.add_slice", icon="MESH_PLANE")
        row.operator("ctmc.add_slice", text="Add Three", icon="EMPTY_AXIS").three = True
        column.operator("ctmc.pick_point", icon="PIVOT_CURSOR")
        column.operator("ctmc.cut_at_slice", icon="MOD_BOOLEAN")  # Its German words need the line, like those below.
        column.operator("ctmc.flip_cut", icon="UV_SYNC_SELECT")
        column.operator("ctmc.cut_away", icon="SELECT_SUBTRACT")
        row = column.row(align=True)
        row.operator("ctmc.flip_cut_away", icon="UV_SYNC_SELECT")
        row.operator("ctmc.remove_cut_away", text="", icon="X")
        obj = context.view_layer.objects.active
        if is_slice(obj) or surfaces.is_surface(obj):
            draw_shape_change(layout, context, obj)


register, unregister = bpy.utils.register_classes_factory((CTMC_PT_slice,))
