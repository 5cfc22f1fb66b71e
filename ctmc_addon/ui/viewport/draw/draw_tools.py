# SPDX-License-Identifier: GPL-3.0-or-later
"""Define the tools in the viewport's toolbar: Grow, Brush, Eraser, Scissors; their cursor and status text.

They are in the toolbar only while a scene has a CT.

The circle shows the brush on the slice under the mouse, so it looks slanted where the slice is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np

from ....blender.viewport import draw_path
from ....core import Volume, position_text
from ....core.volume import value_at
from ...needs import Needs
from ...properties.preferences import machine
from ...state import change_events
from ...state.ct import volumes
from ...state.draw.tools import tool_of
from ...translations import translate
from ..ct.slice_hits import SliceHit, brush_along, brush_under, slice_under

CIRCLE = 64  # Corners of the circle.
FIRST_TOOL = "builtin.select_box"
WATCH = 0.3  # Seconds between two checks whether the tool is still active.
HELP = {
    "ctmc.grow": "Click: grow. Alt click: surroundings",
    "ctmc.brush": "Drag: draw. Ctrl: erase. F: radius",
    "ctmc.eraser": "Drag: erase. Ctrl: draw. F: radius",
    "ctmc.scissors": "Drag: remove what is inside. Ctrl: keep it",
}
BRUSHES = ("ctmc.brush", "ctmc.eraser")
_held: list[SliceHit] = []  # Position of the circle while its radius changes.
_status: list[str] = []  # Names of the workspaces whose status bar shows our text.


def _keys_of(operator: str, modifier: str, switch: str, state: bool = False) -> tuple[Any, ...]:
    """Return the keys of a tool: the mouse calls its operator, with a modifier the one with the switch inverted."""
    mouse, modified = {"type": "LEFTMOUSE", "value": "PRESS"}, {"type": "LEFTMOUSE", "value": "PRESS", modifier: True}
    kind = operator.replace("ctmc.", "CTMC_OT_")
    return (
        (operator, mouse, {"properties": [(switch, state)]}),
        (operator, modified, {"properties": [(switch, not state)]}),
        ("ctmc.draw_refuse", mouse, {"properties": [("operator", kind)]}),
        ("ctmc.draw_refuse", modified, {"properties": [("operator", kind)]}),
        ("ctmc.draw_hover", {"type": "MOUSEMOVE", "value": "ANY", "any": True}, None),
    )


RADIUS = ("ctmc.draw_radius", {"type": "F", "value": "PRESS"}, None)


class Tool:
    """Base of all tools; inherited before `bpy.types.WorkSpaceTool`."""

    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_cursor = "CROSSHAIR"


class _BrushTool(Tool):
    """Base of brush and eraser."""

    @staticmethod
    def draw_settings(context: Any, layout: Any, _tool: Any) -> None:
        drawing = context.scene.ctmc_draw
        for name in ("radius_mm", "ball", "on_surfaces", "use_range"):
            layout.prop(drawing, name)

    @staticmethod
    def draw_cursor(context: Any, _tool: Any, xy: tuple[float, float]) -> None:
        """Draw the circle of the brush where the mouse is on a slice."""
        if not hasattr(context.scene, "ctmc_draw"):  # The extension was disabled while its tool was active.
            return
        hit = _held[0] if _held else _hit_at(context, xy)
        if hit is not None:
            draw_path(_circle_of(context, hit))


class _GrowTool(Tool, bpy.types.WorkSpaceTool):
    """Grow a structure from a click."""

    bl_idname = "ctmc.grow"
    bl_label = "Grow"
    bl_description = "Grow a structure from a click on a slice; Alt click for its surroundings"
    bl_icon = "brush.gpencil_draw.fill"
    bl_keymap = _keys_of("ctmc.draw_grow", "alt", "surroundings")

    @staticmethod
    def draw_settings(context: Any, layout: Any, _tool: Any) -> None:
        layout.prop(context.scene.ctmc_draw, "method")
        layout.prop(context.scene.ctmc_draw, "use_range")


class BrushOfSlices(_BrushTool, bpy.types.WorkSpaceTool):
    """Draw a structure on slices."""

    bl_idname = "ctmc.brush"
    bl_label = "Brush"
    bl_description = "Draw a structure on a slice; Ctrl erases, F changes the radius"
    bl_icon = "ops.gpencil.draw"
    bl_keymap = (*_keys_of("ctmc.draw_stroke", "ctrl", "erase"), RADIUS)


class _EraserOfSlices(_BrushTool, bpy.types.WorkSpaceTool):
    """Erase from a structure on slices."""

    bl_idname = "ctmc.eraser"
    bl_label = "Eraser"
    bl_description = "Erase from a structure on a slice; Ctrl draws, F changes the radius"
    bl_icon = "ops.gpencil.draw.eraser"
    bl_keymap = (*_keys_of("ctmc.draw_stroke", "ctrl", "erase", True), RADIUS)


class _ScissorsTool(Tool, bpy.types.WorkSpaceTool):
    """Cut a structure by a lasso."""

    bl_idname = "ctmc.scissors"
    bl_label = "Scissors"
    bl_description = "Remove from a structure what a lasso encloses in the view; Ctrl removes everything else"
    bl_icon = "ops.sculpt.lasso_trim"
    bl_keymap = _keys_of("ctmc.draw_lasso", "ctrl", "keep_inside")

    @staticmethod
    def draw_settings(context: Any, layout: Any, _tool: Any) -> None:
        layout.prop(context.scene.ctmc_draw, "depth_mm")


TOOLS = (_GrowTool, BrushOfSlices, _EraserOfSlices, _ScissorsTool)


def hold(hit: SliceHit | None) -> None:
    """Keep the circle at a position; None lets it follow the mouse again."""
    _held[:] = [] if hit is None else [hit]


def _hit_at(context: Any, xy: tuple[float, float]) -> SliceHit | None:
    """Return where the brush hits at a position of the window, in the current region."""
    from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d

    region, view = context.region, context.region_data
    if region is None or view is None or region.type != "WINDOW":
        return None
    at = (xy[0] - region.x, xy[1] - region.y)
    ray = region_2d_to_origin_3d(region, view, at), region_2d_to_vector_3d(region, view, at)
    return brush_along(context.scene, context.space_data, view, ray)


def _circle_of(context: Any, hit: SliceHit) -> list[tuple[float, float]]:
    """Return the brush's circle on a slice, pixels of the window."""
    from bpy_extras.view3d_utils import location_3d_to_region_2d
    from mathutils import Vector

    radius_mm = context.scene.ctmc_draw.radius_mm
    across = hit.corners_mm[1] - hit.corners_mm[0]
    across = across / np.linalg.norm(across)
    down = np.cross(hit.normal, across)
    region, places = context.region, []
    for number in range(CIRCLE + 1):
        turn = 2 * math.pi * number / CIRCLE
        point = np.array(hit.point_mm) + radius_mm * (math.cos(turn) * across + math.sin(turn) * down)
        at = location_3d_to_region_2d(region, context.region_data, Vector((point * machine().scale).tolist()))
        if at is not None:
            places.append((at.x + region.x, at.y + region.y))
    return places


