# SPDX-License-Identifier: GPL-3.0-or-later
"""Set threshold and upper limit by dragging lines of the histogram: the operator `ctmc.histogram`."""

from __future__ import annotations

from typing import Any

import bpy

from ....core.volume import ValueKind
from ... import jobs
from ...needs import Needs
from ...state.ct import volumes
from ...translations import translate
from ...viewport.surface import histogram

PASS = {"PASS_THROUGH"}
DONE = {"FINISHED"}


def _has_gray_values(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether the CT has gray values, with the reason if not."""
    volume = volumes.current(context.scene)
    if volume is not None and volume.kind == ValueKind.LABEL:
        operator.poll_message_set("A label volume has labels and no gray values")
        return False
    return True


def viewport_of(context: bpy.types.Context) -> bpy.types.Area | None:
    """Return the viewport that the mouse is in, else the first of the screen."""
    areas = [area for area in context.screen.areas if area.type == "VIEW_3D"] if context.screen else []
    return context.area if context.area in areas else next(iter(areas), None)


class CTMC_OT_histogram(Needs, bpy.types.Operator):
    """Show the histogram in the viewport, or close it."""

    bl_idname = "ctmc.histogram"
    bl_label = "Histogram in Viewport"
    bl_description = (
        "Show the histogram along the lower edge of the viewport, with tissues; drag its lines to set threshold and "
        "upper limit. Press again, or Esc, to close it"
    )

    needs = (volumes.has_volume, _has_gray_values)

    def execute(self, _context: bpy.types.Context) -> set[str]:
        self.report({"ERROR"}, translate("The histogram needs a window; set the threshold as a number"))
        return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        if histogram.current() is not None:
            histogram.hide()
            return DONE
        area = viewport_of(context)
        if area is None:
            return self.execute(context)
        self.opened = histogram.show(area)
        self.dragging = self.pointing = False
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Follow the mouse within the strip; everything else passes through."""
        if histogram.current() is not self.opened:
            self.point(context, False)
            return {*DONE, *PASS}
        areas = [area for area in context.window.screen.areas if area.as_pointer() == self.opened.area]
        if not areas or areas[0].type != "VIEW_3D" or jobs.locked():
            return PASS
        area = areas[0]
        strip = histogram.strip_of(area, context.scene)
        region = next(region for region in area.regions if region.type == "WINDOW")
        x, y = event.mouse_x - region.x, event.mouse_y - region.y
        if strip is None:
            return PASS
        if self.dragging:
            return self.follow(context, event, strip, x)
        in_area = 0 <= event.mouse_x - area.x < area.width and 0 <= event.mouse_y - area.y < area.height
        inside = strip.holds(x, y)
        if event.type == "MOUSEMOVE":
            self.look(context, area, strip, x if inside else None)
            return PASS
        if ((event.type == "ESC" and in_area) or (event.type == "RIGHTMOUSE" and inside)) and event.value == "PRESS":
            self.point(context, False)
            histogram.hide()
            return DONE
        if event.type != "LEFTMOUSE" or not inside:
            return PASS
        if event.value == "PRESS":
            self.opened.held = histogram.grabbed(strip, context.scene, x)
            self.opened.range = (strip.low, strip.high)
            self.before = histogram.limits_stored(context.scene)
            self.dragging = True
            line = histogram.line_at(strip, context.scene, bool(self.opened.held))
            self.offset = x - line if abs(x - line) <= strip.reach / strip.pixel else 0.0
            return {"RUNNING_MODAL"} if self.offset else self.follow(context, event, strip, x)
        return {"RUNNING_MODAL"}  # A click in the strip does not reach the objects behind it.

    def follow(self, context: bpy.types.Context, event: bpy.types.Event, strip: Any, x: float) -> set[str]:
        """Move the dragged line with the mouse; a release sets it, Esc or a right click restores it."""
        opened = self.opened
        back = event.type in ("ESC", "RIGHTMOUSE") and event.value == "PRESS"
        if back:
            histogram.restore_limits(context.scene, self.before)
        elif event.type == "MOUSEMOVE" or event.value == "PRESS":
            opened.pointed = strip.value_at(x - self.offset)
            histogram.drag(strip, context.scene, bool(opened.held), x - self.offset)
        if back or (event.type == "LEFTMOUSE" and event.value == "RELEASE"):
            self.dragging, opened.range = False, None
            if histogram.limits_stored(context.scene) != self.before:
                bpy.ops.ed.undo_push(message=translate("Threshold"))
        for area in context.window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
        return {"RUNNING_MODAL"}

    def look(self, context: bpy.types.Context, area: bpy.types.Area, strip: Any, x: float | None) -> None:
        """Show the value under the mouse; None if the mouse has left the strip."""
        opened = self.opened
        seen = (None, None) if x is None else (strip.value_at(x), histogram.grabbed(strip, context.scene, x))
        if seen != (opened.pointed, opened.held):
            opened.pointed, opened.held = seen
            area.tag_redraw()
        self.point(context, x is not None)

    def point(self, context: bpy.types.Context, inside: bool) -> None:
        """Show a pointer which says that a line can be dragged sideways."""
        if inside != self.pointing and context.window is not None:
            if inside:
                context.window.cursor_modal_set("MOVE_X")
            else:
                context.window.cursor_modal_restore()
        self.pointing = inside

    def cancel(self, context: bpy.types.Context) -> None:
        if self.opened is histogram.current():
            histogram.hide()


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_histogram,))
