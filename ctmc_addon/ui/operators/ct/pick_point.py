# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the slices meet at a clicked point and show its value in the status bar: the operator `ctmc.pick_point`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
from bpy.props import FloatVectorProperty

from ....blender.rulers import hit, patient_mm
from ....blender.slices import cross_at
from ....core import Volume
from ....core.volume import PLANES, position_through, slice_at, slice_corners, where_ray_meets
from ...needs import Needs
from ...properties.preferences import machine
from ...state import session
from ...state.ct import volumes
from ...translations import translate
from ...viewport.ct import slice_objects
from ...viewport.draw.draw_tools import point_text
from ...viewport.mouse import Clicks, is_end, ray_under, viewport_at


def _drawn_slice_hit(scene: bpy.types.Scene, volume: Volume, origin: Any, direction: Any) -> Any:
    """Return where a ray meets the drawn slice, world space; None if it does not."""
    view = scene.ctmc_view
    if not view.show_slice:
        return None
    corners = slice_corners(volume, slice_at(volume, view.plane, view.position)) * machine().scale
    way = where_ray_meets(corners, origin, direction)
    return None if way is None else origin + direction * way


def _hit_under(context: bpy.types.Context, volume: Volume, area: bpy.types.Area, event: Any) -> Any:
    """Return the object under the mouse, None for the drawn slice, and the position in RAS+ mm; None without a hit."""
    ray = ray_under(area, event)
    if ray is None:
        return None
    origin, _ = ray
    hits = [hit(context.scene, context.evaluated_depsgraph_get(), *ray)]
    if area.spaces.active.overlay.show_overlays:
        place = _drawn_slice_hit(context.scene, volume, *ray)
        hits.append(None if place is None else (None, place))
    nearest = min(filter(None, hits), key=lambda hit_point: (hit_point[1] - origin).length, default=None)
    return None if nearest is None else (nearest[0], patient_mm(*nearest, machine().scale))


class CTMC_OT_pick_point(Clicks, Needs, bpy.types.Operator):
    """Let the slices meet at clicked points, until Esc."""

    bl_idname = "ctmc.pick_point"
    bl_label = "Pick Point"
    bl_description = (
        "Click in a slice or on a surface to move the other slices and the 3D cursor there. The "
        "status bar shows position and value under the mouse. Esc or a right click ends it"
    )

    point_mm: FloatVectorProperty(name="Point", size=3, options={"HIDDEN", "SKIP_SAVE"})

    needs = (volumes.has_volume,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        self.pick(context, None, tuple(self.point_mm))
        self.report({"INFO"}, point_text(volumes.require_loaded(context.scene).volume, self.point_mm))
        return {"FINISHED"}

    def pick(self, context: bpy.types.Context, clicked: bpy.types.Object | None, point_mm: Sequence[float]) -> None:
        """Move the slices, drawn and added, to a point."""
        scene = context.scene
        ct, view = volumes.require_loaded(scene), scene.ctmc_view
        view.positions = [position_through(ct.volume, plane, point_mm) for plane in PLANES]
        cross_at(scene, ct.volume, ct.statistics.fingerprint, point_mm, machine().scale, clicked)
        context.view_layer.update()
        slice_objects.show(scene)
        session.redraw_viewports()

    def ask(self, context: bpy.types.Context) -> None:
        self.show_status(context, "")

    def show_status(self, context: bpy.types.Context, text: str) -> None:
        help_text = translate("Click: the slices meet there. Esc: done")
        context.workspace.status_text_set(f"{text}   |   {help_text}" if text else help_text)

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Follow the mouse; navigation and all other events pass through."""
        area, ct = viewport_at(context, self.area), volumes.loaded(context.scene)
        if area is None or ct is None or is_end(event):
            self.cancel(context)
            return {"FINISHED"}
        is_click = event.type == "LEFTMOUSE" and event.value in ("PRESS", "DOUBLE_CLICK")
        if event.type != "MOUSEMOVE" and not is_click:
            return {"PASS_THROUGH"}
        hit_point = _hit_under(context, ct.volume, area, event)
        self.show_status(context, "" if hit_point is None else point_text(ct.volume, hit_point[1]))
        if hit_point is None or not is_click:
            return {"PASS_THROUGH"}
        self.pick(context, *hit_point)
        bpy.ops.ed.undo_push(message=translate(self.bl_label))
        return {"RUNNING_MODAL"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_pick_point,))
