# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw elements of several panels: a setting with its switch, sentences in lines, a job's progress."""

from __future__ import annotations

from typing import Any

import bpy

from ...blender.shape_change import shape_change
from ...core import SETTINGS
from ...core.volume import ValueKind
from ...reporting.formatting import in_lines, letters
from .. import jobs
from ..properties.limits import optional, switch
from ..state import session
from ..state.ct import volumes
from ..state.results import surfaces
from ..state.results.surfaces import mirrored_text, scaled_text
from ..translations import OURS, translate

FONT, POINTS = 0, 11.0  # Blender's font and its size in panels at the usual scale.
LETTER = 6.3  # Width of a letter in pixels, if Blender measures no text.
MARGIN = 84.0  # Pixels of a panel next to a text in a box with an icon.
NARROWEST = 100.0  # Least width of a text, pixels.
NARROW = 250.0  # Width in pixels below which buttons and facts are stacked.


class SidePanel:
    """Base of all panels of the tab, before `bpy.types.Panel`."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = jobs.TAB
    bl_translation_context = OURS


class PagePanel(SidePanel):
    """A page of the tab, shown below the row of pages while it is chosen."""

    bl_parent_id = "CTMC_PT_main"
    bl_options = {"HIDE_HEADER"}  # noqa: RUF012  (Blender reads it from the class)
    page = ""
    """Its key in `PAGES`."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        shown: bool = context.window_manager.ctmc_page == cls.page
        return shown


OPEN: set[str] = set()
"""Names of folds that begin open; scripts may add some before the page is drawn for the first time."""


def begin(layout: Any) -> Any:
    """Prepare a page, and return its first block."""
    prepare(layout, lock=False)
    return block(layout)


def block(layout: Any) -> Any:
    """Return room for some lines of a page, gray while a job locks the file."""
    column = layout.column()
    prepare(column)
    return column


def fold(layout: Any, name: str, text: str, owner: Any = None, used: str = "") -> Any:
    """Draw a closed heading that opens in place; return the room below it, None while it is closed.

    A job does not gray that room as a whole, because Cancel may stand in it: take a `block` of it.

    Parameters
    ----------
    layout : UILayout
        The panel's own: Blender draws folds nowhere else.
    name : str
        Under which Blender keeps whether it is open.
    text : str
    owner, used : object and str
        A switch to draw in the heading, if any.
    """
    header, body = layout.panel(f"ctmc_{name}", default_closed=name not in OPEN)
    header.use_property_split = False
    if owner is not None:
        switch_row = header.row()
        switch_row.enabled = not jobs.locked()
        switch_row.prop(owner, used, text="")
    header.label(text=translate(text), translate=False)
    if body is not None:
        prepare(body, lock=False)
    return body


def lacks_ct(layout: Any, context: bpy.types.Context) -> bool:
    """Return whether a scene knows no CT and no surface is active; say so in one line."""
    if context.scene.ctmc.volume_path or surfaces.is_surface(context.view_layer.objects.active):
        return False
    layout.label(text=translate("Load a CT first"), icon="INFO", translate=False)
    return True


def prepare(layout: Any, lock: bool = True) -> None:
    """Set labels on the left, values on the right, no dots for keyframes; gray while a job locks the file if `lock`."""
    if lock:
        layout.enabled = not jobs.locked()
    layout.use_property_split = True
    layout.use_property_decorate = False


def draw_setting(layout: Any, settings: Any, name: str) -> None:
    """Draw one setting, with its switch if it is optional, and with a unit where Blender shows none of its own."""
    about = SETTINGS[name]
    label = translate(about.label)
    if optional(name):
        value = _draw_switch(layout, settings, switch(name), label + (" [HU]" if holds_hu(settings.id_data) else ""))
        value.active = getattr(settings, switch(name))
        value.prop(settings, name, text="")
    elif name == "keep_parts":
        value = _draw_switch(layout, settings, "keep_largest", label)
        if settings.keep_largest:
            value.prop(settings, name, text="")
        else:
            value.label(text=translate("All"), translate=False)
    elif about.unit == "mm3":
        draw_name(layout, label, 0.45).prop(settings, name, text=about.unit, translate=False)
    else:
        layout.prop(settings, name)


