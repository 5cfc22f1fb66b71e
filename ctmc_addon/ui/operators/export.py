"""Write a surface to a file: the operator `ctmc.export`."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from ...blender.export import SUFFIXES, export
from ...core import CtmcError
from .. import jobs
from ..translations import translate
from .paths import RELATIVE, with_suffix


class CTMC_OT_export(bpy.types.Operator):
    """Write the active surface in patient millimetres; the suffix chooses the format."""

    bl_idname = "ctmc.export"
    bl_label = "Export Surface"
    bl_description = (
        f"Write the active surface in millimetres; the suffix chooses the format, else STL: {', '.join(SUFFIXES)}"
    )

    filepath: StringProperty(name="File", subtype="FILE_PATH", options=RELATIVE)
    check_existing: BoolProperty(default=True, options={"HIDDEN"})
    filter_glob: StringProperty(default=";".join(f"*{suffix}" for suffix in SUFFIXES), options={"HIDDEN"})
    space: EnumProperty(
        name="Space",
        description="Axes of STL, PLY and OBJ",
        items=[
            ("ras", "RAS", "x to the patient's right, y to the front, z to the head"),
            ("lps", "LPS", "x to the patient's left, y to the back, z to the head, as in DICOM"),
        ],
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only with a mesh to write."""
        if context.object is None or context.object.type != "MESH":
            cls.poll_message_set("Choose a surface first")
            return False
        if context.object.mode == "EDIT":
            cls.poll_message_set("Leave edit mode first")
            return False
        return True

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for a file."""
        if not self.filepath:
            self.filepath = f"{context.object.name}.stl"
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def check(self, _context: bpy.types.Context) -> bool:
        """Name the file in the dialog as it will be named, so that the dialog asks before one is replaced."""
        before, self.filepath = self.filepath, with_suffix(self.filepath, SUFFIXES[0])
        return bool(before != self.filepath)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write it."""
        path = Path(bpy.path.abspath(with_suffix(self.filepath, SUFFIXES[0])))
        try:
            export(context.object, path, space=self.space, scene=context.scene)
        except CtmcError as error:
            return jobs.refuse(self, context.scene.session_uid, error)
        self.report({"INFO"}, translate("Wrote {name}").format(name=path.name))
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_export,))
