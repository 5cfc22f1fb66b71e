# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the fold Volume Object of the page Render: the CT itself as an object that renders."""

from __future__ import annotations

from typing import Any

import bpy

from ....blender.volume import APPEARANCES
from ...translations import translate
from ..layout import block, draw_text


def draw_volume_object(room: Any, context: bpy.types.Context) -> None:
    """Draw a button for each appearance of the CT as an object."""
    layout = block(room)
    draw_text(layout, context, translate("The CT as an object that Cycles and EEVEE render"))
    grid = layout.grid_flow(row_major=True, columns=2, even_columns=True, align=True)
    for name, about in APPEARANCES.items():
        grid.operator("ctmc.add_volume", text=about.label, icon="VOLUME_DATA").appearance = name
    if not bpy.data.filepath:
        draw_text(layout, context, translate("Save the .blend first: the volume's file goes beside it"), "INFO")