def _draw_switch(layout: Any, settings: Any, name: str, text: str) -> Any:
    """Draw a tick with its words on the left; return the room for its value."""
    row = layout.split(factor=0.64)
    row.use_property_split = False
    row.prop(settings, name, text=text, translate=False)
    return row.row()


def holds_hu(scene: bpy.types.Scene) -> bool:
    """Return whether gray values of the scene's CT are HU."""
    volume = volumes.current(scene)
    return volume is not None and volume.kind == ValueKind.HU


def draw_name(layout: Any, text: str, share: float = 0.4) -> Any:
    """Draw a name on the left, with this share of the width, as Blender does; return the room on its right."""
    row = layout.split(factor=share, align=True)
    row.use_property_split = False
    left = row.row()
    left.alignment = "RIGHT"
    left.label(text=text, translate=False)
    return row.row(align=True)


def width_of(context: bpy.types.Context) -> float:
    """Return the width of the region, pixels at Blender's usual size."""
    return 300.0 if context.region is None else context.region.width / context.preferences.system.ui_scale


def is_narrow(context: bpy.types.Context) -> bool:
    """Return whether two buttons with words do not fit side by side."""
    return width_of(context) < NARROW


def draw_pair(layout: Any, context: bpy.types.Context, left: float = 0.5) -> Any:
    """Return room for two buttons: side by side, the first with this share of the width, or one below the other."""
    return layout.column(align=True) if is_narrow(context) else layout.split(factor=left, align=True)


def text_width(text: str) -> float:
    """Return how wide a text is in Blender's own font, pixels at its usual size."""
    import blf

    blf.size(FONT, POINTS)
    return float(blf.dimensions(FONT, text)[0]) or LETTER * letters(text)


def draw_text(layout: Any, context: bpy.types.Context, text: str, icon: str = "NONE", reserved: float = 0.0) -> None:
    """Draw a sentence in the lines that the panel's width needs, leaving `reserved` pixels free."""
    column = layout.column(align=True)
    column.scale_y = 0.8
    room = max(NARROWEST, width_of(context) - MARGIN - reserved)
    for number, line in enumerate(in_lines(text, room, text_width)):
        column.label(text=line, icon=icon if number == 0 else "NONE" if icon == "NONE" else "BLANK1", translate=False)


def draw_shape_change(layout: Any, context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Warn if an object is mirrored, in red, or scaled."""
    change = shape_change(obj)
    if change.mirrored:
        red = layout.column()
        red.alert = True
        draw_text(red, context, mirrored_text(change), "ERROR")
    if change.scaled:
        draw_text(layout, context, scaled_text(change), "INFO")


def draw_table(layout: Any, facts: list[tuple[str, str]], share: float = 0.4) -> None:
    """Draw names, in this share of the width, and values, one line each at every width."""
    column = layout.column(align=True)
    column.scale_y = 0.85
    for name, value in facts:
        draw_name(column, name, share).label(text=value, translate=False)


def draw_job(layout: Any, job: jobs.Job) -> None:
    """Draw the progress of a job and its stop button instead of the button that started it."""
    row = layout.row(align=True)
    row.progress(factor=min(1.0, job.step.fraction), text=translate(job.step.message))
    row.operator("ctmc.cancel", text="", icon="X")


def draw_status(layout: Any, context: bpy.types.Context, *own: str) -> None:
    """Draw the end of a page: the progress of a job that shows it nowhere else, and the last error.

    Parameters
    ----------
    layout : UILayout
    context : bpy.types.Context
    *own : str
        Operators that show their progress in the place of their button.
    """
    job, message = jobs.running(), session.of(context.scene).message
    if job is not None and job.operator not in own:
        draw_job(layout, job)
    if message:
        draw_text(layout.box(), context, message, "ERROR")
