# SPDX-License-Identifier: GPL-3.0-or-later
"""Step through the slices, and set their window and level."""

from __future__ import annotations

import bpy
from bpy.props import FloatProperty, IntProperty

from ....core.volume import stepped_position
from ...properties.ct.view import choose
from ...state.ct import volumes


class CTMC_OT_slice_step(bpy.types.Operator):
    """Move the slice by whole samples."""

    bl_idname = "ctmc.slice_step"
    bl_label = "Step Slice"
    bl_description = "Show the next slice"
    bl_options = {"INTERNAL"}  # noqa: RUF012  (Blender reads it from the class)

    by: IntProperty(name="Slices", default=1)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return volumes.current(context.scene) is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        volume = volumes.current(context.scene)
        assert volume is not None, "poll asks for one"
        view = context.scene.ctmc_view
        view.position = stepped_position(volume, view.plane, view.position, self.by)
        return {"FINISHED"}


class CTMC_OT_window(bpy.types.Operator):
    """Show the slice with a usual window and level."""

    bl_idname = "ctmc.window"
    bl_label = "Set Window"
    bl_description = "Show the slice with this window and level"
    bl_options = {"INTERNAL"}  # noqa: RUF012  (Blender reads it from the class)

    window: FloatProperty(name="Window", default=400.0, min=1e-3)
    level: FloatProperty(name="Level", default=40.0)

    def execute(self, context: bpy.types.Context) -> set[str]:
        choose(context.scene.ctmc_view, self.window, self.level)
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_slice_step, CTMC_OT_window))
