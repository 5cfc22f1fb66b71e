# SPDX-License-Identifier: GPL-3.0-or-later
"""Load a CT: the operator `ctmc.load`, its place in File > Import, and drag and drop."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, StringProperty

from .... import readers
from ....blender.colors import color_of
from ....blender.scene.ct_box import show_box
from ....blender.scene.new_file import remove_cube, untouched_cube
from ....blender.units import has_blenders_units, set_units
from ....core import DamagedSliceError, ReadError, Stages, Steps, fits_in_memory, shown_stride
from ....core.volume import ValueKind, volume_box, volume_statistics_steps
from ....readers import FOLDER_SUFFIXES, KNOWN_SUFFIXES, ReadingOptions
from ....reporting.formatting import in_lines
from ... import jobs
from ...properties import page
from ...properties.ct.reading import dialog_properties, options_of_dialog, options_of_scene, show_options
from ...properties.preferences import machine
from ...properties.surface.structures import called, follow_ticks, tick
from ...state import change_events, session
from ...state.ct import scans, volumes
from ...state.ct.stored_paths import stored_path
from ...state.draw import drawings
from ...state.results import surfaces
from ...state.surface import structures
from ...translations import OURS, translate, translate_sentence
from ..paths import RELATIVE
from .series import items
from .view import frame_everywhere

LABELS = "Reading labels"
STAGES = {"Reading headers": 10, "Reading values": 80, "Computing histogram": 10}
# Blender looks at the last suffix only, and folders cannot be dropped.
DROPPED = ";".join(sorted({"." + end.rpartition(".")[2] for end in KNOWN_SUFFIXES if end not in FOLDER_SUFFIXES}))


class CTMC_OT_load(jobs.LongOperator, bpy.types.Operator):
    """Read a CT or labels, in any of the formats that `readers` knows."""

    bl_idname = "ctmc.load"
    bl_label = "Load CT"
    bl_description = (
        "Read a CT or labels: DICOM with its segmentations (SEG) and structure sets (RTSTRUCT), NIfTI, NRRD "
        "and other volumes, a folder of masks, or slices as pictures"
    )
    bl_options = {"UNDO"}  # noqa: RUF012  (Blender reads it from the class)
    message_field = "load_message"

    filepath: StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE", *RELATIVE})
    directory: StringProperty(name="Folder", subtype="DIR_PATH", options={"SKIP_SAVE", *RELATIVE})
    files: CollectionProperty(type=bpy.types.OperatorFileListElement, options={"SKIP_SAVE", "HIDDEN"})
    again: BoolProperty(
        name="Again",
        description="Read the CT of this scene again, with the spacing and orientation of the panel",
        options={"SKIP_SAVE", "HIDDEN"},
    )

    listed: EnumProperty(
        name="Series", description="Read another series of this CT", items=items, options={"SKIP_SAVE", "HIDDEN"}
    )

    needs = (jobs.idle,)

    @property
    def listed_series(self) -> str:
        """Return the series that was chosen in the dropdown; empty where none was."""
        return str(self.listed) if self.properties.is_property_set("listed") else ""

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self.windowed = True
        if self.filepath or self.directory or self.again or self.listed_series:
            return self.begin(context)
        folder = last_folder(context.scene)
        if folder is not None:
            self.filepath = str(folder) + os.sep
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        column = layout.column(align=True)
        for axis, name in enumerate("xyz"):
            column.prop(self, "spacing", index=axis, text=f"{translate('Spacing')} {name}", translate=False)
        row = layout.row(heading=translate("Flip"), heading_ctxt=OURS, align=True)
        for axis, name in enumerate("XYZ"):
            row.prop(self, "flip_axes", index=axis, text=name, toggle=True)
        layout.prop(self, "strict")
        layout.prop(self, "skip_damaged")
        layout.prop(self, "remove_table")
        lines = layout.column(align=True)
        lines.scale_y = 0.8
        for line in in_lines(translate("The series with most slices is read; the panel lists all series"), 34):
            lines.label(text=line, translate=False)

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        scene = context.scene
        scene_session, stored, expected = session.of(scene), scene.ctmc, ""
        scene_session.message = scene_session.load_message = ""
        scene_session.refused = None
        # Several files that were dropped or selected together are slices of one stack.
        path = self.directory if len(self.files) > 1 else self.filepath or self.directory
        reading = asked = options_of_dialog(self)
        if self.listed_series:
            asked = replace(asked, series=self.listed_series)
        if (self.again or self.listed_series) and not path:
            path = stored.volume_path
            reading = options_of_scene(stored)
            if asked.series:
                reading = replace(reading, series=asked.series, time=None)
            if asked.time:
                reading = replace(reading, time=asked.time)
            if reading == _scene_reading(scene):
                expected = stored.volume_fingerprint
        if not path:
            raise ReadError("no file or folder was chosen; choose the file or folder that holds the CT")
        file_count = len(self.files) if path == self.directory else 0
        sources = [(source.key, Path(bpy.path.abspath(source.path))) for source in structures.missing(scene)]
        sources = [(key, source) for key, source in sources if expected and source.name]
        return self.steps(Path(bpy.path.abspath(path)), reading, scene.session_uid, expected, file_count, sources)

    def steps(
        self,
        path: Path,
        reading: ReadingOptions,
        scene: int,
        expected: str,
        file_count: int,
        sources: Sequence[tuple[str, Path]],
    ) -> Steps[jobs.Conclusion]:
        """Return the work: series, values, statistics. `expected` is the fingerprint of the CT to find there, if any.

        `file_count` is the number of selected files; the whole folder is read, with the label `sources`.
        """
        stages = Stages(STAGES | ({LABELS: 40} if sources else {}))
        headers, values, counting = STAGES
        source = yield from stages.run(headers, readers.open_volume_steps(path))
        selected = source.selected_series(reading.series)
        budget = machine().budget
        file, stride = None, (1, 1, 1)
        try:
            if selected is None or fits_in_memory(math.prod(selected.shape) * selected.voxel_bytes, budget):
                work = source.read_steps(reading, budget=budget)
                volume = yield from stages.run(values, work)
            else:
                file = yield from stages.run(values, source.slabs_steps(reading, budget=budget))
                stride = shown_stride(file, budget)
                volume = yield from stages.run(values, file.in_memory_steps(stride))
        except DamagedSliceError:
            refused_in = session.scene_of(scene)
            if refused_in is not None:
                session.of(refused_in).refused = (str(path), reading)
            raise
        if reading.series and selected is not None:  # Store its number, because a UID must not be stored.
            reading = replace(reading, series=str(selected.number))
        if selected is not None:
            time, _ = source.selected_time(reading.series, reading.time)
            reading = replace(reading, time=time if selected.times > 1 else None)
        slices = volume.size[2] if file is None else file.size[2]
        if 1 < file_count < slices:
            note = f"the whole folder was read, {slices} slices, not only the {file_count} chosen files"
            volume = replace(volume, notes=(*volume.notes, note))
        statistics = yield from stages.run(counting, volume_statistics_steps(volume))
        loaded = volumes.Loaded(
            path,
            volume,
            statistics,
            source.series,
            reading,
            source.has_geometry,
            1 if selected is None else selected.number,
            () if volume.kind == ValueKind.LABEL else readers.labels_beside(readers.volume_place(path)),
            file,
            stride,
        )
        labels: list[tuple[str, structures.PlacedLabels | str]] = []
        if sources and statistics.fingerprint == expected:
            labels = yield from stages.run(LABELS, structures.read_again_steps(sources, volume))
        return lambda: conclude(loaded, scene, expected, labels)


def last_folder(scene: bpy.types.Scene) -> Path | None:
    """Return the folder of the last CT, of this file or of the one open before; None if it is not known."""
    stored = scene.ctmc.volume_path
    path = Path(bpy.path.abspath(stored)) if stored else volumes.last_path()
    return path.absolute().parent if path is not None and path.absolute().parent.is_dir() else None


def _leaves_a_choice(loaded: volumes.Loaded) -> bool:
    """Return whether the page CT has more to say than what was loaded: another series, labels, a spacing, a note."""
    is_one = len(loaded.series) < 2 and loaded.times < 2
    return not is_one or bool(loaded.labels_beside or loaded.volume.notes) or not loaded.geometry


def _scene_reading(scene: bpy.types.Scene) -> ReadingOptions:
    """Return how the CT of the scene was read."""
    loaded = volumes.loaded(scene)
    return options_of_scene(scene.ctmc) if loaded is None else loaded.reading


def conclude(
    loaded: volumes.Loaded, uid: int, expected: str, labels: Sequence[tuple[str, structures.PlacedLabels | str]] = ()
) -> str:
    """Make a volume the scene's, with its reloaded labels."""
    scene = session.scene_of(uid)
    if scene is None:
        raise ReadError("the scene was deleted while the CT was read; load it into another")
    stored = scene.ctmc
    is_another_ct = loaded.statistics.fingerprint != stored.volume_fingerprint
    is_first = not stored.volume_fingerprint
    earlier = volumes.loaded(scene)
    is_another_time = loaded.is_another_time_of(earlier)
    before = stored.volume_fingerprint if loaded.has_samples_of(earlier) else ""
    holds_region = is_another_time and stored.region_for == stored.volume_fingerprint
    is_restored = is_another_ct and not is_another_time and scans.bring_back(scene, loaded.statistics.fingerprint)
    if is_another_ct and not is_restored:
        scans.park(scene)
        scans.forget(scene, loaded.statistics.fingerprint)
    volumes.keep(loaded, scene)
    show_options(stored, loaded.reading)
    if holds_region:
        stored.region_for = stored.volume_fingerprint
    if is_another_ct and not is_restored:
        stored.volume_name = stored.volume_name if is_another_time else ""
        goes_by_number = is_another_time or not len(stored.labels)
        if not goes_by_number:
            session.of(scene).ticked_names = frozenset(called(item) for item in stored.labels if item.chosen)
        names, colors = loaded.volume.label_names, loaded.volume.label_colors
        stored.show_labels(
            [
                (value, names.get(value, ""), color_of(value, colors.get(value), names.get(value, "")))
                for value, _ in loaded.statistics.labels
            ]
        )
        _follow_kind(stored, loaded, goes_by_number)
        if not goes_by_number:
            _tick_by_name(stored, session.of(scene).ticked_names)
    taken = drawings.take_along(scene, before) if before and is_another_ct else 0
    scene_session = session.of(scene)
    scene_session.message = scene_session.load_message = ""
    if expected not in ("", loaded.statistics.fingerprint):
        text = "The CT has changed since this file was saved: {name}. Existing surfaces show the earlier CT"
        scene_session.load_message = translate(text).format(name=loaded.path.name)
    for key, read in labels:
        if isinstance(read, str):
            scene_session.load_message = translate_sentence(read)
            continue
        structures.put(scene, key, read.labels)
        if read.key != key:
            text = "The labels have changed since this file was saved: {name}"
            scene_session.load_message = translate(text).format(name=read.path.name)
    change_events.notify(stored, "volume")
    cube = untouched_cube(scene) if is_first else None  # Look before the CT's box is added.
    if cube is not None:
        remove_cube(cube)
    _show_in_scene(scene, loaded, is_another_ct and not is_another_time)
    if bpy.context.scene == scene:
        scans.note(bpy.context)
        if is_first and not _leaves_a_choice(loaded):
            page.show(bpy.context, "SURFACE")
    columns, rows, slices = loaded.full.size
    text = translate("Loaded {name}: {size}").format(name=loaded.volume.name, size=f"{columns} x {rows} x {slices}")
    if taken:
        text += ". " + translate("Drawn structures kept: {count}").format(count=taken)
    if is_first and machine().show_mm and not bpy.data.filepath and has_blenders_units(scene):
        set_units(scene, machine().scale)
        text += ". " + translate("Units set to millimeters")
    if cube is not None:
        text += ". " + translate("Default cube removed")
    return text


