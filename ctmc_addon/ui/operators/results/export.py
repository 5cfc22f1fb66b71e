# SPDX-License-Identifier: GPL-3.0-or-later
"""Write a surface to a file: the operator `ctmc.export`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.props import EnumProperty, StringProperty

from ....blender.export import export_together
from ....blender.shape_change import shape_change
from ....blender.slices import is_cut_box
from ....blender.surface import read_provenance
from ....core import OutputError
from ....core.files.file_names import file_name
from ....core.files.mesh_files import SCENE_SUFFIXES, SPACES, SURFACE_SUFFIXES
from ....reporting.formatting import count, file_size
from ...state.ct import scans
from ...state.results.surfaces import label_and_name, mirrored_text, scaled_text, selected_surfaces, shown_in
from ...translations import translate
from ..paths import SaveDialog

FORMATS = ", ".join(SURFACE_SUFFIXES)
SEVERAL = ".glb"
"""The format of several surfaces where the last one used holds a single one."""


def _default_which(context: bpy.types.Context, suffix: str) -> str:
    """Return which surfaces go to a file: several selected ones, else all visible ones if its format holds them."""
    if len(selected_surfaces(context)) > 1:
        return "SELECTED"
    return "VISIBLE" if suffix in SCENE_SUFFIXES or not _is_exportable(context.object) else "ACTIVE"


def _is_exportable(obj: bpy.types.Object | None) -> bool:
    """Return whether an object is a mesh to export; the box of Cut Away is not."""
    return obj is not None and obj.type == "MESH" and not is_cut_box(obj)


def _match_format(dialog: Any) -> None:
    """Match the format and the suffix of the name; the one that was changed leads."""
    path = Path(dialog.filepath)
    if path.suffix.lower() in SURFACE_SUFFIXES and path.suffix.lower() != dialog.kind:
        if dialog.kind == getattr(dialog, "shown_kind", dialog.kind):
            dialog.kind = path.suffix.lower()
        else:
            dialog.filepath = str(path.with_suffix(dialog.kind))


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
        description="Surfaces to write; an STL or PLY holds one. By default the selected ones if there are several",
        options={"SKIP_SAVE"},
        items=[
            ("ACTIVE", "Active", "The active surface"),
            ("SELECTED", "Selected", "All selected meshes"),
            ("VISIBLE", "Visible", "All visible surfaces made from a CT"),
        ],
    )

    def ending(self) -> str:
        return str(self.kind)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self.properties.is_property_set("which"):
            self.which = _default_which(context, self.kind)
        if len(self.surfaces(context)) > 1 and self.kind not in SCENE_SUFFIXES:
            self.kind = SEVERAL
        self.shown_kind, self.shown_which = self.kind, self.which
        self.suggested = self.suggestion(context)
        return SaveDialog.invoke(self, context, event)

    def check(self, context: bpy.types.Context) -> bool:
        """Match format, surfaces and name; the one that was changed leads."""
        before = self.filepath, getattr(self, "which", "")
        _match_format(self)
        if getattr(self, "suggested", ""):
            self.follow(context)
        self.shown_kind = self.kind
        return SaveDialog.check(self, context) or before != (self.filepath, getattr(self, "which", ""))

    def follow(self, context: bpy.types.Context) -> None:
        """Choose the surfaces of another format, and the name of other surfaces, where no hand has changed them."""
        if self.kind != self.shown_kind and self.which == self.shown_which:
            self.which = _default_which(context, self.kind)
        self.shown_which = self.which
        path, suggestion = Path(self.filepath), self.suggestion(context)
        if path.name == str(Path(self.suggested).with_suffix(path.suffix)):
            self.filepath = str(path.with_name(suggestion))
        self.suggested = suggestion

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        obj = context.object
        if not _is_exportable(obj) and not shown_in(context.scene):
            cls.poll_message_set("Choose a surface first")
            return False
        if obj is not None and obj.mode == "EDIT":
            cls.poll_message_set("Leave Edit Mode first")
            return False
        return True

    def suggestion(self, context: bpy.types.Context) -> str:
        """Suggest the name of the surface; for several that of their CT."""
        objects = self.surfaces(context)
        scene = context.scene
        name = scans.name_of(scene, scene.ctmc) if scene.ctmc.volume_path else scene.name
        name = objects[0].name if len(objects) == 1 else name
        return f"{file_name(name)}{self.ending()}"

    def write(self, context: bpy.types.Context, path: Path) -> None:
        if not self.properties.is_property_set("which"):
            self.which = _default_which(context, path.suffix.lower())
        objects = self.surfaces(context)
        if not objects:
            raise OutputError("no surface is visible; show or select one first")
        if len(objects) > 1 and path.suffix.lower() not in SCENE_SUFFIXES:
            raise OutputError(
                f"{path.name} can hold one surface, not {len(objects)}; choose the format 3MF or GLB, "
                "or Active as Surfaces"
            )
        self.written = len(objects), export_together(objects, path, space=self.space, scene=context.scene)

    def report_of(self, path: Path) -> str:
        """Return path, objects, triangles and size."""
        objects, faces = self.written
        text = translate("Wrote {path}: {count} objects, {faces} triangles, {size}")
        if objects == 1:
            text = translate("Wrote {path}: 1 object, {faces} triangles, {size}")
        return text.format(path=path, count=objects, faces=count(faces), size=file_size(path.stat().st_size))

    def warnings(self, context: bpy.types.Context) -> list[str]:
        """Warn of mirrored or scaled surfaces, which files store as the scene shows them."""
        changes = [(obj.name, shape_change(obj)) for obj in self.surfaces(context)]
        texts = [(name, text(change)) for text in (mirrored_text, scaled_text) for name, change in changes]
        return [f"{name}: {text}" for name, text in texts if text]

    def surfaces(self, context: bpy.types.Context) -> list[bpy.types.Object]:
        """Return the surfaces to write, in the order of the labels; the active one if none is selected or visible."""
        written = []
        if self.which == "SELECTED":
            written = [obj for obj in context.selected_objects if _is_exportable(obj)]
        elif self.which == "VISIBLE":
            written = [obj for obj in context.visible_objects if read_provenance(obj) is not None]
        return sorted(written, key=label_and_name) or [obj for obj in (context.object,) if _is_exportable(obj)]


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_export,))
