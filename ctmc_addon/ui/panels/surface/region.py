# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the fold Region of the page Surface: the numbers of the box in which a surface is extracted."""

from __future__ import annotations

from typing import Any

import bpy

from ...translations import translate
from ..layout import block


def draw_region(room: Any, context: bpy.types.Context) -> None:
    """Draw the unit, the button that fits the box, and the box's six numbers."""
    layout, settings = block(room), context.scene.ctmc
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
