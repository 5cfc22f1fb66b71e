# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut with a lasso in the view: `ctmc.draw_lasso` draws it, `ctmc.draw_cut` cuts the structure along it."""

from __future__ import annotations

import math
from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty, CollectionProperty, FloatVectorProperty

from ....blender.viewport import draw_path
from ....core import Steps
from ....core.segmentation import scissors_steps
from ... import jobs
from ...needs import Needs
from ...properties.drawing import CTMCPoint, points_of
from ...properties.preferences import machine
from ...state import session
from ...state.draw import masks
from ...translations import translate
from ...viewport.mouse import window_under
from .edits import edit_steps
from .needs import can_draw, has_structure, require_active, target_of, volume_of, whole

STEP = 3.0  # Pixels between two corners of the lasso.
FEWEST = 3  # Fewest corners of a lasso.


class CTMC_OT_draw_cut(jobs.LongOperator, bpy.types.Operator):
    """Cut the structure along a lasso in a view."""

    bl_idname = "ctmc.draw_cut"
    bl_label = "Cut by Lasso"
    bl_description = (
        "Remove what a lasso encloses in the view, through everything or to a depth; or remove everything else"
    )
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    view: FloatVectorProperty(size=16, options={"HIDDEN", "SKIP_SAVE"})
    lasso: CollectionProperty(type=CTMCPoint, options={"HIDDEN", "SKIP_SAVE"})
    keep_inside: BoolProperty(name="Keep Inside", description="Remove what is outside the lasso", options={"SKIP_SAVE"})

    needs = (jobs.idle, can_draw, has_structure)

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        """Return the cut: `view` leads from RAS+ mm to clip space, row by row, and `lasso` lies there."""
        scene = context.scene
        item, volume = require_active(scene), volume_of(scene)
        corners = np.array([corner.at[:2] for corner in self.lasso], np.float64).reshape(-1, 2)
        view = np.array(self.view, np.float64).reshape(4, 4)
        mask = masks.of(scene, item).mask.copy()
        work = scissors_steps(mask, volume, view, corners, self.keep_inside, scene.ctmc_draw.depth_mm or math.inf)
        return edit_steps(work, whole(volume.shape), target_of(scene, item))


class CTMC_OT_draw_lasso(Needs, bpy.types.Operator):
    """Draw a lasso around what is to go."""

    bl_idname = "ctmc.draw_lasso"
    bl_label = "Scissors"
    bl_description = "Draw a lasso around what to remove; hold Ctrl to keep it and remove the rest. Esc cancels"

    keep_inside: BoolProperty(name="Keep Inside", description="Remove what is outside the lasso", options={"SKIP_SAVE"})

    needs = (jobs.idle, can_draw, has_structure)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        region = None if context.area is None else window_under(context.area, event)
        if region is None or region.data is None:
            self.report({"ERROR"}, translate("Press this in a 3D viewport"))
            return {"CANCELLED"}
        self.region = region
        self.corners = [self.place(event)]
        self.drawing = bpy.types.SpaceView3D.draw_handler_add(self.draw, (region.as_pointer(),), "WINDOW", "POST_PIXEL")
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def place(self, event: Any) -> tuple[float, float]:
        """Return the mouse position in the region, pixels."""
        return (event.mouse_x - self.region.x, event.mouse_y - self.region.y)

    def draw(self, region: int) -> None:
        if bpy.context.region.as_pointer() == region:
            draw_path([*self.corners, self.corners[0]])

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Follow the mouse, and cut when the button is released."""
        if event.type in ("ESC", "RIGHTMOUSE") and event.value == "PRESS":
            self.cancel(context)
            return {"CANCELLED"}
        if event.type in ("MOUSEMOVE", "INBETWEEN_MOUSEMOVE"):
            (x, y), (last_x, last_y) = self.place(event), self.corners[-1]
            if abs(x - last_x) + abs(y - last_y) >= STEP:
                self.corners.append((x, y))
                session.redraw_viewports()
        if event.type != "LEFTMOUSE" or event.value != "RELEASE":
            return {"RUNNING_MODAL"}
        self.cancel(context)
        if len(self.corners) < FEWEST:
            return {"CANCELLED"}
        width, height = self.region.width, self.region.height
        lasso = points_of((2 * x / width - 1, 2 * y / height - 1) for x, y in self.corners)
        view = np.array(self.region.data.perspective_matrix) * np.array([machine().scale] * 3 + [1.0])
        bpy.ops.ctmc.draw_cut("INVOKE_DEFAULT", view=view.ravel().tolist(), lasso=lasso, keep_inside=self.keep_inside)
        return {"FINISHED"}

    def cancel(self, _context: bpy.types.Context) -> None:
        bpy.types.SpaceView3D.draw_handler_remove(self.drawing, "WINDOW")
        session.redraw_viewports()


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_draw_cut, CTMC_OT_draw_lasso))