def _follow_kind(stored: Any, loaded: volumes.Loaded, goes_by_number: bool) -> None:
    """Choose labels for a label volume, whose numbers no threshold separates, and a threshold for HU.

    The previously chosen label keeps its number if it `goes_by_number`: a preset's, or that of another time.
    """
    labels = [value for value, _ in loaded.statistics.labels]
    if loaded.volume.kind == ValueKind.LABEL and labels:
        if not (goes_by_number and stored.use_label and stored.label in labels):
            stored.label = labels[0]
    elif loaded.volume.kind == ValueKind.HU and stored.use_label:
        stored.use_label = False


def _tick_by_name(stored: Any, names: frozenset[str]) -> None:
    """Tick the labels of a label volume whose names were ticked before; without a match the list stays as it is."""
    if stored.use_label and any(called(item) in names for item in stored.labels):
        tick(stored, lambda item: called(item) in names)
        follow_ticks(stored)


def _show_in_scene(scene: bpy.types.Scene, loaded: volumes.Loaded, is_another_ct: bool) -> None:
    """Give a CT its box in the scene; one that has just come is selected and framed."""
    folder = loaded.path if loaded.path.is_dir() else loaded.path.absolute().parent
    corners, path = volume_box(loaded.volume) * machine().scale, scene.ctmc.volume_path
    names = (stored_path(folder), readers.volume_stem(folder) or loaded.volume.name)
    box, is_new = show_box(scene, corners, loaded.volume.name, loaded.statistics.fingerprint, path, names)
    if is_new and bpy.context.scene == scene and not surfaces.selected_surfaces(bpy.context):
        for obj in bpy.context.selected_objects:
            obj.select_set(False)
        box.select_set(True)  # Select it, but keep it inactive for the panel.
    if (is_new or is_another_ct) and bpy.context.scene == scene:
        frame_everywhere(loaded.volume)


CTMC_OT_load.__annotations__.update(dialog_properties())


class CTMC_FH_stack(bpy.types.FileHandler):
    """Drop a CT file on the 3D viewport or the outliner."""

    bl_idname = "CTMC_FH_stack"
    bl_label = "CT Stack"
    bl_import_operator = "ctmc.load"
    bl_file_extensions = DROPPED

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        """Return whether files can be dropped here: on a 3D viewport or the outliner."""
        return context.area is not None and context.area.type in {"VIEW_3D", "OUTLINER"}


def import_entry(menu: Any, _context: bpy.types.Context) -> None:
    """Draw the entry in File > Import."""
    menu.layout.operator("ctmc.load", text="CT Stack")


_register, _unregister = bpy.utils.register_classes_factory((CTMC_OT_load, CTMC_FH_stack))


def register() -> None:
    """Register the operator, its file handler and its place in File > Import."""
    _register()
    bpy.types.TOPBAR_MT_file_import.append(import_entry)


def unregister() -> None:
    """Unregister them."""
    bpy.types.TOPBAR_MT_file_import.remove(import_entry)
    _unregister()
