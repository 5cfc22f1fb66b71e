# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the closed panel Region: the numbers of the box in which a surface is extracted."""

from __future__ import annotations

from typing import Any

import bpy

from ... import jobs
from ...translations import translate
from ..layout import SubPanel, prepare


class CTMC_PT_region(SubPanel, bpy.types.Panel):
    """Panel with the region's numbers."""

    bl_idname = "CTMC_PT_region"
    bl_label = "Region"

    def draw_header(self, context: bpy.types.Context) -> None:
        self.layout.enabled = not jobs.locked()
        self.layout.prop(context.scene.ctmc, "use_region", text="")

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, context.scene.ctmc
        prepare(layout)
        layout.use_property_split = False
        row = layout.row()
        row.row().prop(settings, "region_in", expand=True)
        row.operator("ctmc.fit_region", text=translate("Fit"), translate=False)
        table = layout.column(align=True)
        table.active = settings.use_region
        head = columns_of(table, "")
        for text in ("Low", "High"):
            head.label(text=translate(text), translate=False)
        for axis, name in enumerate("xyz"):
            row = columns_of(table, name)
            for face in (axis, axis + 3):
                row.prop(settings, "region", index=face, text="")


def columns_of(table: Any, name: str) -> Any:
    """Return a row of the table: its name, then room for two fields of equal width."""
    split = table.split(factor=0.1, align=True)
    split.label(text=name, translate=False)
    return split.row(align=True)


register, unregister = bpy.utils.register_classes_factory((CTMC_PT_region,))
