"""What several panels draw: a setting with its switch, sentences in lines, a job's progress."""

from __future__ import annotations

from typing import Any

import bpy

from ..core.settings import described
from ..core.words import in_lines
from . import jobs
from .marks import OURS, TAB
from .properties import optional, switch
from .translations import say

LETTER = 5.8  # pixels of a letter at Blender's usual size
MARGIN = 60.0  # pixels of a panel beside its text


class SidePanel:
    """What all panels of the tab share; inherited before `bpy.types.Panel`."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = TAB
    bl_translation_context = OURS


class SubPanel(SidePanel):
    """A panel below the main one, closed until it is wanted."""

    bl_parent_id = "CTMC_PT_main"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012  (Blender reads it from the class)


def prepare(layout: Any, lock: bool = True) -> None:
    """Labels on the left, values on the right, no dots for keyframes; grey while a job locks the file, unless told."""
    if lock:
        layout.enabled = not jobs.locked()
    layout.use_property_split = True
    layout.use_property_decorate = False


def draw_setting(layout: Any, settings: Any, name: str) -> None:
    """One setting, with its switch if it may be absent."""
    if not optional(name):
        layout.prop(settings, name)
        return
    row = layout.row(heading=say(described()[name].label), heading_ctxt=OURS)
    row.prop(settings, switch(name), text="")
    value = row.row()
    value.active = getattr(settings, switch(name))
    value.prop(settings, name, text="")


def draw_text(layout: Any, context: bpy.types.Context, text: str, icon: str = "NONE") -> None:
    """A sentence in as many lines as the panel's width asks for."""
    scale = context.preferences.system.ui_scale
    width = 300.0 if context.region is None else context.region.width / scale
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, line in enumerate(in_lines(text, max(16, int((width - MARGIN) / LETTER)))):
        column.label(text=line, icon=icon if number == 0 else "NONE" if icon == "NONE" else "BLANK1", translate=False)


def draw_facts(layout: Any, facts: list[tuple[str, str]], names: float = 0.32) -> None:
    """Names on the left, in this share of the width, and values on the right."""
    column = layout.column(align=True)
    column.scale_y = 0.85
    for name, value in facts:
        row = column.split(factor=names)
        left = row.row()
        left.alignment = "RIGHT"
        left.label(text=name, translate=False)
        row.label(text=value, translate=False)


def draw_job(layout: Any) -> None:
    """How far the job is, and the button that stops it, in the place of the button that started it."""
    job = jobs.running()
    assert job is not None, "the caller has looked"
    row = layout.row(align=True)
    row.progress(factor=min(1.0, job.step.fraction), text=say(job.step.message))
    row.operator("ctmc.cancel", text="", icon="X")
