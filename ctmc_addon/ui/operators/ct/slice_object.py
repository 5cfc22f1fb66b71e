# SPDX-License-Identifier: GPL-3.0-or-later
"""Add slices that stay in the scene, and cut surfaces open at them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import bpy
from bpy.props import BoolProperty

from ....blender.slices import add_slice, at_corners, cut_at_slice, cuts_of, flip, is_cuttable, is_slice
from ....core import MeshError
from ....core.volume import PLANES, SliceIndex, slice_at, slice_corners, slice_through, value_at
from ... import jobs
from ...properties.ct.view import positions_of, window_and_level
from ...properties.preferences import machine
from ...state.ct import volumes
from ...translations import translate
from ...viewport.ct import slice_objects


def in_object_mode(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether objects can be selected, with the reason if not."""
    if context.mode != "OBJECT":
        operator.poll_message_set(other_mode_text(context))
        return False
    return True


def other_mode_text(context: bpy.types.Context) -> str:
    """Return the remedy for a mode in which objects cannot be selected, in English."""
    return "Leave Edit Mode first" if context.mode.startswith("EDIT") else "Switch to Object Mode first"


class CTMC_OT_add_slice(bpy.types.Operator):
    """Add the shown slice, or three through the 3D cursor, as planes that render."""

    bl_idname = "ctmc.add_slice"
    bl_label = "Add Slice"
    bl_description = "Add the shown slice as a plane at its position, with the CT on it; it is saved and rendered"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    three: BoolProperty(
        name="Three Planes",
        description=(
            "Add an axial, a coronal and a sagittal slice that cross at the 3D cursor; if the cursor "
            "is outside the CT or at the world origin, add the slices chosen in the sidebar"
        ),
        default=False,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return in_object_mode(cls, context) and volumes.has_volume(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        volume, view = volumes.require_loaded(scene).volume, scene.ctmc_view
        cursor_mm = [value / machine().scale for value in scene.cursor.location]
        if self.three and any(cursor_mm) and value_at(volume, cursor_mm) is not None:
            sections = {plane: slice_through(volume, plane, cursor_mm) for plane in PLANES}
        elif self.three:
            sections = chosen_slices(scene)
        else:
            sections = {view.plane: slice_at(volume, view.plane, view.position)}
        count = add_slices(context, sections)
        text = translate("Slices added: {count}").format(count=count)
        self.report({"INFO"}, text if count else translate("This slice exists already; it is shown now"))
        return {"FINISHED"}


def chosen_slices(scene: bpy.types.Scene) -> dict[str, SliceIndex]:
    """Return the slice of each plane as set in the sidebar."""
    volume, positions = volumes.require_loaded(scene).volume, zip(PLANES, positions_of(scene.ctmc_view), strict=True)
    return {plane: slice_at(volume, plane, position) for plane, position in positions}


def add_slices(context: bpy.types.Context, sections: dict[str, SliceIndex]) -> int:
    """Show slices as objects, the new ones selected; return how many are new."""
    scene = context.scene
    existing = {plane: _existing_slice(scene, section) for plane, section in sections.items()}
    for obj in existing.values():
        if obj is not None:
            obj.hide_set(False)
    missing = [plane for plane in sections if existing[plane] is None]
    if missing:
        bpy.ops.object.select_all(action="DESELECT")
    for plane in missing:
        obj = _new_slice(scene, plane, sections[plane])
        obj.select_set(True)
        context.view_layer.objects.active = obj
    slice_objects.show_pictures()
    return len(missing)


def _existing_slice(scene: bpy.types.Scene, section: SliceIndex) -> bpy.types.Object | None:
    """Return the slice object at a slice of the scene's CT, or None."""
    ct = volumes.require_loaded(scene)
    return at_corners(scene, ct.statistics.fingerprint, slice_corners(ct.volume, section), machine().scale)


def _new_slice(scene: bpy.types.Scene, plane: str, section: SliceIndex) -> bpy.types.Object:
    """Add a slice of the scene's CT, with window and level of the sidebar."""
    ct = volumes.require_loaded(scene)
    window, level = window_and_level(scene.ctmc_view)
    volume = replace(ct.volume, name=volumes.called(scene))
    return add_slice(scene, volume, section, plane, window, level, machine().scale, ct.statistics.fingerprint)


class CTMC_OT_cut_at_slice(bpy.types.Operator):
    """Cut the selected surfaces open at a slice."""

    bl_idname = "ctmc.cut_at_slice"
    bl_label = "Cut at Slice"
    bl_description = (
        "Cut the selected surfaces open at the active slice object, or at the shown slice; the cut "
        "shows the CT. Move the slice object to move the cut; remove the modifier CTMC Cut to undo it"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not in_object_mode(cls, context):
            return False
        if not any(is_cuttable(obj) for obj in context.selected_objects):
            cls.poll_message_set("Select surfaces first")
            return False
        return is_slice(context.object) or volumes.has_volume(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        surfaces = [obj for obj in context.selected_objects if is_cuttable(obj)]
        if not is_slice(context.object):
            view = context.scene.ctmc_view
            section = slice_at(volumes.require_loaded(context.scene).volume, view.plane, view.position)
            plane = _existing_slice(context.scene, section) or _new_slice(context.scene, view.plane, section)
        else:
            plane = context.object
        try:
            cut_at_slice(context.scene, surfaces, plane)
        except MeshError as error:
            return jobs.refuse(self, context.scene.session_uid, error)
        # The cut shows the same picture at the same place.
        plane.hide_set(True)
        slice_objects.show_pictures()
        self.report({"INFO"}, translate("Surfaces cut: {count}").format(count=len(surfaces)))
        return {"FINISHED"}


class CTMC_OT_flip_cut(bpy.types.Operator):
    """Keep the other half of a cut."""

    bl_idname = "ctmc.flip_cut"
    bl_label = "Flip Cut"
    bl_description = (
        "Keep the other half of the last cut of the active surface, or of the cut at the active "
        "slice object. Other surfaces cut at the same slice follow"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not cuts_of(context.view_layer.objects.active):
            cls.poll_message_set("First make a surface active that is cut at a slice")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            flip(cuts_of(context.view_layer.objects.active)[-1])
        except MeshError as error:
            return jobs.refuse(self, context.scene.session_uid, error)
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_add_slice, CTMC_OT_cut_at_slice, CTMC_OT_flip_cut))
