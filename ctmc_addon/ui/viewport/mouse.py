# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the mouse is in a 3D viewport, for operators that take clicks there."""

from __future__ import annotations

from typing import Any

import bpy

COVERING = {"UI", "TOOLS", "HEADER", "TOOL_HEADER", "HUD", "ASSET_SHELF"}


def viewport_at(context: bpy.types.Context, pointer: int) -> bpy.types.Area | None:
    """Return the 3D viewport that had this pointer when an operator began; None where it is gone."""
    areas = [area for area in context.window.screen.areas if area.type == "VIEW_3D"]
    return next((area for area in areas if area.as_pointer() == pointer), None)


def window_under(area: bpy.types.Area, event: bpy.types.Event) -> bpy.types.Region | None:
    """The region of the viewport that the mouse is in, one of four in quad view; None on its bars and outside."""

    def holds(region: bpy.types.Region) -> bool:
        x, y = event.mouse_x - region.x, event.mouse_y - region.y
        return bool(0 <= x < region.width and 0 <= y < region.height)

    covered = any(holds(bar) for bar in area.regions if bar.type in COVERING and min(bar.width, bar.height) > 1)
    windows = (region for region in area.regions if region.type == "WINDOW" and holds(region))
    return None if covered else next(windows, None)


def ray_under(area: bpy.types.Area, event: bpy.types.Event) -> tuple[Any, Any] | None:
    """Origin and direction of the ray under the mouse, world space; None where the mouse is not in the viewport."""
    from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d

    region = window_under(area, event)
    if region is None:
        return None
    at, view = (event.mouse_x - region.x, event.mouse_y - region.y), region.data
    return region_2d_to_origin_3d(region, view, at), region_2d_to_vector_3d(region, view, at)
