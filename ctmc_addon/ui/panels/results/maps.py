# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the part Maps of the page Results: the maps of the active surface, and the shown map."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import bpy

from ....blender.figure.map_colors import title_of
from ....blender.maps import StoredMap, shown_map, stored_maps
from ....core import UNKNOWN, length_text, map_numbers, percent_text
from ....core.mesh import distance_between
from ....reporting.formatting import capitalized
from ...state.results import surfaces
from ...translations import translate, translate_sentence
from ..layout import block, draw_name, draw_table, draw_text

STATISTICS = (
    ("Minimum", "minimum"),
    ("5 %", "percentile_5"),
    ("Median", "median"),
    ("Mean", "mean"),
    ("95 %", "percentile_95"),
    ("Maximum", "maximum"),
)
"""Labels of the statistics of a map, and their fields."""
SHARES = (("Without Value", "share_without"), ("Below Limit", "share_below"), ("Above Limit", "share_above"))
"""Labels of the shares of the area, and their fields."""


def draw_maps(room: Any, context: bpy.types.Context) -> None:
    """Draw the button that adds a map, the list, and the settings and statistics of the shown map."""
    layout, obj = block(room), surfaces.surface_of_results(context)
    layout.operator_menu_enum("ctmc.map_add", "quantity", text="Add Map", icon="ADD")
    if obj is None or obj.data.is_editmode:
        return
    layout.active = obj == context.view_layer.objects.active
    stored, shown = stored_maps(obj.data), shown_map(obj)
    column = layout.column(align=True)
    for each in stored:
        is_shown = shown is not None and shown.name == each.name
        row = column.row(align=True)
        row.use_property_split = False
        eye = row.operator(
            "ctmc.map_show", text=label_of(each), icon="HIDE_OFF" if is_shown else "HIDE_ON", depress=is_shown
        )
        eye.map_name = each.name
        row.operator("ctmc.map_remove", text="", icon="X").map_name = each.name
    if shown is not None:
        _draw_shown(layout, context, shown)


def label_of(stored: StoredMap) -> str:
    """Return the name of a map with its unit: 'Thickness [mm]'."""
    title = translate(capitalized(title_of(stored.name, stored.unit)))
    return f"{title} [{stored.unit}]" if stored.unit else title


def _draw_shown(layout: Any, context: bpy.types.Context, shown: StoredMap) -> None:
    settings = context.scene.ctmc_map
    layout.prop(settings, "ramp")
    unit = f" [{shown.unit}]" if shown.unit else ""
    row = draw_name(layout, translate("Colors") + unit)
    row.prop(settings, "low", text="")
    row.prop(settings, "high", text="")
    for text, used, name in (("Lower Limit", "use_lower", "lower"), ("Upper Limit", "use_upper", "upper")):
        row = draw_name(layout, translate(text))
        row.prop(settings, used, text="")
        value = row.row()
        value.active = getattr(settings, used)
        value.prop(settings, name, text="")
    draw_table(layout, facts_of(shown))
    if shown.nearest is not None:
        layout.operator("ctmc.map_nearest", icon="DRIVER_DISTANCE").map_name = shown.name
    for note in shown.notes:
        draw_text(layout, context, translate_sentence(note), "INFO")


def facts_of(shown: StoredMap) -> list[tuple[str, str]]:
    """Return the numbers of a map with their names; shares of the area are left out where they are 0 or unknown."""
    numbers, unit = map_numbers(asdict(shown.statistics), shown.unit)
    texts = {field: f"{number} {unit}".rstrip() for field, number in numbers.items()}
    facts = [(translate(name), texts.get(field, UNKNOWN)) for name, field in STATISTICS]
    limits = {"share_below": shown.limits[0], "share_above": shown.limits[1]}
    for name, field in SHARES:
        share = getattr(shown.statistics, field)
        if share is not None and (share > 0 or limits.get(field) is not None):
            facts.append((translate(name), percent_text(share)))
    if shown.nearest is not None:
        facts.append((translate("Nearest"), length_text(distance_between(*shown.nearest))))
    return facts
