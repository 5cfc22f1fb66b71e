# SPDX-License-Identifier: GPL-3.0-or-later
"""The tab CTMC in the 3D viewport's sidebar: load, surface, voxels and alpha, simplify, reconstruct."""

from __future__ import annotations

from typing import Any

import bpy

from ...blender.surface import read_provenance
from ...core import GOALS, SettingsError, is_allowed
from ...core.mesh import SMALL
from ...reporting.formatting import count, duration, size_of_bytes, voxel_sides
from .. import jobs
from ..state import measurements, session, surfaces, volumes
from ..translations import translate
from .layout import SidePanel, draw_job, draw_pair, draw_setting, draw_text, is_narrow, prepare
from .surface import draw_surface
from .volume import LOAD, draw_load


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
    volume = volumes.current_full(context.scene)
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
    if volumes.is_coarse(scene):
        draw_text(column, context, translate("Not counted: the CT does not fit in memory"))
        return
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
    draw_small_components(layout, context)
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


def draw_small_components(layout: Any, context: bpy.types.Context) -> None:
    """How many components of the active surface are small, and a button that removes them; mostly nothing."""
    obj = surfaces.active_surface(context)
    provenance, measurement = read_provenance(obj), None if obj is None else measurements.of(obj)
    if provenance is None or measurement is None or provenance.settings.min_part_mm3 >= SMALL:
        return
    measures = measurement.measures
    if measures.has_many_small_components:
        text = translate("{small} of {all} components are smaller than {volume} mm3")
        small, total = count(measures.small_components), count(measures.components)
        draw_text(layout, context, text.format(small=small, all=total, volume=f"{SMALL:g}"), "INFO")
        layout.operator("ctmc.remove_small", icon="TRASH")


register, unregister = bpy.utils.register_classes_factory((CTMC_PT_main,))
