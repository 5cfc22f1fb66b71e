# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure between clicked points: the operators `ctmc.measure_distance` and `ctmc.measure_angle`."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import FloatVectorProperty

from ....blender.rulers import KINDS, add_ruler, full_hit, hit, patient_mm
from ....core import MeshError
from ... import jobs
from ...properties.preferences import machine
from ...state import session
from ...translations import translate
from ...viewport.mouse import Clicks, ray_under, viewport_at, window_under
from ...viewport.results import rulers


class _RulerClicks(Clicks):
    """Clicks on surfaces that add a ruler with its value; inherited before `bpy.types.Operator`."""

    kind = ""
    called = ""
    asks: tuple[str, ...] = ()

    def execute(self: Any, context: bpy.types.Context) -> set[str]:
        points, scale = [tuple(self.points_mm[i : i + 3]) for i in range(0, 3 * KINDS[self.kind], 3)], machine().scale
        return self.add(context, [tuple(value * scale for value in point) for point in points], points)

    def add(self: Any, context: bpy.types.Context, world_points: list[Any], points: list[Any]) -> set[str]:
        """Add the ruler, and select only it where Blender's mode allows it."""
        scene, name = context.scene, translate(self.called)
        fingerprint = scene.ctmc.volume_fingerprint
        try:
            ruler = add_ruler(scene, self.kind, world_points, name, machine().scale, points, fingerprint)
        except MeshError as error:
            return jobs.refuse(self, scene.session_uid, error)
        self.report({"INFO"}, ruler.name)
        session.redraw_viewports()
        return {"FINISHED"}

    def invoke(self: Any, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.points = list[Any]()
        rulers.pending.world_points, rulers.pending.next_point = [], None
        return super().invoke(context, event)

    def ask(self: Any, context: bpy.types.Context) -> None:
        """Say in the status bar what the next click is."""
        context.workspace.status_text_set(translate(self.asks[len(self.points)]))

    def modal(self: Any, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Follow the mouse; a click sets a point, Esc or a right click cancels."""
        area = viewport_at(context, self.area)
        if area is None or (event.type in ("ESC", "RIGHTMOUSE") and event.value == "PRESS"):
            self.cancel(context)
            return {"CANCELLED"}
        if event.type == "MOUSEMOVE":
            surface_hit = self.under(context, area, event)
            rulers.pending.next_point = None if surface_hit is None else surface_hit[1]
            area.tag_redraw()
        elif event.type == "LEFTMOUSE" and event.value == "PRESS" and window_under(area, event):
            surface_hit = self.under(context, area, event, full_hit)
            if surface_hit is None:
                self.report({"WARNING"}, translate("There is no surface under the mouse"))
                return {"RUNNING_MODAL"}
            self.points.append(patient_mm(surface_hit[0], surface_hit[1], machine().scale))
            rulers.pending.world_points.append(surface_hit[1])
            if len(self.points) < KINDS[self.kind]:
                self.ask(context)
                return {"RUNNING_MODAL"}
            world_points = list(rulers.pending.world_points)
            self.cancel(context)
            return self.add(context, world_points, self.points)
        return {"PASS_THROUGH"}

    def under(
        self: Any, context: bpy.types.Context, area: bpy.types.Area, event: bpy.types.Event, find: Any = hit
    ) -> Any:
        """Return the object under the mouse and the point hit, or None."""
        ray = ray_under(area, event)
        return None if ray is None else find(context.scene, context.evaluated_depsgraph_get(), *ray)

    def cancel(self: Any, context: bpy.types.Context) -> None:
        """Stop drawing the wire, and restore pointer and status bar."""
        rulers.pending.world_points, rulers.pending.next_point = [], None
        super().cancel(context)
        session.redraw_viewports()


class CTMC_OT_measure_distance(_RulerClicks, bpy.types.Operator):
    """Measure the distance of two points on surfaces or slices."""

    bl_idname = "ctmc.measure_distance"
    bl_label = "Distance"
    bl_description = (
        "Click on two points of surfaces or slice objects; their distance in the patient [mm] stays as an object"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)
    kind, called = "distance", "Distance"
    asks = ("Click on the first point. Esc: cancel", "Click on the last point. Esc: cancel")

    points_mm: FloatVectorProperty(name="Points", size=6, options={"HIDDEN", "SKIP_SAVE"})


class CTMC_OT_measure_angle(_RulerClicks, bpy.types.Operator):
    """Measure the angle at the second of three points on surfaces or slices."""

    bl_idname = "ctmc.measure_angle"
    bl_label = "Angle"
    bl_description = (
        "Click on three points of surfaces or slice objects; the angle at the second one in degrees stays as an object"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)
    kind, called = "angle", "Angle"
    asks = (
        "Click on the first point. Esc: cancel",
        "Click on the corner. Esc: cancel",
        "Click on the last point. Esc: cancel",
    )

    points_mm: FloatVectorProperty(name="Points", size=9, options={"HIDDEN", "SKIP_SAVE"})


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_measure_distance, CTMC_OT_measure_angle))
