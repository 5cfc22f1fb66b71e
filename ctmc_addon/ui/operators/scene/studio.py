# SPDX-License-Identifier: GPL-3.0-or-later
"""Add camera and lights for the visible surfaces: the operator `ctmc.setup_studio`."""

from __future__ import annotations

import bpy

from ....blender.scene.lighting import set_up_studio
from ....core import CtmcError
from ... import jobs
from ...state import surfaces
from ...translations import translate


def shown_surfaces(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Return the surfaces of the scene that a render shows."""
    return [
        obj
        for obj in context.scene.objects
        if surfaces.is_surface(obj) and obj.mode != "EDIT" and not obj.hide_render and obj.visible_get()
    ]


class CTMC_OT_setup_studio(bpy.types.Operator):
    """Add camera, lights and background."""

    bl_idname = "ctmc.setup_studio"
    bl_label = "Set Up Camera and Lights"
    bl_description = (
        "Add a camera that frames what is shown from the patient's front left, with key, fill and "
        "rim lights and a background. They are in a collection of their own, CTMC Studio, that may "
        "be deleted"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not shown_surfaces(context):
            cls.poll_message_set("Show or reconstruct a surface first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        panel = context.scene.ctmc_figure
        try:
            folder = set_up_studio(context.scene, shown_surfaces(context), panel.azimuth, panel.elevation)[0]
        except CtmcError as error:
            return jobs.refuse(self, context.scene.session_uid, error)
        text = translate("Camera and lights are in the collection {name}; F12 renders")
        self.report({"INFO"}, text.format(name=folder.name))
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_setup_studio,))
