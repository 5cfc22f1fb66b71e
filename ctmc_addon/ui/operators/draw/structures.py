# SPDX-License-Identifier: GPL-3.0-or-later
"""Add a structure, and select a tool: `ctmc.draw_add` and `ctmc.draw_tool`."""

from __future__ import annotations

import bpy
from bpy.props import StringProperty

from ....blender.slices import slices_of
from ... import jobs
from ...needs import Needs
from ...state.ct import volumes
from ...state.draw import drawings
from ...translations import translate
from .needs import can_draw


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


class CTMC_OT_draw_tool(Needs, bpy.types.Operator):
    """Select a tool, and show a slice to draw on if none is shown."""

    bl_idname = "ctmc.draw_tool"
    bl_label = "Select Tool"
    bl_description = "Select this tool, also found in the toolbar (T)"

    tool: StringProperty(options={"HIDDEN", "SKIP_SAVE"})

    needs = (can_draw,)

    def execute(self, context: bpy.types.Context) -> set[str]:
        ct = volumes.require_loaded(context.scene)
        if not any(slices_of(context.scene, ct.statistics.fingerprint)):
            context.scene.ctmc_view.show_slice = True
        bpy.ops.wm.tool_set_by_id(name=self.tool)
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_draw_add, CTMC_OT_draw_tool))
