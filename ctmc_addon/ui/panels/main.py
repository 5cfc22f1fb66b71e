"""The tab CTMC in the 3D viewport's sidebar: load, surface, voxels and alpha, simplify, reconstruct."""

from __future__ import annotations

from typing import Any

import bpy

from ...core import GOALS, SettingsError, is_allowed
from ...reporting.formatting import count, directions, duration, size_of_bytes, voxel_sides
from .. import jobs
from ..operators import threshold
from ..state import session, surfaces, volumes
from ..translations import translate
from .layout import SidePanel, draw_facts, draw_job, draw_pair, draw_setting, draw_text, is_narrow, prepare

LOAD = "ctmc.load"


class CTMC_PT_main(SidePanel, bpy.types.Panel):
    """Load, surface, voxels and alpha, simplify, reconstruct."""

    bl_idname = "CTMC_PT_main"
    bl_label = "CTMC"

    def draw_header_preset(self, _context: bpy.types.Context) -> None:
        """Presets beside the title, as everywhere in Blender."""
        self.layout.enabled = not jobs.locked()
        bpy.types.CTMC_PT_presets.draw_panel_header(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        """Show what is needed for every surface."""
        layout, settings = self.layout.column(), context.scene.ctmc
        prepare(self.layout, lock=False)
        prepare(layout)
        draw_load(layout, context)
        draw_surface(layout, context, settings)
        draw_voxels(layout, context, settings)
        draw_simplify(layout, context, settings)
        draw_reconstruct(self.layout, context, settings)


def draw_load(layout: Any, context: bpy.types.Context) -> None:
    """Load, what went wrong, and what the CT is."""
    scene, job = context.scene, jobs.running(LOAD)
    if job is not None:
        draw_job(layout, job)
    else:
        layout.operator("ctmc.load", icon="FILE_FOLDER")
    known = session.of(scene)
    for message in (known.load_message, known.message):
        if message:
            draw_text(layout.box(), context, message, "ERROR")
    if volumes.missing(scene):
        draw_missing(layout, context)
    loaded = volumes.loaded(scene)
    if loaded is None:
        return
    header, body = layout.panel("CTMC_volume", default_closed=False)
    header.label(text=loaded.volume.name, icon="VOLUME_DATA", translate=False)
    if body is not None:
        draw_volume(body, context, loaded)


def draw_missing(layout: Any, context: bpy.types.Context) -> None:
    """The file knows a CT that is not in memory."""
    box = layout.box()
    path = context.scene.ctmc.volume_path
    gone = not volumes.there(path)
    text = translate(
        "The CT {name} is no longer at its place. Surfaces stay as they are; load it from elsewhere to go on"
    )
    if not gone:
        text = translate("The CT {name} is not in memory. Surfaces stay as they are; load it again to make others")
    draw_text(box, context, text.format(name=volumes.name_of(path)), "INFO")
    if not gone:
        box.operator("ctmc.load", text="Load Again", icon="FILE_REFRESH").again = True


def draw_volume(layout: Any, context: bpy.types.Context, loaded: volumes.Loaded) -> None:
    """Size, spacing, orientation, values, series, and all that was assumed."""
    volume, survey, stored = loaded.volume, loaded.survey, context.scene.ctmc
    columns, rows, slices = volume.size
    x, y, z = volume.spacing
    right, down, up = (translate(side) for side in directions(volume.orientation))
    facts = [
        (translate("Size"), f"{columns} x {rows} x {slices}"),
        (translate("Spacing"), f"{x:.4g} x {y:.4g} x {z:.4g} mm"),
        (translate("Orientation"), f"{right}, {down}, {up} ({volume.orientation})"),
        (
            translate("Values"),
            translate("{low} to {high} {kind}").format(
                low=f"{survey.low:g}", high=f"{survey.high:g}", kind=translate(volume.kind)
            ),
        ),
    ]
    draw_facts(layout, context, facts)
    if len(loaded.series) > 1:
        draw_series(layout, loaded)
    if not loaded.geometry:
        column = layout.column(align=True)
        column.prop(stored, "spacing")
        column.label(text=translate("Flip"), translate=False)
        row = column.row(align=True)
        row.use_property_split = False
        for axis in "xyz":
            row.prop(stored, f"flip_{axis}", toggle=True)
        column.operator("ctmc.load", text="Reload Stack", icon="FILE_REFRESH").again = True
    if survey.non_finite:
        draw_text(
            layout,
            context,
            translate("{count} voxels are NaN or infinite").format(count=count(survey.non_finite)),
            "INFO",
        )
    for note in volume.notes:
        draw_text(layout, context, note, "INFO")
    if loaded.sibling is not None:
        button = layout.operator("ctmc.load", text="Load Its Labels", icon="OUTLINER_OB_GROUP_INSTANCE")
        button.filepath = str(loaded.sibling)


def draw_series(layout: Any, loaded: volumes.Loaded) -> None:
    """A line for every series, the one that was read pressed."""
    column = layout.column(align=True)
    column.label(text=translate("Series"), translate=False)
    for series in loaded.series:
        button = column.operator(
            "ctmc.load", text=series.text, translate=False, depress=series.number == loaded.series_number
        )
        button.again, button.series = True, series.uid or str(series.number)


def draw_surface(layout: Any, context: bpy.types.Context, settings: Any) -> None:
    """Threshold with histogram, Otsu and tissues, or labels."""
    column = layout.column()
    row = column.row(align=True)
    row.use_property_split = False
    row.prop(settings, "surface_from", expand=True)
    if settings.use_label:
        draw_labels(column, context, settings)
    else:
        icon = threshold.histogram_icon(context.scene)
        if icon:
            column.template_icon(icon, scale=6.0)
        row = column.split(factor=0.8, align=True)
        row.use_property_split = False
        value = row.row(align=True)
        value.prop(settings, "use_threshold", text="")
        number = value.row(align=True)
        number.active = settings.use_threshold
        number.prop(settings, "threshold", text=threshold_label(context.scene))
        row.operator("ctmc.auto_threshold")
        if not settings.use_threshold:
            found = threshold.used_threshold(context.scene)
            text = translate("Otsu's threshold is used") + ("" if found is None else f": {found:g}")
            column.label(text=text, icon="INFO", translate=False)
        column.operator_menu_enum("ctmc.tissue", "tissue", icon="PRESET")
    column.prop(settings, "soften_mm")


def threshold_label(scene: bpy.types.Scene) -> str:
    """The threshold with its unit."""
    volume = volumes.current(scene)
    if volume is None or volume.kind == "label":
        return translate("Threshold")
    return "HU" if volume.kind == "HU" else translate("Grey Value")


def draw_labels(layout: Any, context: bpy.types.Context, settings: Any) -> None:
    """The labels to choose from, several at once."""
    if not len(settings.labels):
        layout.prop(settings, "label")
        volume = volumes.current(context.scene)
        if volume is not None and volume.kind == "HU":
            draw_text(layout, context, translate("This CT holds HU; labels are in a volume of their own"), "INFO")
        return
    rows = min(6, max(3, len(settings.labels)))
    layout.template_list("CTMC_UL_labels", "", settings, "labels", settings, "label_index", rows=rows)


class CTMC_UL_labels(bpy.types.UIList):
    """A label in a line: whether it is wanted, its colour, value and name."""

    bl_idname = "CTMC_UL_labels"

    def draw_item(
        self,
        _context: Any,
        layout: Any,
        _data: Any,
        item: Any,
        _icon: int,
        _active_data: Any,
        _active_property: str,
        _index: int,
        _flag: int,
    ) -> None:
        """One line."""
        row = layout.row(align=True)
        row.use_property_split = False
        row.prop(item, "chosen", text="")
        colour = row.row()
        colour.ui_units_x = 1.2
        colour.prop(item, "color", text="")
        row.label(text=f"{item.value}  {item.name}".rstrip(), translate=False)


def draw_voxels(layout: Any, context: bpy.types.Context, settings: Any) -> None:
    """Voxel sides in pixels and mm, what they cost, and alpha."""
    column = layout.column(align=True)
    row = draw_pair(column, context, 0.4)
    row.use_property_split = False
    left = row.row()
    left.alignment = "LEFT" if is_narrow(context) else "RIGHT"
    left.label(text=translate("Stride"), translate=False)
    sides = row.row(align=True)
    for axis in range(3):
        sides.prop(settings, "stride", index=axis, text="")
    volume = volumes.current(context.scene)
    if volume is not None:
        draw_text(column, context, voxel_sides(settings.stride, volume.spacing))
    draw_cost(layout, context)
    try:
        matters = settings.to_settings().alpha_matters
    except SettingsError as error:
        draw_text(layout, context, str(error), "ERROR")
        matters = True
    row = layout.row()
    row.enabled = matters
    row.prop(settings, "alpha", slider=True)
    if not matters:
        draw_text(layout, context, translate("Alpha has no effect on a label that is not smoothed"), "INFO")


def draw_cost(layout: Any, context: bpy.types.Context) -> None:
    """What the present settings would cost; always two lines, so that nothing jumps while it is counted."""
    scene = context.scene
    if volumes.current(scene) is None:
        return
    cost = session.of(scene).cost
    column = layout.column(align=True)
    if cost is None:
        waiting = column.column(align=True)
        waiting.scale_y = 0.8  # as that of text
        waiting.label(text=translate("Counting..."), translate=False)
        waiting.label(text="")
        return
    if not cost.error:
        text = translate("{voxels} voxels, {faces} triangles")
        draw_text(column, context, text.format(voxels=count(cost.voxels), faces=count(cost.faces)))
        text = translate("{memory}, about {seconds}")
        draw_text(column, context, text.format(memory=size_of_bytes(cost.memory), seconds=duration(cost.seconds)))
    if cost.refusal:
        draw_text(column, context, cost.refusal, "ERROR")


def draw_simplify(layout: Any, context: bpy.types.Context, settings: Any) -> None:
    """None, Decimate or built-in, and its goal."""
    column = layout.column()
    row = column.row(align=True)
    row.use_property_split = False
    if is_narrow(context):
        row.prop(settings, "simplifier", text="")
    else:
        row.prop(settings, "simplifier", expand=True)
    goals = column.column(align=True)
    goals.active = settings.simplifier != "none"
    for name in GOALS:
        line = goals.column()
        line.enabled = is_allowed(settings, name)
        draw_setting(line, settings, name)


def draw_reconstruct(layout: Any, context: bpy.types.Context, settings: Any) -> None:
    """The button, or how far it is; export and command."""
    job, scene = jobs.running(), context.scene
    row = layout.row(align=True)
    row.scale_y = 1.5
    if job is not None and job.operator != LOAD:
        draw_job(row, job)
    else:
        updates = surfaces.is_of_ct(surfaces.active_surface(context), scene)
        text = "Update Surface" if updates else "Reconstruct Surface"
        row.operator("ctmc.reconstruct", text=text, icon="FILE_REFRESH" if updates else "MESH_ICOSPHERE")
        if updates:
            row.operator("ctmc.reconstruct", text="", icon="ADD").new = True
    layout = layout.column()
    layout.enabled = not jobs.locked()
    row = draw_pair(layout, context)
    row.use_property_split = False
    row.operator("ctmc.simplify", icon="MOD_DECIM")
    row.prop(settings, "preview", toggle=True, icon="HIDE_OFF" if settings.preview else "HIDE_ON")
    if settings.preview and sum(item.chosen for item in settings.labels) > 1:
        text = translate("The preview shows the first label that is ticked")
        draw_text(layout, context, text, "INFO")
    row = draw_pair(layout, context, 0.4)
    row.operator("ctmc.export", text="Export", icon="EXPORT")
    row.operator("ctmc.copy_command", icon="COPYDOWN")


register, unregister = bpy.utils.register_classes_factory((CTMC_UL_labels, CTMC_PT_main))
