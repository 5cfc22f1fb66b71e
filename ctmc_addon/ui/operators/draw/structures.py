# SPDX-License-Identifier: GPL-3.0-or-later
"""Structures are added and removed: the operators `ctmc.draw_add` and `ctmc.draw_remove`."""

from __future__ import annotations

import bpy

from ... import jobs
from ...needs import Needs
from ...state import drawings
from ...translations import translate
from .needs import can_draw, has_structure


class CTMC_OT_draw_add(Needs, bpy.types.Operator):
    """Add an empty structure to draw on."""

    bl_idname = "ctmc.draw_add"
    bl_label = "Add Structure"
    bl_description = "Add an empty structure; the tools then draw on it"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    needs = (jobs.idle, can_draw)

    def execute(self, context: bpy.types.Context) -> set[str]:
        drawings.add(context.scene, translate("Structure"))
        return {"FINISHED"}


class CTMC_OT_draw_remove(Needs, bpy.types.Operator):
    """Remove the structure that is drawn on."""

    bl_idname = "ctmc.draw_remove"
    bl_label = "Remove Structure"
    bl_description = "Remove the structure with all that was drawn of it; surfaces that were made of it stay"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    needs = (jobs.idle, can_draw, has_structure)

    def execute(self, context: bpy.types.Context) -> set[str]:
        item = drawings.active(context.scene)
        assert item is not None, "poll asks for one"
        drawings.remove(context.scene, item)
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_draw_add, CTMC_OT_draw_remove))
