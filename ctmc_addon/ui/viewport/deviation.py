# SPDX-License-Identifier: GPL-3.0-or-later
"""Show the colors of a deviation map in the 3D viewports, with a legend in mm or um, and restore them afterwards."""

from __future__ import annotations

from typing import Any

import bpy

from ...blender.figure.distance_map import DISTANCE_COLORS, painted_mm
from ...blender.viewport import draw_legend
from ...core import unit_of
from ..state import session
from ..translations import translate

ATTRIBUTE, USUAL = "VERTEX", "MATERIAL"
_before: dict[int, tuple[str, str]] = {}  # Earlier shading of each viewport, by its address.


def _shadings() -> list[Any]:
    """Return the shading settings of the 3D viewports of all windows."""
    return [area.spaces.active.shading for area in session.viewports()]


def is_shown() -> bool:
    """Return whether a viewport shows the colors of attributes."""
    return any(shading.type == "SOLID" and shading.color_type == ATTRIBUTE for shading in _shadings())


def is_shown_on(obj: bpy.types.Object | None) -> bool:
    """Return whether a viewport shows the colors of an object's deviation map."""
    return painted_mm(obj) is not None and is_shown()


def is_switched_on() -> bool:
    """Return whether a viewport shows the colors of attributes because we switched it there."""
    return any(shading.as_pointer() in _before for shading in _shadings()) and is_shown()


def show() -> None:
    """Show the colors of attributes in every viewport."""
    for shading in _shadings():
        if (shading.type, shading.color_type) != ("SOLID", ATTRIBUTE):
            _before[shading.as_pointer()] = (shading.type, shading.color_type)
            shading.type, shading.color_type = "SOLID", ATTRIBUTE


def hide() -> None:
    """Restore the viewports' earlier shading."""
    for shading in _shadings():
        if shading.type == "SOLID" and shading.color_type == ATTRIBUTE:
            kind, color = _before.pop(shading.as_pointer(), ("SOLID", USUAL))
            shading.color_type, shading.type = color, kind


def draw(context: bpy.types.Context) -> None:
    """Draw the legend of the active surface, if its colors are shown."""
    shading = context.space_data.shading
    largest = painted_mm(context.view_layer.objects.active)
    if largest is not None and shading.type == "SOLID" and shading.color_type == ATTRIBUTE:
        unit = unit_of(largest, "mm")
        draw_legend(translate("Distance to the full surface"), DISTANCE_COLORS, largest / unit.size, unit.name)
