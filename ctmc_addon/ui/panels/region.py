# SPDX-License-Identifier: GPL-3.0-or-later
"""The closed panel Region: the numbers of the box that a surface is sought in."""

from __future__ import annotations

import bpy

from .. import jobs
from .layout import SubPanel, prepare


class CTMC_PT_region(SubPanel, bpy.types.Panel):
    """The region's numbers."""

    bl_idname = "CTMC_PT_region"
    bl_label = "Region"

    def draw_header(self, context: bpy.types.Context) -> None:
        """The switch stands beside the title."""
        self.layout.enabled = not jobs.locked()
        self.layout.prop(context.scene.ctmc, "use_region", text="")

    def draw(self, context: bpy.types.Context) -> None:
        """Unit, lowest and highest corner."""
        layout, settings = self.layout, context.scene.ctmc
        prepare(layout)
        layout.operator("ctmc.fit_region", icon="CUBE")
        column = layout.column(align=True)
        column.active = settings.use_region
        column.prop(settings, "region_unit")
        for axis, name in enumerate("XYZ"):
            row = column.row(align=True, heading=name)
            row.prop(settings, "region", index=axis, text="")
            row.prop(settings, "region", index=axis + 3, text="")


register, unregister = bpy.utils.register_classes_factory((CTMC_PT_region,))
