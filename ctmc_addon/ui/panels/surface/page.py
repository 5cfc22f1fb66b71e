# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the page Surface: threshold or structures, what is made of them, what it costs, and the button."""

from __future__ import annotations

from typing import Any

import bpy

from ....core import SETTINGS, SMOOTHINGS, Volume, done_smoothing, has_width
from ....core.volume import ValueKind
from ...operators.surface import threshold
from ...state.ct import volumes
from ...translations import translate
from ...viewport.surface import histogram
from ..layout import PagePanel, begin, block, draw_name, draw_status, fold, lacks_ct
from .reconstruct import draw_cost, draw_reconstruct, draw_simplify, draw_voxels
from .region import draw_region
from .settings import draw_advanced, draw_components
from .solid import draw_solid
from .structures import draw_structures

HISTOGRAM = 4.0  # Size of its picture, in rows.


class CTMC_PT_surface(PagePanel, bpy.types.Panel):
    """Page that says what becomes a surface, and makes it."""

    bl_idname = "CTMC_PT_surface"
    bl_label = "Surface"
    page = "SURFACE"

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = begin(self.layout), context.scene.ctmc
        if lacks_ct(layout, context):
            draw_status(self.layout, context)
            return
        row = layout.row(align=True)
        row.use_property_split = False
        row.prop(settings, "surface_from", expand=True)
        row.popover("CTMC_PT_presets", text="", icon="PRESET")
        if settings.use_label:
            draw_structures(layout, context, settings)
        else:
            _draw_threshold(layout, context, settings)
        _draw_smoothing(layout, settings)
        body = fold(self.layout, "region", text="Region", owner=settings, used="use_region")
        if body is not None:
            draw_region(body, context)
        layout = block(self.layout)
        draw_voxels(layout, context, settings)
        draw_simplify(layout, context, settings)
        body = fold(self.layout, "components", text="Components")
        if body is not None:
            draw_components(body, context)
        body = fold(self.layout, "solid", text="Solid")
        if body is not None:
            draw_solid(body, context)
        body = fold(self.layout, "advanced", text="Advanced")
        if body is not None:
            draw_advanced(body, context)
        layout = self.layout.column()
        draw_cost(layout, context)
        draw_reconstruct(layout, context, settings)


def _draw_threshold(layout: Any, context: bpy.types.Context, settings: Any) -> None:
    """Draw the histogram, a combo of usual thresholds, and the number, with its upper limit where there is one."""
    icon = threshold.histogram_icon(context.scene)
    if icon:
        layout.template_icon(icon, scale=HISTOGRAM)
    column = layout.column(align=True)
    column.use_property_split = False
    volume = volumes.current(context.scene)
    row = column.row(align=True)
    row.prop(settings, "threshold_from" if volume is None or volume.kind == ValueKind.HU else "gray_from", text="")
    row.operator("ctmc.histogram", text="", icon="NORMALIZE_FCURVES", depress=histogram.current() is not None)
    row = column.row(align=True)
    row.prop(settings, "threshold_value", text=_threshold_label(volume))
    row.prop(settings, "use_upper", text="", icon="TRIA_UP_BAR")
    if settings.use_upper:
        column.prop(settings, "upper")


def _draw_smoothing(layout: Any, settings: Any) -> None:
    """Draw the smoothing method with its number."""
    about = SETTINGS["smoothing"]
    row = draw_name(layout, translate(about.label))
    row.prop(settings, "smoothing", text="")
    width_mm = settings.smoothing_mm if settings.use_smoothing_mm else None
    own = SMOOTHINGS[done_smoothing(settings.smoothing, width_mm, settings.use_label)].settings
    number = row.row(align=True)
    if not own:
        number.active = settings.use_smoothing_mm or has_width(settings.smoothing)
    for name in own or ("smoothing_mm",):
        number.prop(settings, name, text="")


def _threshold_label(volume: Volume | None) -> str:
    """Return the unit of the threshold, which stands before its number."""
    if volume is None or volume.kind == ValueKind.LABEL:
        return translate("Threshold")
    return volume.kind.mark or translate("Gray Value")
