# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the top of the main panel: Load, errors, the file's missing CT, and the CT itself."""

from __future__ import annotations

from typing import Any

import bpy

from ....core.volume import ValueKind
from ....readers import Series
from ....reporting.formatting import count, directions
from ... import jobs
from ...operators.ct.view import AS_IT_IS, SIDES
from ...state import session, volumes
from ...translations import translate, translate_sentence
from ..layout import draw_job, draw_name, draw_pair, draw_table, draw_text
from .values import values_fact

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
    if volumes.missing(scene):
        _draw_missing(layout, context)
    loaded = volumes.loaded(scene)
    if loaded is None:
        return
    layout.label(text=loaded.volume.name, icon="VOLUME_DATA", translate=False)
    _draw_volume(layout, context, loaded)


def _draw_missing(layout: Any, context: bpy.types.Context) -> None:
    """Draw the name of the file's CT that is not in memory, and a button to load it."""
    box = layout.box()
    path = context.scene.ctmc.volume_path
    is_missing = not volumes.exists(path)
    text = translate(
        "The CT {name} has been moved or deleted. Surfaces stay as they are; load it from its new place to go on"
    )
    if not is_missing:
        text = translate("The CT {name} is not in memory. Surfaces stay as they are; load it again to make others")
    draw_text(box, context, text.format(name=volumes.name_of(path)), "INFO")
    if not is_missing:
        box.operator("ctmc.load", text="Load Again", icon="FILE_REFRESH").again = True


def _draw_volume(layout: Any, context: bpy.types.Context, loaded: volumes.Loaded) -> None:
    """Draw size, spacing, orientation, values, series, and all assumptions."""
    volume, statistics, stored = loaded.full, loaded.statistics, context.scene.ctmc
    columns, rows, slices = volume.size
    spacing = " x ".join(f"{side:.3g}" if side < 1 else f"{side:.4g}" for side in volume.spacing)
    right, down, up = (translate(side) for side in directions(volume.orientation))
    draw_name(layout, translate("Name"), NAMES).prop(stored, "volume_name", text="", placeholder=volume.name)
    facts = [
        (translate("Size"), f"{columns} x {rows} x {slices}"),
        (translate("Spacing"), f"{spacing} mm"),
        (translate("Orientation"), f"{right}, {down}, {up} ({volume.orientation})"),
        values_fact(statistics.low, statistics.high, volume.kind),
    ]
    draw_table(layout, facts, NAMES)
    _draw_views(layout)
    if volume.kind == ValueKind.HU:
        layout.operator("ctmc.remove_table", icon="TRASH", depress=loaded.reading.remove_table)
    if len(loaded.series) > 1:
        _draw_series(layout, context, loaded)
    if loaded.times > 1:
        _draw_times(layout, stored, loaded)
    if not loaded.geometry:
        column = layout.column(align=True)
        for axis, name in enumerate(("x", "y", "z")):
            text = f"{translate('Spacing')} {name}"
            is_given = stored.spacing[axis] > 0
            field = draw_name(column, text, NAMES)
            field.prop(stored, "spacing", index=axis, text="" if is_given else translate("auto"), translate=False)
        row = draw_name(column, translate("Flip"), NAMES)
        for letter, sides in SIDES_OF_AXES.items():
            row.prop(stored, f"flip_{letter}", text=sides, translate=False, toggle=True)
        column.operator("ctmc.load", text="Reload Stack", icon="FILE_REFRESH").again = True
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
    _draw_label_files(layout, context, loaded)


def _draw_label_files(layout: Any, context: bpy.types.Context, loaded: volumes.Loaded) -> None:
    """Draw a button for label files next to the CT that are not in its list yet, with names if there are several."""
    added_paths = {bpy.path.abspath(source.path) for source in context.scene.ctmc.label_sources}
    paths = [path for path in loaded.labels_beside if str(path) not in added_paths]
    for path in paths[:MOST_LABEL_BUTTONS]:
        text = "Load Its Labels" if len(paths) == 1 else path.name
        button = layout.operator(
            "ctmc.load_labels", text=text, icon="OUTLINER_OB_GROUP_INSTANCE", translate=len(paths) == 1
        )
        button.filepath = str(path)


def _draw_views(layout: Any) -> None:
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
    row.operator("ctmc.load", text="Load This Time", icon="FILE_REFRESH").again = True


def _draw_series(layout: Any, context: bpy.types.Context, loaded: volumes.Loaded) -> None:
    """Draw a button for every series, pressed for the one that was read, and below it what distinguishes it."""
    column = layout.column()
    column.label(text=translate("Series"), translate=False)
    for series in loaded.series:
        text = f"{series.number}: {series.description or series.modality}"
        line = column.column(align=True)
        button = line.operator("ctmc.load", text=text, translate=False, depress=series.number == loaded.series_number)
        button.again, button.series = True, str(series.number)
        draw_text(line, context, _series_text(series))


def _series_text(series: Series) -> str:
    """Return number and kernel as set by the scanner, spacing and number of slices, size, folder."""
    facts = {
        "no. {number}": series.dicom_number,
        "kernel {kernel}": series.kernel,
        "{gap} mm apart": "" if series.spacing_mm is None else f"{series.spacing_mm:.4g}",
        "{count} slices": str(series.slices),
        "{columns} x {rows}": "size",
        "in {folder}": series.folder,
    }
    columns, rows = series.size
    words = [
        translate(text).format(
            number=value, kernel=value, gap=value, count=value, folder=value, columns=columns, rows=rows
        )
        for text, value in facts.items()
        if value
    ]
    return ", ".join(words)
