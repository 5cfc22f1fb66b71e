# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the top of the page CT: Load, errors, the file's missing CT, and the CT itself."""

from __future__ import annotations

from typing import Any

import bpy

from ....core import Volume, sizes_text
from ....core.volume import ValueKind, VolumeStatistics
from ....reporting.formatting import count, directions
from ... import jobs
from ...operators.ct.view import AS_IT_IS, SIDES
from ...state import session
from ...state.ct import stored_paths, volumes
from ...translations import translate, translate_sentence
from ..layout import draw_job, draw_name, draw_pair, draw_text
from .scans import draw_cts, draw_without_damaged
from .series import draw_series

LOAD, LOAD_LABELS = "ctmc.load", "ctmc.load_labels"
MOST_LABEL_BUTTONS = 6  # Buttons for label files next to the CT.
SIDES_OF_AXES = {"x": "L - R", "y": "A - P", "z": "S - I"}
NAMES = 0.32  # Share of the width for names; three spacings with four digits each fit in the rest.


def draw_load(layout: Any, context: bpy.types.Context) -> None:
    """Draw the button Load, errors, and the facts of the CT."""
    scene, job = context.scene, jobs.running(LOAD, LOAD_LABELS)
    if job is not None:
        draw_job(layout, job)
    else:
        row = draw_pair(layout, context) if volumes.loaded(scene) is not None else layout
        row.operator("ctmc.load", icon="FILE_FOLDER")
        if volumes.loaded(scene) is not None:
            row.operator("ctmc.load_labels", icon="OUTLINER_OB_GROUP_INSTANCE")
    scene_session = session.of(scene)
    if scene_session.load_message:
        draw_text(layout.box(), context, scene_session.load_message, "ERROR")
    draw_without_damaged(layout, context)
    draw_cts(layout, context)
    if volumes.missing(scene):
        _draw_missing(layout, context)
    loaded = volumes.loaded(scene)
    if loaded is None:
        return
    _draw_volume(layout, context, loaded)


def _draw_missing(layout: Any, context: bpy.types.Context) -> None:
    """Draw the name of the file's CT that is not in memory, and a button to load it."""
    box = layout.box()
    path = context.scene.ctmc.volume_path
    is_missing = not stored_paths.exists(path)
    text = translate(
        "The CT {name} has been moved or deleted. Surfaces stay as they are; load it from its new place to go on"
    )
    if not is_missing:
        text = translate("The CT {name} is not in memory. Surfaces stay as they are; load it again to make others")
    draw_text(box, context, text.format(name=stored_paths.name_of(path)), "INFO")
    if not is_missing:
        box.operator("ctmc.load", text="Load Again", icon="FILE_REFRESH").again = True


def _draw_volume(layout: Any, context: bpy.types.Context, loaded: volumes.Loaded) -> None:
    """Draw size, spacing, orientation, values, series, and all assumptions."""
    volume, statistics, stored = loaded.full, loaded.statistics, context.scene.ctmc
    draw_name(layout, translate("Name"), NAMES).prop(stored, "volume_name", text="", placeholder=volume.name)
    column = layout.column(align=True)
    for text in facts_of(volume, statistics):
        draw_text(column, context, text)
    _draw_label_files(layout, context, loaded)
    if volume.kind == ValueKind.HU:
        layout.operator("ctmc.remove_table", icon="TRASH", depress=loaded.reading.remove_table)
    draw_series(layout, context)
    if loaded.times > 1:
        _draw_times(layout, stored, loaded)
    if not loaded.geometry:
        column = layout.column(align=True)
        sides = ", ".join(translate(side) for side in directions(volume.orientation))
        column.label(text=f"{translate('Orientation')}: {sides}", translate=False)
        for axis, name in enumerate(("x", "y", "z")):
            text = f"{translate('Spacing')} {name}"
            is_given = stored.spacing[axis] > 0
            field = draw_name(column, text, NAMES)
            field.prop(stored, "spacing", index=axis, text="" if is_given else translate("auto"), translate=False)
        row = draw_name(column, translate("Flip"), NAMES)
        for letter, sides in SIDES_OF_AXES.items():
            row.prop(stored, f"flip_{letter}", text=sides, translate=False, toggle=True)
        column.operator("ctmc.load", text="Override Spacing", icon="FILE_REFRESH").again = True
    if loaded.file is not None:
        text = translate("Shown at every {stride} voxels; surfaces are made from the file")
        draw_text(layout, context, text.format(stride=" x ".join(map(str, loaded.shown_stride))), "INFO")
    if statistics.non_finite:
        draw_text(
            layout,
            context,
            translate("{count} voxels are NaN or infinite").format(count=count(statistics.non_finite)),
            "INFO",
        )
    for note in volume.notes:
        draw_text(layout, context, translate_sentence(note), "INFO")


def facts_of(volume: Volume, statistics: VolumeStatistics) -> tuple[str, str]:
    """Return size and spacing in a line, range of the values and orientation in another."""
    columns, rows, slices = volume.size
    spacing = sizes_text(volume.spacing, digits=3)
    low, high = f"{statistics.low:g}", f"{statistics.high:g}"
    text = {ValueKind.HU: "Values {low} to {high} HU", ValueKind.LABEL: "Labels {low} to {high}"}
    values = translate(text.get(volume.kind, "Values {low} to {high} (no HU)")).format(low=low, high=high)
    return f"{columns} x {rows} x {slices}, {spacing}", f"{values}, {volume.orientation}"


def _draw_label_files(layout: Any, context: bpy.types.Context, loaded: volumes.Loaded) -> None:
    """Draw a button for label files next to the CT that are not in its list yet, with names if there are several."""
    added_paths = {bpy.path.abspath(source.path) for source in context.scene.ctmc.label_sources}
    paths = [path for path in loaded.labels_beside if str(path) not in added_paths]
    for path in paths[:MOST_LABEL_BUTTONS]:
        text = "Load Its Labels" if len(paths) == 1 else path.name
        row = layout.row()
        row.scale_y = 1.3 if len(paths) == 1 else 1.0
        button = row.operator(
            "ctmc.load_labels", text=text, icon="OUTLINER_OB_GROUP_INSTANCE", translate=len(paths) == 1
        )
        button.filepath = str(path)


def draw_views(layout: Any) -> None:
    """Draw a button that frames the CT, and one for every side of the patient."""
    row = layout.split(factor=0.4, align=True)
    row.operator("ctmc.view", icon="ZOOM_SELECTED").side = AS_IT_IS
    row = row.row(align=True)
    for side in (side for side in SIDES if side != AS_IT_IS):
        row.operator("ctmc.view", text=side, translate=False).side = side


def _draw_times(layout: Any, stored: Any, loaded: volumes.Loaded) -> None:
    """Draw the choice of one of several times, and a button that reads it."""
    column = layout.column(align=True)
    text = translate("Time, 1 to {count}").format(count=loaded.times)
    column.prop(stored, "time", text=text, translate=False)
    row = column.row(align=True)
    row.enabled = stored.time != loaded.reading.time
    row.operator("ctmc.load", text="Load Time Point", icon="FILE_REFRESH").again = True
