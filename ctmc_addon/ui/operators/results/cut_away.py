# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut away the inside or outside of a box from surfaces."""

from __future__ import annotations

from typing import Any

import bpy
from mathutils import Vector

from ....blender.slices import (
    add_cut_box,
    cut_away,
    cut_box_of,
    flip_cut_away,
    is_cut_box,
    is_cuttable,
    near_half,
    remove_cut_away,
)
from ....blender.surface import read_provenance
from ....core.volume import region_corners
from ...properties.preferences import machine
from ...state.ct import volumes
from ...translations import translate
from ..ct.slice_object import in_object_mode

FRONT = Vector((0.0, 1.0, 0.0))  # Axis to the front of the patient, RAS.


def _has_box(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether the active object is cut by a box or is one, with the reason if not."""
    if cut_box_of(context.view_layer.objects.active) is None:
        operator.poll_message_set("First make the box active, or a surface that it cuts")
        return False
    return True


def _first_corners(context: bpy.types.Context, surfaces: list[bpy.types.Object]) -> Any:
    """Return the corners of a new box: the panel's region, else the half of the surfaces nearest to the viewer."""
    volume, settings = volumes.current_full(context.scene) or volumes.current(context.scene), context.scene.ctmc
    if volume is not None and settings.use_region:
        return region_corners(volume, tuple(settings.region), settings.region_unit) * machine().scale
    eye = getattr(context.space_data, "region_3d", None)
    return near_half(surfaces, FRONT if eye is None else eye.view_rotation @ Vector((0.0, 0.0, 1.0)))


class CTMC_OT_cut_away(bpy.types.Operator):
    """Cut away what lies inside a box from the selected surfaces."""

    bl_idname = "ctmc.cut_away"
    bl_label = "Cut Away"
    bl_description = (
        "Cut away what lies inside a box from the selected surfaces: the active box, or a new one "
        "that starts as the panel's region, or as the half nearest to the viewer. Move, turn or "
        "scale the box to change the cut"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not in_object_mode(cls, context):
            return False
        if not any(is_cuttable(obj) for obj in context.selected_objects):
            cls.poll_message_set("Select surfaces first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        surfaces = [obj for obj in context.selected_objects if is_cuttable(obj)]
        box = context.object
        if not is_cut_box(box):
            provenance = read_provenance(surfaces[0])
            fingerprint = provenance.fingerprint if provenance is not None else ""
            box = add_cut_box(context.scene, _first_corners(context, surfaces), fingerprint)
        cut_away(surfaces, box)
        # G, R and S are then the box's.
        bpy.ops.object.select_all(action="DESELECT")
        box.select_set(True)
        context.view_layer.objects.active = box
        self.report({"INFO"}, translate("Surfaces cut: {count}").format(count=len(surfaces)))
        return {"FINISHED"}


class CTMC_OT_flip_cut_away(bpy.types.Operator):
    """Cut away outside the box instead of inside, and back."""

    bl_idname = "ctmc.flip_cut_away"
    bl_label = "Inside/Outside"
    bl_description = (
        "Cut away what lies outside the box instead of inside, or back: for the active box, or the "
        "last one that cuts the active surface. Other surfaces cut by the same box follow"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _has_box(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        flip_cut_away(cut_box_of(context.view_layer.objects.active))
        return {"FINISHED"}


class CTMC_OT_remove_cut_away(bpy.types.Operator):
    """Remove a box and its cuts."""

    bl_idname = "ctmc.remove_cut_away"
    bl_label = "Remove Cut Away"
    bl_description = "Remove the active box, or the last that cuts the active surface; its surfaces are whole again"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return in_object_mode(cls, context) and _has_box(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        remove_cut_away(cut_box_of(context.view_layer.objects.active))
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory(
    (CTMC_OT_cut_away, CTMC_OT_flip_cut_away, CTMC_OT_remove_cut_away)
)
