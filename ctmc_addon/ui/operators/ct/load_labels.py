# SPDX-License-Identifier: GPL-3.0-or-later
"""Add labels to the loaded CT: the operator `ctmc.load_labels`, its place in File > Import, and drag and drop."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
from bpy.props import CollectionProperty, StringProperty

from ....core import ReadError, Steps, Volume, equal_part
from ... import jobs
from ...properties import page
from ...properties.surface.structures import called, follow_ticks, tick
from ...state import session
from ...state.ct import volumes
from ...state.surface import structures
from ...translations import OURS, translate
from ..paths import RELATIVE
from .load import DROPPED, last_folder


class CTMC_OT_load_labels(jobs.LongOperator, bpy.types.Operator):
    """Add the labels of a file or folder to the structures of the loaded CT."""

    bl_idname = "ctmc.load_labels"
    bl_label = "Load Labels"
    bl_description = (
        "Add labels to the loaded CT: masks, a label volume, a DICOM segmentation (SEG) or a "
        "structure set (RTSTRUCT) at the same position, covering all or part of the CT"
    )
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it from the class)
    message_field = "load_message"

    filepath: StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE", *RELATIVE})
    directory: StringProperty(name="Folder", subtype="DIR_PATH", options={"SKIP_SAVE", *RELATIVE})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"SKIP_SAVE", "HIDDEN"})

    needs = (jobs.idle, volumes.has_volume)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self.windowed = True
        if self.filepath or self.directory:
            return self.begin(context)
        folder = last_folder(context.scene)
        if folder is not None:
            self.filepath = str(folder) + os.sep
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        scene = context.scene
        scene_session = session.of(scene)
        scene_session.message = scene_session.load_message = ""
        ct = volumes.require_loaded(scene)
        if ct.file is not None:
            raise ReadError(f"{ct.volume.name} does not fit in memory; load its labels as a CT of their own")
        names = [file.name for file in self.files if file.name]
        if len(names) > 1 and self.directory:
            paths = [Path(bpy.path.abspath(self.directory)) / name for name in names]
        else:
            paths = [Path(bpy.path.abspath(self.filepath or self.directory))]
        if not str(self.filepath or self.directory):
            raise ReadError("no file or folder was chosen; choose the file or folder that holds the labels")
        return steps(paths, ct.volume, scene.session_uid)


def steps(paths: Sequence[Path], ct: Volume, scene: int) -> Steps[jobs.Conclusion]:
    """Return the work: read labels of every path onto the grid of a CT, then add them to the list."""
    placed = []
    for number, path in enumerate(paths):
        placed.append((yield from equal_part(structures.read_steps(path, ct), number, len(paths))))
    return lambda: conclude(placed, scene)


def conclude(placed: Sequence[structures.PlacedLabels], uid: int) -> str:
    """Add labels to the list, and tick those whose names were ticked before; all if none was."""
    scene = session.scene_of(uid)
    if scene is None:
        raise ReadError("the scene was deleted while the labels were read; load them into another")
    stored = scene.ctmc
    earlier_keys = {source.key for source in stored.label_sources}
    count = 0
    for path, labels, key in placed:
        structures.put(scene, key, labels)
        if key not in earlier_keys:
            count += len(structures.add_labels(scene, labels, key, path))
    new = {called(item) for item in list(stored.labels)[len(stored.labels) - count :]}
    ticked = new & session.of(scene).ticked_names or new
    tick(stored, lambda item: item.chosen or called(item) in ticked)
    follow_ticks(stored)
    if not earlier_keys and bpy.context.scene == scene:
        page.show(bpy.context, "SURFACE")
    return translate("{count} structures added").format(count=count)


class CTMC_FH_labels(bpy.types.FileHandler):
    """Drop labels on the 3D viewport or the outliner, while a CT is loaded."""

    bl_idname = "CTMC_FH_labels"
    bl_label = "Labels of the CT"
    bl_import_operator = "ctmc.load_labels"
    bl_file_extensions = DROPPED

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        """Return whether labels can be dropped here."""
        is_place = context.area is not None and context.area.type in {"VIEW_3D", "OUTLINER"}
        return is_place and volumes.current(context.scene) is not None


def import_entry(menu: Any, _context: bpy.types.Context) -> None:
    """Draw the entry in File > Import."""
    menu.layout.operator("ctmc.load_labels", text="CT Labels", text_ctxt=OURS)


_register, _unregister = bpy.utils.register_classes_factory((CTMC_OT_load_labels, CTMC_FH_labels))


def register() -> None:
    """Register the operator, its file handler and its place in File > Import."""
    _register()
    bpy.types.TOPBAR_MT_file_import.append(import_entry)


def unregister() -> None:
    """Unregister them."""
    bpy.types.TOPBAR_MT_file_import.remove(import_entry)
    _unregister()
