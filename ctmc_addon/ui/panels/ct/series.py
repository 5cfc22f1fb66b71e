# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the choice of one of the series that lie at the CT's path."""

from __future__ import annotations

from typing import Any

import bpy

from ....readers import series_names
from ...operators.ct.series import facts_of
from ...state.ct import volumes
from ...translations import translate
from ..layout import draw_name, draw_text

NAMES = 0.32  # Share of the width for names, as of the CT's facts.


def draw_series(layout: Any, context: bpy.types.Context) -> None:
    """Draw a dropdown with the name of the series that was read, and below it what distinguishes that series."""
    loaded = volumes.loaded(context.scene)
    if loaded is None or len(loaded.series) < 2:
        return
    column = layout.column(align=True)
    names = dict(zip((line.number for line in loaded.series), series_names(loaded.series), strict=True))
    row = draw_name(column, translate("Series"), NAMES)
    name = names[loaded.series_number]
    row.operator_menu_enum("ctmc.load", "listed", text=name, translate=False)
    current = next(line for line in loaded.series if line.number == loaded.series_number)
    draw_text(column, context, facts_of(current))
