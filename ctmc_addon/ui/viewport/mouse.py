# SPDX-License-Identifier: GPL-3.0-or-later
"""Take clicks in a 3D viewport, and find the mouse there."""

from __future__ import annotations

from typing import Any

import bpy

from ..translations import translate

COVERING = {"UI", "TOOLS", "HEADER", "TOOL_HEADER", "HUD", "ASSET_SHELF"}


class Clicks:
    """An operator that takes clicks in the viewport it was started in; inherited before `bpy.types.Operator`."""

    def ask(self, context: bpy.types.Context) -> None:
        """Say in the status bar what to click."""
        raise NotImplementedError

    def invoke(self: Any, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Begin, if there is a viewport."""
        if context.area is None or context.area.type != "VIEW_3D":
            self.report({"ERROR"}, translate("Press this in a 3D viewport"))
            return {"CANCELLED"}
        self.area = context.area.as_pointer()
        context.window.cursor_modal_set("CROSSHAIR")
        context.window_manager.modal_handler_add(self)
        self.ask(context)
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Restore pointer and status bar."""
        if context.window is not None:
            context.window.cursor_modal_restore()
        if context.workspace is not None:
            context.workspace.status_text_set(None)


def is_end(event: bpy.types.Event) -> bool:
    """Return whether an event ends an operator that takes any number of clicks."""
    return event.type in ("ESC", "RIGHTMOUSE", "RET", "NUMPAD_ENTER") and event.value == "PRESS"


def viewport_at(context: bpy.types.Context, pointer: int) -> bpy.types.Area | None:
    """Return the 3D viewport that had this pointer when an operator began; None if it was closed."""
    areas = [area for area in context.window.screen.areas if area.type == "VIEW_3D"]
    return next((area for area in areas if area.as_pointer() == pointer), None)


def window_under(area: bpy.types.Area, event: bpy.types.Event) -> bpy.types.Region | None:
    """Return the viewport's region under the mouse, one of four in quad view; None on its bars and outside."""

    def holds(region: bpy.types.Region) -> bool:
        x, y = event.mouse_x - region.x, event.mouse_y - region.y
        return bool(0 <= x < region.width and 0 <= y < region.height)

    covered = any(holds(bar) for bar in area.regions if bar.type in COVERING and min(bar.width, bar.height) > 1)
    windows = (region for region in area.regions if region.type == "WINDOW" and holds(region))
    return None if covered else next(windows, None)


def ray_under(area: bpy.types.Area, event: bpy.types.Event) -> tuple[Any, Any] | None:
    """Return origin and direction of the ray under the mouse, world space; None outside of the viewport."""
    from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d

    region = window_under(area, event)
    if region is None:
        return None
    at, view = (event.mouse_x - region.x, event.mouse_y - region.y), region.data
    return region_2d_to_origin_3d(region, view, at), region_2d_to_vector_3d(region, view, at)
