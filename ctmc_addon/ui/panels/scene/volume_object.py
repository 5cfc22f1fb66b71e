# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the closed panel Volume Object: the CT itself as an object that renders, and Blender's numbers in mm."""

from __future__ import annotations

import bpy

from ....blender.units import shows_mm
from ....blender.volume import APPEARANCES, vdb_writer
from ...properties.preferences import machine
from ...state import volumes
from ...translations import translate
from ..layout import SubPanel, draw_text, prepare


class CTMC_PT_volume_object(SubPanel, bpy.types.Panel):
    """Panel for the CT itself as an object."""

    bl_idname = "CTMC_PT_volume_object"
    bl_label = "Volume Object"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return volumes.current(context.scene) is not None

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        prepare(layout)
        if vdb_writer() is None:
            draw_text(
                layout, context, translate("This Blender has no OpenVDB module; the Blender of blender.org has one")
            )
        else:
            draw_text(layout, context, translate("The CT as an object that Cycles and EEVEE render"))
            grid = layout.grid_flow(row_major=True, columns=2, even_columns=True, align=True)
            for name, about in APPEARANCES.items():
                grid.operator("ctmc.add_volume", text=about.label, icon="VOLUME_DATA").appearance = name
            if not bpy.data.filepath:
                draw_text(layout, context, translate("Save the .blend first: the volume's file goes beside it"), "INFO")
        row = layout.row()
        row.enabled = not shows_mm(context.scene, machine().scale)
        row.operator("ctmc.set_units", icon="DRIVER_DISTANCE")


register, unregister = bpy.utils.register_classes_factory((CTMC_PT_volume_object,))
