# SPDX-License-Identifier: GPL-3.0-or-later
"""Change the brush's radius by mouse, as in sculpting: the operator `ctmc.draw_radius`."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import FloatProperty

from ....core import length_text
from ...needs import Needs
from ...state import session
from ...translations import translate
from ...viewport.ct.slice_hits import brush_under
from ...viewport.draw import draw_tools
from .needs import can_draw

DOUBLE = 120.0  # Pixels at Blender's usual size, to the right, that double the radius.
ACCEPT, CANCEL = ("LEFTMOUSE", "RET", "NUMPAD_ENTER"), ("ESC", "RIGHTMOUSE")


class CTMC_OT_draw_radius(Needs, bpy.types.Operator):
    """Change the radius by moving the mouse."""

    bl_idname = "ctmc.draw_radius"
    bl_label = "Brush Radius"
    bl_description = "Move the mouse to the right for a larger brush, to the left for a smaller one; click to accept"

    radius_mm: FloatProperty(name="Radius", default=5.0, min=0.1, options={"SKIP_SAVE"})

    needs = (can_draw,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        context.scene.ctmc_draw.radius_mm = self.radius_mm
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if context.area is None or context.area.type != "VIEW_3D":
            self.report({"ERROR"}, translate("Press this in a 3D viewport"))
            return {"CANCELLED"}
        self.before, self.left = context.scene.ctmc_draw.radius_mm, event.mouse_x
        draw_tools.hold(brush_under(context.scene, context.area, event))
        context.window_manager.modal_handler_add(self)
        self.show_status(context)
        return {"RUNNING_MODAL"}

    def show_status(self, context: bpy.types.Context) -> None:
        text = translate("Radius {radius}. Click: accept. Esc: cancel")
        context.workspace.status_text_set(text.format(radius=length_text(context.scene.ctmc_draw.radius_mm, 3)))
        session.redraw_viewports()

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Follow the mouse until a click or Enter accepts; Esc and a right click restore the radius."""
        if event.type == "MOUSEMOVE":
            moved = (event.mouse_x - self.left) / (DOUBLE * context.preferences.system.ui_scale)
            context.scene.ctmc_draw.radius_mm = self.before * 2.0**moved
            self.show_status(context)
        is_accepted, is_cancelled = event.type in ACCEPT, event.type in CANCEL
        if event.value != "PRESS" or not (is_accepted or is_cancelled):
            return {"RUNNING_MODAL"}
        if is_cancelled:
            context.scene.ctmc_draw.radius_mm = self.before
        self.cancel(context)
        return {"FINISHED"} if is_accepted else {"CANCELLED"}

    def cancel(self, context: Any) -> None:
        draw_tools.hold(None)
        if context.workspace is not None:
            context.workspace.status_text_set(None)
        session.redraw_viewports()


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_draw_radius,))
