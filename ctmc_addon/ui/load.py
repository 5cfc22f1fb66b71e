"""Load a CT: the operator `ctmc.load`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.props import FloatVectorProperty, StringProperty

from .. import readers
from ..core import CtmcError
from . import volumes


class CTMC_OT_load(bpy.types.Operator):
    """Read a CT stack: a folder of slices, a DICOM series, NIfTI, NRRD, TIFF or npy."""

    bl_idname = "ctmc.load"
    bl_label = "Load CT"
    bl_description = "Read a CT stack: a folder of slices, a DICOM series, NIfTI, NRRD, TIFF or npy"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    filepath: StringProperty(name="File", subtype="FILE_PATH")
    directory: StringProperty(name="Folder", subtype="DIR_PATH")
    spacing: FloatVectorProperty(
        name="Spacing", description="Distance between samples along x, y and z [mm]. 0 = as the files say", min=0.0
    )
    flip: StringProperty(name="Flip", description="Axes to turn round, such as z or xy")
    series: StringProperty(name="Series", description="UID of the DICOM series. Empty = the one with the most slices")

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for a file or folder."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Read it, and keep it for `ctmc.reconstruct`."""
        path = Path(bpy.path.abspath(self.filepath or self.directory))
        spacing: Any = tuple(self.spacing) if any(self.spacing) else None
        try:
            volume = readers.read_volume(path, spacing=spacing, series=self.series or None, flip=self.flip)
        except CtmcError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        volumes.keep(path, volume, context.scene)
        for note in volume.notes:
            self.report({"INFO"}, note)
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_load,))
