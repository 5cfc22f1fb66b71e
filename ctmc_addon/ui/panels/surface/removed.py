# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw what the panel's settings take away from the next surface or do to it, where it is made."""

from __future__ import annotations

from typing import Any

import bpy

from ...operators.results.components import REMOVING, removal_text
from ...state.ct import volumes
from ...translations import translate
from .solid import draw_solid_line


def draw_removed(layout: Any, context: bpy.types.Context, settings: Any) -> None:
    """Draw a line for the solid and for each setting that takes something away, with a button that switches it off."""
    column = layout.column(align=True)
    draw_solid_line(column, context)
    for name in REMOVING:
        text = removal_text(settings, name)
        if text:
            _draw_line(column, text, "ctmc.stop_removing").setting = name
    loaded = volumes.loaded(context.scene)
    if loaded is not None and loaded.reading.remove_table:
        _draw_line(column, translate("Leaves out the patient table"), "ctmc.remove_table")


def _draw_line(layout: Any, text: str, operator: str) -> Any:
    """Draw a line, and return the button at its end."""
    row = layout.row(align=True)
    row.label(text=text, icon="REMOVE", translate=False)
    return row.operator(operator, text="", icon="X", emboss=False)
