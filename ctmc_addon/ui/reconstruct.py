"""Make a surface from the loaded CT: the operator `ctmc.reconstruct`."""

from __future__ import annotations

import bpy

from ..core import CtmcError, finish
from ..core.pipeline import reconstruct_steps
from ..scene import add_reconstruction
from . import volumes


class CTMC_OT_reconstruct(bpy.types.Operator):
    """Make a surface from the loaded CT with the settings of the panel."""

    bl_idname = "ctmc.reconstruct"
    bl_label = "Reconstruct Surface"
    bl_description = "Make a surface from the loaded CT with the settings above"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only with a CT in memory."""
        if volumes.current(context.scene) is None:
            cls.poll_message_set("Load a CT first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Do the whole work at once."""
        volume = volumes.current(context.scene)
        assert volume is not None, "poll asks for one"
        try:
            settings = context.scene.ctmc.to_settings()
            result = finish(reconstruct_steps(volume, settings))
            thing = add_reconstruction(result, context.scene)
        except CtmcError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for other in context.selected_objects:
            other.select_set(False)
        thing.select_set(True)
        context.view_layer.objects.active = thing
        self.report({"INFO"}, f"{thing.name}: {len(result.mesh.faces)} triangles")
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_reconstruct,))
