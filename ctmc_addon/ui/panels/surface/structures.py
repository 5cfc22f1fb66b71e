# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the list of structures in the panel Surface: their source, look and ticks."""

from __future__ import annotations

from typing import Any

import bpy

from ....core import volume_text
from ....core.volume import ValueKind
from ...operators.surface.structure_list import is_visible
from ...properties.surface.structures import LABEL, called
from ...state.ct import volumes
from ...state.results import measurements, surfaces
from ...state.surface import structures
from ...translations import translate
from ..layout import draw_name, draw_text, holds_hu, is_narrow

ROWS = (2, 4)  # Fewest and most lines of the list.


def draw_structures(layout: Any, context: bpy.types.Context, settings: Any) -> None:
    """Draw the list, its buttons, and the facts of the marked structure."""
    if not len(settings.labels):
        _draw_none(layout, context, settings)
        return
    rows = min(ROWS[1], max(ROWS[0], len(settings.labels)))
    layout.template_list("CTMC_UL_labels", "", settings, "labels", settings, "label_index", rows=rows)
    row = layout.row(align=True)  # Not next to the list, because names need the width.
    row.operator("ctmc.add_threshold", text="", icon="ADD")
    row.operator("ctmc.remove_structure", text="", icon="REMOVE")
    for which, text in (("all", "All"), ("none", "None"), ("invert", "Invert")):
        row.operator("ctmc.tick_structures", text=text).which = which
    _draw_marked(layout, context, settings)
    if structures.missing(context.scene):
        draw_text(layout, context, translate("Some labels of the list are not in memory; press Load Again"), "INFO")
        if volumes.loaded(context.scene) is not None:
            layout.operator("ctmc.load", text="Load Again", icon="FILE_REFRESH").again = True


def _draw_none(layout: Any, context: bpy.types.Context, settings: Any) -> None:
    """Draw the buttons of an empty list."""
    volume = volumes.current(context.scene)
    if volume is None or volume.kind == ValueKind.LABEL:
        layout.prop(settings, "label")
        return
    layout.operator("ctmc.add_threshold", icon="ADD")
    draw_text(layout, context, translate("Load labels on the page CT, or add a threshold"), "INFO")


def _draw_marked(layout: Any, context: bpy.types.Context, settings: Any) -> None:
    """Draw source, opacity and volume of the selected structure."""
    if not 0 <= settings.label_index < len(settings.labels):
        return
    item = settings.labels[settings.label_index]
    column = layout.column(align=True)
    if item.kind == LABEL:
        column.label(text=_label_text(item), translate=False)
    else:
        unit = "HU" if holds_hu(context.scene) else translate("Gray Value")
        row = draw_name(column, f"{translate('From')} [{unit}]", 0.45)
        row.prop(item, "threshold", text="")
        row.prop(item, "use_upper", text="", icon="TRIA_UP_BAR")
        if item.use_upper:
            draw_name(column, f"{translate('To')} [{unit}]", 0.45).prop(item, "upper", text="")
    layout.prop(item, "opacity", slider=True)


def _label_text(item: Any) -> str:
    number = translate("Label {number}").format(number=item.value)
    return f"{number}, {item.name}" if item.name else number


def surface_volume_text(scene: bpy.types.Scene, item: Any) -> str:
    """Return the volume of the surface of a structure, once it is made and measured."""
    objects = surfaces.of_structure(scene, item)
    measurement = measurements.of(objects[0]) if objects else None
    if measurement is None:
        return ""
    if not measurement.measures.closed:
        return translate("open")
    return volume_text(measurement.measures.volume)


class CTMC_UL_labels(bpy.types.UIList):
    """A line of a structure: tick, eye, color, name, and volume once made."""

    bl_idname = "CTMC_UL_labels"

    def draw_item(
        self,
        context: Any,
        layout: Any,
        _data: Any,
        item: Any,
        _icon: int,
        _active_data: Any,
        _active_property: str,
        index: int,
        _flag: int,
    ) -> None:
        row = layout.row(align=True)
        row.use_property_split = False
        row.prop(item, "chosen", text="")
        objects = surfaces.of_structure(context.scene, item)
        is_shown = any(is_visible(obj) for obj in objects)
        eye = row.row(align=True)
        eye.enabled = bool(objects)
        eye.operator(
            "ctmc.structure_eye", text="", icon="HIDE_OFF" if is_shown else "HIDE_ON", emboss=False
        ).index = index
        color = row.row()
        color.ui_units_x = 1.0
        color.prop(item, "color", text="")
        row.prop(item, "name", text="", emboss=False, placeholder=called(item) or translate("Name"))
        if objects and not is_narrow(context):
            volume = row.row()
            volume.ui_units_x = 3.0
            volume.alignment = "RIGHT"
            volume.label(text=surface_volume_text(context.scene, item), translate=False)


register, unregister = bpy.utils.register_classes_factory((CTMC_UL_labels,))
