# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the panel below Results: distances and angles, and the buttons that measure them."""

from __future__ import annotations

import bpy

from ....blender.rulers import PROPERTY, rulers_of, text_of
from ..layout import SubPanel, prepare

ICONS = {"distance": "DRIVER_DISTANCE", "angle": "DRIVER_ROTATIONAL_DIFFERENCE"}


class CTMC_PT_rulers(SubPanel, bpy.types.Panel):
    """Panel for distances and angles between points."""

    bl_idname = "CTMC_PT_rulers"
    bl_label = "Distances and Angles"
    bl_parent_id = "CTMC_PT_results"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        prepare(layout)
        column = layout.column(align=True)
        column.operator("ctmc.measure_distance", icon=ICONS["distance"])
        column.operator("ctmc.measure_angle", icon=ICONS["angle"])
        column = layout.column(align=True)
        for ruler in rulers_of(context.scene):
            row = column.row(align=True)
            row.label(text=ruler.name, icon=ICONS[ruler[PROPERTY]["kind"]], translate=False)
            if text_of(ruler) not in ruler.name:  # The ruler was renamed.
                row.label(text=text_of(ruler), translate=False)


register, unregister = bpy.utils.register_classes_factory((CTMC_PT_rulers,))
