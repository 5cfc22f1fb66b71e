# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the page Surface: threshold or structures, what is made of them, what it costs, and the button."""

from __future__ import annotations

from typing import Any

import bpy

from ...core import SMOOTHINGS, done_smoothing, has_width
from ...core.volume import ValueKind, tissue_name
from ..operators.ct import threshold
from ..state import volumes
from ..translations import translate
from ..viewport import histogram
from .ct.region import draw_region
from .layout import PagePanel, begin, block, draw_setting, fold, holds_hu, lacks_ct
from .reconstruct import draw_cost, draw_reconstruct, draw_simplify, draw_voxels
from .settings import ADVANCED, COMPONENTS, draw_settings
from .structures import draw_structures


class CTMC_PT_surface(PagePanel, bpy.types.Panel):
    """Page that says what becomes a surface, and makes it."""

    bl_idname = "CTMC_PT_surface"
    bl_label = "Surface"
    page = "SURFACE"

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = begin(self.layout), context.scene.ctmc
        if lacks_ct(layout, context):
            return
        draw_surface(layout, context, settings)
        body = fold(self.layout, "region", text="Region", owner=settings, used="use_region")
        if body is not None:
            draw_region(body, context)
        layout = block(self.layout)
        draw_voxels(layout, context, settings)
        draw_simplify(layout, context, settings)
        for name, text, names in (("components", "Components", COMPONENTS), ("advanced", "Advanced", ADVANCED)):
            body = fold(self.layout, name, text=text)
            if body is not None:
                draw_settings(body, context, names)
        layout = self.layout.column()
        draw_cost(layout, context)
        draw_reconstruct(layout, context, settings)


def draw_surface(layout: Any, context: bpy.types.Context, settings: Any) -> None:
    """Draw the threshold with histogram, Otsu and tissues, or the structures."""
    column = layout.column()
    row = column.row(align=True)
    row.use_property_split = False
    row.prop(settings, "surface_from", expand=True)
    row.popover("CTMC_PT_presets", text="", icon="PRESET")
    if settings.use_label:
        draw_structures(column, context, settings)
    else:
        icon = threshold.histogram_icon(context.scene)
        if icon:
            column.template_icon(icon, scale=6.0)
        column.operator("ctmc.histogram", icon="NORMALIZE_FCURVES", depress=histogram.current() is not None)
        row = column.split(factor=0.8, align=True)
        row.use_property_split = False
        value = row.row(align=True)
        value.prop(settings, "use_threshold", text="")
        number = value.row(align=True)
        number.active = settings.use_threshold
        number.prop(settings, "threshold", text=_threshold_label(context.scene))
        row.operator("ctmc.auto_threshold")
        draw_setting(column, settings, "upper")
        column.label(text=_threshold_text(context.scene), translate=False)
        column.operator_menu_enum("ctmc.tissue", "tissue", icon="PRESET")
    _draw_smoothing(column, settings)


def _draw_smoothing(layout: Any, settings: Any) -> None:
    """Draw the smoothing method and its settings."""
    draw_setting(layout, settings, "smoothing")
    row = layout.row()
    width_mm = settings.smoothing_mm if settings.use_smoothing_mm else None
    own = SMOOTHINGS[done_smoothing(settings.smoothing, width_mm, settings.use_label)].settings
    if not own:
        row.active = settings.use_smoothing_mm or has_width(settings.smoothing)
    for name in own or ("smoothing_mm",):
        row.prop(settings, name)
    if settings.use_label:
        row = layout.row()
        row.active = sum(item.chosen for item in settings.labels) > 1
        draw_setting(row, settings, "interfaces")


def _threshold_text(scene: bpy.types.Scene) -> str:
    """Return which threshold is used: Otsu's, or that of a tissue."""
    volume, value = volumes.current(scene), threshold.used_threshold(scene)
    unit = " HU" if holds_hu(scene) else ""
    if not scene.ctmc.use_threshold:
        if value is None:
            return translate("Otsu's threshold is used")
        return translate("Otsu's threshold: {value}").format(value=f"{value:.6g}{unit}")
    if volume is None or value is None:
        return ""
    upper = scene.ctmc.upper if scene.ctmc.use_upper else None
    tissue = translate(tissue_name(volume.kind, value, upper))
    if upper is None:
        return f"{tissue}: {value:.6g}{unit}"
    limits = translate("{low} to {high} {kind}").format(low=f"{value:.6g}", high=f"{upper:.6g}", kind=unit.strip())
    return f"{tissue}: {limits.rstrip()}"


def _threshold_label(scene: bpy.types.Scene) -> str:
    volume = volumes.current(scene)
    if volume is None or volume.kind == ValueKind.LABEL:
        return translate("Threshold")
    return "HU" if volume.kind == ValueKind.HU else translate("Gray Value")
