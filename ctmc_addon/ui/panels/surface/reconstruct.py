# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the lower half of the page Surface: voxels and alpha, simplify, costs, the button and its messages.

Lines that come and go are at the end, below the buttons, and never between two widgets.
"""

from __future__ import annotations

from typing import Any

import bpy

from ....core import SettingsError
from ....reporting.formatting import count, duration, size_of_bytes
from ... import jobs
from ...operators.surface.solid import makes_solid
from ...state import session
from ...state.ct import volumes
from ...state.results import surfaces
from ...state.surface import cost_estimates, solids
from ...translations import translate, translate_sentence
from ..layout import draw_job, draw_name, draw_pair, draw_status, draw_table, draw_text
from .removed import draw_removed
from .solid import draw_places

COST_NAMES = 0.46  # Share of the width for names.
BUTTONS = (("Reconstruct Surface", "Update Surface"), ("Reconstruct Solid", "Update Solid"))
"""Words of the button: surfaces or solids; new or updated."""


def draw_voxels(layout: Any, context: bpy.types.Context, settings: Any) -> None:
    """Draw voxel sides in pixels and mm, alpha, and the cost estimate."""
    volume = volumes.current_full(context.scene)
    column = layout.column(align=True)
    for text, shows_mm in ((translate("Stride [px]"), False), (translate("Voxel [mm]"), True)):
        sides = draw_name(column, text)
        for axis, name in enumerate("xyz"):
            if not shows_mm:
                sides.prop(settings, "stride", index=axis, text=name)
            else:
                side = "-" if volume is None else f"{settings.stride[axis] * volume.spacing[axis]:.3g}"
                sides.label(text=side, translate=False)
    row = layout.row()
    row.enabled = alpha_matters(settings)
    row.prop(settings, "alpha", slider=True)
    draw_text(layout, context, translate("0: even triangles, 1: most accurate"))


def alpha_matters(settings: Any) -> bool:
    """Return whether alpha has an effect; settings that contradict each other are reported elsewhere."""
    try:
        matters: bool = settings.to_settings().alpha_matters
    except SettingsError:
        return True
    return matters


def draw_cost(layout: Any, context: bpy.types.Context) -> None:
    """Draw the cost estimate of the settings, always in two lines, so that nothing jumps while it is counted."""
    cost = cost_estimates.of_scene(context.scene)
    waits = cost is None and volumes.current(context.scene) is not None and not volumes.is_coarse(context.scene)
    triangles = seconds = "..." if waits else "-"
    if cost is not None and not cost.error:
        triangles = count(cost.faces)
        seconds = f"{duration(cost.seconds)}, {size_of_bytes(cost.memory)}"
    names = (translate("Triangles"), translate("Estimated Time"))
    draw_table(layout, list(zip(names, (triangles, seconds), strict=True)), COST_NAMES)


def draw_simplify(layout: Any, context: bpy.types.Context, settings: Any) -> None:
    """Draw the goal, and with one its number, what it keeps, and the method where there is a choice."""
    goal = settings.goal
    layout.prop(settings, "goal")
    if goal == "none":
        return
    layout.prop(settings, {"target_faces": goal, "max_error_mm": goal}.get(goal, "ratio"))
    draw_table(layout, [("", _kept_text(context, settings))])
    if goal in ("reduction", "target_faces"):
        layout.prop(settings, "method")


def _kept_text(context: bpy.types.Context, settings: Any) -> str:
    """Return the effect of the goal, in words."""
    cost = session.of(context.scene).cost
    faces = 0 if cost is None or cost.error else cost.faces
    kept = None
    if settings.goal == "reduction":
        kept = 1 - settings.reduction
    elif settings.goal == "target_faces" and faces:
        kept = min(1.0, settings.target_faces / faces)
    return "" if kept is None else translate("Keep {percent} % of triangles").format(percent=f"{100 * kept:.4g}")


def draw_reconstruct(layout: Any, context: bpy.types.Context, settings: Any) -> None:
    """Draw the button or its progress; simplify, preview, export, command; then messages."""
    job, scene = jobs.running(), context.scene
    draw_removed(layout, context, settings)
    row = layout.row(align=True)
    row.scale_y = 1.5
    if job is not None:
        draw_job(row, job)
    else:
        makes_parts = makes_solid(scene)
        updates = surfaces.is_updated(context, makes_parts=makes_parts)
        text = BUTTONS[makes_parts][updates]
        row.operator("ctmc.reconstruct", text=text, icon="FILE_REFRESH" if updates else "MESH_ICOSPHERE")
        new = row.row(align=True)
        new.enabled = updates
        new.operator("ctmc.reconstruct", text="", icon="ADD").new = True
    layout = layout.column()
    layout.enabled = not jobs.locked()
    row = draw_pair(layout, context)
    row.use_property_split = False
    row.operator("ctmc.simplify", text="Simplify", icon="MOD_DECIM")
    row.prop(settings, "preview", toggle=True, icon="HIDE_OFF" if settings.preview else "HIDE_ON")
    _draw_notes(layout, context, settings)


def _draw_notes(layout: Any, context: bpy.types.Context, settings: Any) -> None:
    """Draw errors, refusals and settings without effect, if any."""
    job = jobs.running()
    draw_status(layout, context, *([] if job is None else [job.operator]))  # Its bar stands above.
    try:
        solids.runs_of(context.scene, solids.solid_of(context.scene))
    except SettingsError as error:
        draw_text(layout, context, translate_sentence(str(error)), "ERROR")
    else:
        cost = cost_estimates.of_scene(context.scene)
        if cost is not None and cost.refusal:
            draw_text(layout, context, translate_sentence(cost.refusal), "ERROR")
    draw_places(layout, context)
    if volumes.is_coarse(context.scene):
        draw_text(layout, context, translate("Not counted: the CT does not fit in memory"), "INFO")
    if not alpha_matters(settings):
        draw_text(layout, context, translate("Alpha has no effect on a label that is not smoothed"), "INFO")
    if settings.preview and settings.use_label and sum(item.chosen for item in settings.labels) > 1:
        text = translate("Preview: first ticked structure")
        draw_text(layout, context, text, "INFO")
