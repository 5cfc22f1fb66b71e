# SPDX-License-Identifier: GPL-3.0-or-later
"""Drag a handle of the panel's solid in the viewport: the operator `ctmc.solid_drag`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
from bpy.props import IntProperty

from ....blender.viewport import place_on_axis, place_on_plane
from ....core.solid import HalfSpace, moved_to, position_of
from ... import jobs
from ...needs import Needs
from ...properties.kinds import choice
from ...properties.preferences import machine
from ...state import session
from ...translations import translate
from ...viewport.mouse import ray_under, viewport_at
from ...viewport.surface.solid_handles import middle_of

HANDLES = (("MOVE", "Cut", ""), ("TURN", "Normal", ""), ("DRAIN", "Drain", ""))
TOO_CLOSE = 1e-6  # Within this distance of a cut's middle, the mouse gives no direction.
Ray = tuple[Any, Any]
Drag = Callable[[Ray], None]


class CTMC_OT_solid_drag(Needs, bpy.types.Operator):
    """Follow the mouse with a cut or a drain until the button is released."""

    bl_idname = "ctmc.solid_drag"
    bl_label = "Drag Cut or Drain"
    bl_description = (
        "Drag the arrow to move the cut along its normal, the ring before it to turn the cut, or the ring of a drain "
        "to move where it begins. Esc or a right click: cancel"
    )
    bl_options = {"UNDO", "INTERNAL"}  # noqa: RUF012  (Blender reads it from the class)

    what: choice("Handle", "Handle to drag", items=list(HANDLES), options={"HIDDEN", "SKIP_SAVE"})
    index: IntProperty(options={"HIDDEN", "SKIP_SAVE"})

    needs = (jobs.idle,)

    def execute(self, _context: bpy.types.Context) -> set[str]:
        return {"CANCELLED"}  # There is no mouse.

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Begin where the mouse is."""
        ray = None if context.area is None else ray_under(context.area, event)
        line = _line_of(context.scene, self.what, self.index)
        if ray is None or line is None:
            return {"CANCELLED"}
        self.area, self.before = context.area.as_pointer(), _values_of(line)
        self.drag = DRAGS[self.what](context.scene, self.index, ray)
        context.window_manager.modal_handler_add(self)
        context.workspace.status_text_set(translate("Release: accept. Esc: cancel"))
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        area, line = viewport_at(context, self.area), _line_of(context.scene, self.what, self.index)
        if area is None or line is None:
            self.cancel(context)
            return {"CANCELLED"}
        if event.type == "MOUSEMOVE":
            ray = ray_under(area, event)
            if ray is not None:
                self.drag(ray)
                session.redraw_viewports()
        elif event.type == "LEFTMOUSE" and event.value == "RELEASE":
            self.cancel(context)
            return {"FINISHED"} if _values_of(line) != self.before else {"CANCELLED"}
        elif event.type in ("ESC", "RIGHTMOUSE") and event.value == "PRESS":
            for name, value in self.before.items():
                setattr(line, name, value)
            self.cancel(context)
            session.redraw_viewports()
            return {"CANCELLED"}
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Restore the status bar."""
        if context.workspace is not None:
            context.workspace.status_text_set(None)


def _line_of(scene: bpy.types.Scene, what: str, index: int) -> Any:
    """Return the cut or drain of a handle; None if it was removed."""
    lines = scene.ctmc_solid.drains if what == "DRAIN" else scene.ctmc_solid.cuts
    return lines[index] if 0 <= index < len(lines) else None


def _values_of(line: Any) -> dict[str, tuple[float, ...]]:
    return {name: tuple(getattr(line, name)) for name in ("point", "normal") if hasattr(line, name)}


def moving(scene: bpy.types.Scene, index: int, start: Ray) -> Drag:
    """Return a function that moves a cut along its normal with the mouse."""
    cut, scale = scene.ctmc_solid.cuts[index].to_request(), machine().scale
    middle, unit = _middle(scene, index) * scale, HalfSpace(cut.point, cut.normal).unit
    begun = place_on_axis(start, middle, unit)

    def drag(ray: Ray) -> None:
        at = place_on_axis(ray, middle, unit)
        if begun is not None and at is not None:
            moved = moved_to(cut, position_of(cut) + (at - begun) / scale)
            scene.ctmc_solid.cuts[index].point = moved.point

    return drag


def turning(scene: bpy.types.Scene, index: int, start: Ray) -> Drag:
    """Return a function that turns a cut about its middle, so that its normal follows the mouse."""
    cut, scale = scene.ctmc_solid.cuts[index].to_request(), machine().scale
    middle, unit = _middle(scene, index), HalfSpace(cut.point, cut.normal).unit
    facing = np.array(start[1], np.float64)
    # The grabbed ring lies on the normal, from any viewpoint.
    reach = place_on_axis(start, middle * scale, unit)
    tip = middle * scale + unit * (scale if reach is None or reach <= 0 else reach)
    begun = place_on_plane(start, tip, facing)

    def drag(ray: Ray) -> None:
        at = place_on_plane(ray, tip, facing)
        if begun is None or at is None:
            return
        normal = tip + (at - begun) - middle * scale
        if (np.abs(normal) > TOO_CLOSE).any():
            line = scene.ctmc_solid.cuts[index]
            line.normal, line.point = HalfSpace((0.0, 0.0, 0.0), tuple(normal.tolist())).unit.tolist(), middle.tolist()

    return drag


def moving_drain(scene: bpy.types.Scene, index: int, start: Ray) -> Drag:
    """Return a function that moves the point of a drain across the view with the mouse."""
    scale, facing = machine().scale, np.array(start[1], np.float64)
    point = np.array(scene.ctmc_solid.drains[index].point, np.float64) * scale
    begun = place_on_plane(start, point, facing)

    def drag(ray: Ray) -> None:
        at = place_on_plane(ray, point, facing)
        if begun is not None and at is not None:
            scene.ctmc_solid.drains[index].point = ((point + at - begun) / scale).tolist()

    return drag


def _middle(scene: bpy.types.Scene, index: int) -> Any:
    """Return the middle of a cut's rectangle, or its point without a CT."""
    middle = middle_of(scene, index)
    return np.array(scene.ctmc_solid.cuts[index].point, np.float64) if middle is None else middle


DRAGS = {"MOVE": moving, "TURN": turning, "DRAIN": moving_drain}

register, unregister = bpy.utils.register_classes_factory((CTMC_OT_solid_drag,))
