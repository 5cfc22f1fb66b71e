# SPDX-License-Identifier: GPL-3.0-or-later
"""Show the colors of maps in the 3D viewports, with a legend, and restore the shading afterwards."""

from __future__ import annotations

from typing import Any

import bpy

from ....blender.figure.map_colors import scale_of
from ....blender.maps import shown_map, shown_name
from ....blender.viewport import draw_legend
from ....reporting.formatting import capitalized
from ...state import session
from ...translations import translate

ATTRIBUTE, USUAL = "VERTEX", "MATERIAL"
WITH_MATERIALS = ("MATERIAL", "RENDERED")
"""Kinds of shading that show the material of a map."""
_before: dict[int, str] = {}  # Earlier kind of colors of each viewport, by its address.


def _shadings() -> list[Any]:
    """Return the shading settings of the 3D viewports of all windows."""
    return [area.spaces.active.shading for area in session.viewports()]


def _shows_colors(shading: Any) -> bool:
    """Return whether a viewport shows the colors of maps."""
    return shading.type in WITH_MATERIALS or (shading.type == "SOLID" and shading.color_type == ATTRIBUTE)


def show() -> None:
    """Show maps in every viewport: those that show neither materials nor attributes change to attributes."""
    for shading in _shadings():
        if not _shows_colors(shading):
            _before[shading.as_pointer()] = f"{shading.type} {shading.color_type}"
            shading.type, shading.color_type = "SOLID", ATTRIBUTE


def hide() -> None:
    """Restore the viewports' earlier shading, once no object shows a map."""
    if any(shown_name(obj) for obj in bpy.context.scene.objects):
        return
    for shading in _shadings():
        if shading.type == "SOLID" and shading.color_type == ATTRIBUTE:
            kind, color = _before.pop(shading.as_pointer(), f"SOLID {USUAL}").split()
            shading.color_type, shading.type = color, kind


def draw(context: bpy.types.Context) -> None:
    """Draw the legend of the active surface if its map is visible."""
    stored = shown_map(context.view_layer.objects.active)
    if stored is not None and _shows_colors(context.space_data.shading):
        scale = scale_of([stored])
        title = translate(capitalized(scale.title))
        draw_legend(title, scale, translate("No value") if scale.gaps else "")
