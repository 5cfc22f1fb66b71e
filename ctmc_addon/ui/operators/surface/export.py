# SPDX-License-Identifier: GPL-3.0-or-later
"""Write a surface to a file: the operator `ctmc.export`."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import EnumProperty, StringProperty

from ....blender.export import export_together
from ....blender.shape_change import shape_change
from ....blender.slices import is_cut_box
from ....blender.surface import read_provenance
from ....core.files.file_names import file_name
from ....core.files.mesh_files import SPACES, SURFACE_SUFFIXES
from ...state.surfaces import label_and_name, mirrored_text, scaled_text
from ..paths import SaveDialog

FORMATS = ", ".join(SURFACE_SUFFIXES)


class CTMC_OT_export(SaveDialog, bpy.types.Operator):
    """Write surfaces in patient millimeters; the suffix chooses the format."""

    bl_idname = "ctmc.export"
    bl_label = "Export Surface"
    bl_description = f"Write surfaces in millimeters; the suffix chooses the format, else STL: {FORMATS}"

    suffixes = SURFACE_SUFFIXES

    filter_glob: StringProperty(default=";".join(f"*{suffix}" for suffix in SURFACE_SUFFIXES), options={"HIDDEN"})
    kind: EnumProperty(
        name="Format",
        description="Format of a file whose name has no suffix",
        items=[
            (suffix, suffix[1:].upper() if suffix != ".blend" else "Blender", suffix) for suffix in SURFACE_SUFFIXES
        ],
    )
    space: EnumProperty(
        name="Space",
        description="Axes of STL, PLY, OBJ and 3MF",
        items=[(space, space.upper(), axes) for space, axes in SPACES.items()],
    )
    which: EnumProperty(
        name="Surfaces",
        description="Surfaces to write; an STL or PLY holds one",
        items=[
            ("ACTIVE", "Active", "The active surface"),
            ("SELECTED", "Selected", "All selected meshes"),
            ("VISIBLE", "Visible", "All visible surfaces made from a CT"),
        ],
    )

    def ending(self) -> str:
        return str(self.kind)

    def check(self, context: bpy.types.Context) -> bool:
        """Match format and name; the one that was changed leads."""
        before, path = self.filepath, Path(self.filepath)
        if path.suffix.lower() in SURFACE_SUFFIXES and path.suffix.lower() != self.kind:
            if self.kind == getattr(self, "shown_kind", self.kind):
                self.kind = path.suffix.lower()
            else:
                self.filepath = str(path.with_suffix(self.kind))
        self.shown_kind = self.kind
        return SaveDialog.check(self, context) or bool(before != self.filepath)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.object is None or context.object.type != "MESH" or is_cut_box(context.object):
            cls.poll_message_set("Choose a surface first")
            return False
        if context.object.mode == "EDIT":
            cls.poll_message_set("Leave edit mode first")
            return False
        return True

    def suggestion(self, context: bpy.types.Context) -> str:
        return f"{file_name(context.object.name)}{self.ending()}"

    def write(self, context: bpy.types.Context, path: Path) -> None:
        export_together(self.surfaces(context), path, space=self.space, scene=context.scene)

    def warnings(self, context: bpy.types.Context) -> list[str]:
        """Warn of mirrored or scaled surfaces, which files store as the scene shows them."""
        changes = [(obj.name, shape_change(obj)) for obj in self.surfaces(context)]
        texts = [(name, text(change)) for text in (mirrored_text, scaled_text) for name, change in changes]
        return [f"{name}: {text}" for name, text in texts if text]

    def surfaces(self, context: bpy.types.Context) -> list[bpy.types.Object]:
        """Return the surfaces to write, in the order of the labels; the active surface if none is selected."""
        chosen = []
        if self.which == "SELECTED":
            chosen = [obj for obj in context.selected_objects if obj.type == "MESH" and not is_cut_box(obj)]
        elif self.which == "VISIBLE":
            chosen = [obj for obj in context.visible_objects if read_provenance(obj) is not None]
        return sorted(chosen, key=label_and_name) or [context.object]


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_export,))
