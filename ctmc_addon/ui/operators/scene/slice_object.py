# SPDX-License-Identifier: GPL-3.0-or-later
"""Slices that stay in the scene, and surfaces cut open at them."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import BoolProperty

from ....blender.slices import add_slice, cut_at_slice, is_slice
from ....core import MeshError
from ....core.volume import PLANES, slice_at, slice_through, value_at
from ... import jobs
from ...properties.preferences import machine
from ...properties.view import positions_of, window_and_level
from ...state import volumes
from ...translations import translate
from ...viewport import slice_objects


def in_object_mode(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether objects can be selected, with the reason if not."""
    if context.mode != "OBJECT":
        operator.poll_message_set("Leave edit mode first")
        return False
    return True


class CTMC_OT_add_slice(bpy.types.Operator):
    """Add the shown slice, or three through the 3D cursor, as planes that render."""

    bl_idname = "ctmc.add_slice"
    bl_label = "Add Slice"
    bl_description = "Add the slice that is shown as a plane at its place, with the CT on it; it is saved and rendered"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    three: BoolProperty(
        name="Three Planes",
        description=(
            "Add an axial, a coronal and a sagittal slice that cross at the 3D cursor; where that is outside the CT, "
            "those that the sidebar has chosen"
        ),
        default=False,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return in_object_mode(cls, context) and volumes.has_volume(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        ct, view, scale = volumes.require_loaded(scene), scene.ctmc_view, machine().scale
        cursor_mm = [value / scale for value in scene.cursor.location]
        if self.three and value_at(ct.volume, cursor_mm) is not None:
            sections = {plane: slice_through(ct.volume, plane, cursor_mm) for plane in PLANES}
        elif self.three:
            chosen = zip(PLANES, positions_of(view), strict=True)
            sections = {plane: slice_at(ct.volume, plane, position) for plane, position in chosen}
        else:
            sections = {view.plane: slice_at(ct.volume, view.plane, view.position)}
        bpy.ops.object.select_all(action="DESELECT")
        for plane, section in sections.items():
            window, level = window_and_level(view)
            obj = add_slice(scene, ct.volume, section, plane, window, level, scale, ct.statistics.fingerprint)
            obj.select_set(True)
            context.view_layer.objects.active = obj
        slice_objects.show_pictures()
        self.report({"INFO"}, translate("Slices that were added: {count}").format(count=len(sections)))
        return {"FINISHED"}


class CTMC_OT_cut_at_slice(bpy.types.Operator):
    """Cut the selected surfaces open at a slice."""

    bl_idname = "ctmc.cut_at_slice"
    bl_label = "Cut at Slice"
    bl_description = (
        "Cut the selected surfaces open at the active slice object, or at the slice that is shown; the cut shows the "
        "CT. Moving the slice object moves the cut; the modifier CTMC Cut takes it away"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not in_object_mode(cls, context):
            return False
        if not any(obj.type == "MESH" and not is_slice(obj) for obj in context.selected_objects):
            cls.poll_message_set("Select surfaces first")
            return False
        return is_slice(context.object) or volumes.has_volume(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        surfaces = [obj for obj in context.selected_objects if obj.type == "MESH" and not is_slice(obj)]
        if not is_slice(context.object):
            active = context.object
            bpy.ops.ctmc.add_slice()
            plane = context.object
            for obj in surfaces:
                obj.select_set(True)
            plane.select_set(False)
            context.view_layer.objects.active = active
        else:
            plane = context.object
        try:
            cut_at_slice(context.scene, surfaces, plane)
        except MeshError as error:
            return jobs.refuse(self, context.scene.session_uid, error)
        # The cut shows the same picture at the same place.
        plane.hide_set(True)
        slice_objects.show_pictures()
        self.report({"INFO"}, translate("Surfaces that were cut: {count}").format(count=len(surfaces)))
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_add_slice, CTMC_OT_cut_at_slice))