class CTMC_OT_draw_hover(Needs, bpy.types.Operator):
    """Say place and value under the mouse in the status bar, and let the event through."""

    bl_idname = "ctmc.draw_hover"
    bl_label = "Position and Value"
    bl_description = "Show position and value under the mouse in the status bar"
    bl_options = {"INTERNAL"}  # noqa: RUF012  (Blender reads it from the class)

    needs = (volumes.has_volume,)

    def execute(self, _context: bpy.types.Context) -> set[str]:
        return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        volume = volumes.current(context.scene)
        if context.area is not None and volume is not None:
            tool = tool_of(context)
            under = brush_under if tool in BRUSHES else slice_under
            hit = under(context.scene, context.area, event)
            text = translate(HELP.get(tool, ""))
            _show_status(context, text if hit is None else f"{point_text(volume, hit.point_mm)}   |   {text}")
            context.region.tag_redraw()
        return {"CANCELLED", "PASS_THROUGH"}


def point_text(volume: Volume, point_mm: Sequence[float]) -> str:
    """Return the position of a point and the value of the CT there."""
    place, value = position_text(point_mm, min(volume.spacing)), value_at(volume, point_mm)
    if value is None:
        return translate("{place}: outside the CT").format(place=place)
    return f"{place}: {value:g}{' HU' if volume.kind == 'HU' else ''}"


def _show_status(context: Any, text: str) -> None:
    """Write into the status bar, until another tool is active."""
    context.workspace.status_text_set(text)
    if context.workspace.name not in _status:
        _status.append(context.workspace.name)
    if not bpy.app.timers.is_registered(watch):
        bpy.app.timers.register(watch, first_interval=WATCH)


def watch() -> float | None:
    """Clear our status text once another tool is active."""
    if tool_of(bpy.context):
        return WATCH
    quiet()
    return None


def quiet() -> None:
    """Clear our status text."""
    while _status:
        workspace = bpy.data.workspaces.get(_status.pop())
        if workspace is not None:
            workspace.status_text_set(None)


_register, _unregister = bpy.utils.register_classes_factory((CTMC_OT_draw_hover,))


def _is_in_toolbar() -> bool:
    """Return whether our tools are in the toolbar."""
    return hasattr(TOOLS[0], "_bl_tool")


def _follow_cts(*_: Any) -> None:
    """Put our tools into the toolbar behind Blender's own if a scene has a CT; take them out if none has."""
    has_ct = any(scene.ctmc.volume_path for scene in bpy.data.scenes)
    if has_ct and not _is_in_toolbar():
        for number, tool in enumerate(TOOLS):
            bpy.utils.register_tool(tool, separator=number == 0)
    elif _is_in_toolbar() and not has_ct:
        _remove_tools()


def _follow_setting(_settings: Any, name: str) -> None:
    if name == "volume":
        _follow_cts()


def _remove_tools() -> None:
    """Take our tools out of the toolbar; a window with one of them active gets Blender's first tool."""
    for window in bpy.context.window_manager.windows:
        tool = window.workspace.tools.from_space_view3d_mode("OBJECT", create=False)
        areas = [area for area in window.screen.areas if area.type == "VIEW_3D"]
        if tool is not None and tool.idname in HELP and areas:
            with bpy.context.temp_override(window=window, area=areas[0]):
                bpy.ops.wm.tool_set_by_id(name=FIRST_TOOL)
    for tool in reversed(TOOLS):
        bpy.utils.unregister_tool(tool)


_follow, _ignore = change_events.following(
    _follow_setting, load_post=_follow_cts, undo_post=_follow_cts, redo_post=_follow_cts
)


def register() -> None:
    """Show the tools from now on while a scene has a CT."""
    _register()
    _follow()
    bpy.app.timers.register(_follow_cts, first_interval=0.0)  # Scenes cannot be read while an add-on is enabled.


def unregister() -> None:
    """Remove the tools and clear the status text."""
    for timer in (watch, _follow_cts):
        if bpy.app.timers.is_registered(timer):
            bpy.app.timers.unregister(timer)
    _ignore()
    quiet()
    hold(None)
    if _is_in_toolbar():
        _remove_tools()
    _unregister()
