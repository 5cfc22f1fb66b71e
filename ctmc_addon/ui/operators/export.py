# SPDX-License-Identifier: GPL-3.0-or-later
"""Write a surface to a file: the operator `ctmc.export`."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import EnumProperty, StringProperty

from ...blender.export import SUFFIXES, export
from .paths import SaveDialog


class CTMC_OT_export(SaveDialog, bpy.types.Operator):
    """Write the active surface in patient millimeters; the suffix chooses the format."""

    bl_idname = "ctmc.export"
    bl_label = "Export Surface"
    bl_description = (
        f"Write the active surface in millimeters; the suffix chooses the format, else STL: {', '.join(SUFFIXES)}"
    )

    suffix = SUFFIXES[0]

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

    def suggestion(self, context: bpy.types.Context) -> str:
        """The object's name."""
        return f"{context.object.name}{self.suffix}"

    def write(self, context: bpy.types.Context, path: Path) -> None:
        """Write it."""
        export(context.object, path, space=self.space, scene=context.scene)


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_export,))
