# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the fold Distances and Angles of the page Results: distances and angles, and the buttons that measure them."""

from __future__ import annotations

from typing import Any

import bpy

from ....blender.rulers import PROPERTY, rulers_of, text_of
from ..layout import block

ICONS = {"distance": "DRIVER_DISTANCE", "angle": "DRIVER_ROTATIONAL_DIFFERENCE"}


def draw_rulers(room: Any, context: bpy.types.Context) -> None:
    """Draw the buttons that measure, and what was measured."""
    layout = block(room)
    column = layout.column(align=True)
    column.operator("ctmc.measure_distance", icon=ICONS["distance"])
    column.operator("ctmc.measure_angle", icon=ICONS["angle"])
    column = layout.column(align=True)
    for ruler in rulers_of(context.scene):
        row = column.row(align=True)
        row.label(text=ruler.name, icon=ICONS[ruler[PROPERTY]["kind"]], translate=False)
        if text_of(ruler) not in ruler.name:  # The ruler was renamed.
            row.label(text=text_of(ruler), translate=False)
