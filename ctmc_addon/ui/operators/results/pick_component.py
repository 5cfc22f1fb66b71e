# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep, remove or separate a clicked component: the operator `ctmc.pick_component`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
from bpy.props import EnumProperty, FloatVectorProperty

from ....blender.rulers import full_hit, patient_mm
from ....blender.surface import component_at, give_triangles, other_modifiers, own_surface, require_updatable, separated
from ....core import CtmcError, finish
from ....core.mesh import measures_steps
from ....reporting.formatting import count
from ... import jobs
from ...needs import Needs
from ...properties.preferences import machine
from ...state import session
from ...state.results import measurements, surfaces
from ...translations import translate
from ...viewport.mouse import Clicks, is_end, ray_under, viewport_at

ACTIONS = {
    "REMOVE": ("Remove", "Remove the component"),
    "KEEP": ("Keep", "Remove all other components of the surface"),
    "SEPARATE": ("Separate", "Turn the component into a separate object"),
}


class CTMC_OT_pick_component(Clicks, Needs, bpy.types.Operator):
    """Keep, remove or separate the components that are clicked, until Esc."""

    bl_idname = "ctmc.pick_component"
    bl_label = "Pick Component"
    bl_description = (
        "Click on components of surfaces one after the other to remove each, keep only it, or turn "
        "it into a separate object, with its cavities. Undo reverts a click, Esc or a right click "
        "ends it"
    )

    action: EnumProperty(
        name="Action",
        description="What to do with the component",
        items=[(name, label, text) for name, (label, text) in ACTIONS.items()],
    )
    point_mm: FloatVectorProperty(name="Point", size=3, options={"HIDDEN", "SKIP_SAVE"})

    needs = (jobs.idle, surfaces.can_change)

    def execute(self, context: bpy.types.Context) -> set[str]:
        obj = context.view_layer.objects.active
        try:
            text = picked(context, obj, tuple(self.point_mm), self.action)
        except CtmcError as error:
            return jobs.refuse(self, context.scene.session_uid, error)
        self.report({"INFO"}, text)
        return {"FINISHED"}

    def ask(self, context: bpy.types.Context) -> None:
        label = translate(ACTIONS[self.action][0])
        text = translate("{action}: click on a component. Ctrl Z: undo. Esc: done")
        context.workspace.status_text_set(text.format(action=label))

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Take clicks on surfaces; navigation, undo and all other events pass through."""
        area = viewport_at(context, self.area)
        if area is None or is_end(event):
            self.cancel(context)
            return {"FINISHED"}
        if event.type != "LEFTMOUSE" or event.value not in ("PRESS", "DOUBLE_CLICK"):
            return {"PASS_THROUGH"}
        ray = ray_under(area, event)
        surface_hit = None if ray is None else full_hit(context.scene, context.evaluated_depsgraph_get(), *ray)
        if surface_hit is None or not surfaces.is_surface(surface_hit[0]):
            return {"PASS_THROUGH"}
        try:
            text = picked(context, surface_hit[0], patient_mm(*surface_hit, machine().scale), self.action)
        except CtmcError as error:
            jobs.refuse(self, context.scene.session_uid, error)
            return {"RUNNING_MODAL"}
        self.report({"INFO"}, text)
        bpy.ops.ed.undo_push(message=translate(self.bl_label))
        return {"RUNNING_MODAL"}


def picked(context: bpy.types.Context, obj: bpy.types.Object, point_mm: Sequence[float], action: str) -> str:
    """Apply the action to the component at a point of a surface, RAS+ mm; return the message."""
    require_updatable(obj)
    before, result = measurements.of(obj), own_surface(obj)
    selected = component_at(result, np.array(point_mm, np.float64))
    changed: list[Any] = [obj]
    if action == "SEPARATE":
        changed.append(separated(obj, result, selected))
    else:
        give_triangles(obj, result, selected if action == "KEEP" else ~selected)
    for surface in changed:
        mesh = own_surface(surface).mesh
        measures = finish(measures_steps(mesh.vertices, mesh.faces))
        if not other_modifiers(surface):
            # Of triangles that do not cross each other, some do not either.
            crossings = 0 if before is not None and before.self_intersections == 0 else None
            measurement = measurements.Measurement(measures, None, crossings)
            measurements.keep(surface, measurement, measurements.mesh_state(surface))
    session.redraw_viewports()
    text = translate("{name}: {faces} triangles")
    return ", ".join(text.format(name=each.name, faces=count(len(each.data.polygons))) for each in changed)


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_pick_component,))
