# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the fold Solid of the page Surface: operations on structures for 3D print."""

from __future__ import annotations

from typing import Any

import bpy

from ....core import SettingsError
from ....core.solid import LENGTHS
from ...operators.surface.solid import place_text, solid_text
from ...translations import translate, translate_sentence
from ...viewport.surface import solid_places
from ..layout import block, draw_name, draw_pair, draw_text

FIRST = ("thicken", "hollow")  # Lengths above drains, cuts and combinations.
BUTTON = 24.0  # Width of the button beside a text, pixels.


def draw_solid(room: Any, context: bpy.types.Context) -> None:
    """Draw lengths, drains, cuts with their pegs, combinations, and the printer's limits."""
    layout, solid = block(room), context.scene.ctmc_solid
    for name in FIRST:
        layout.prop(solid, name)
    _draw_drains(layout, context, solid)
    _draw_cuts(layout, solid)
    _draw_combinations(layout, solid)
    for name in LENGTHS:
        if name not in FIRST:
            layout.prop(solid, name)
    column = layout.column(align=True)
    column.use_property_split = False
    column.prop(solid, "use_bed", text=translate("Bed [mm]"), translate=False)
    sides = column.row(align=True)
    sides.active = solid.use_bed
    _draw_three(sides, solid, "bed")


def _draw_drains(layout: Any, context: bpy.types.Context, solid: Any) -> None:
    """Draw the buttons that add drains, and the list."""
    column = layout.column(align=True)
    column.label(text=translate("Drains"), translate=False)
    pair = draw_pair(column, context)
    pair.operator("ctmc.drain_add", text="At Cursor", icon="PIVOT_CURSOR")
    pair.operator("ctmc.drain_add", text="Auto", icon="AUTO").auto = True
    for index, drain in enumerate(solid.drains):
        row = column.row(align=True)
        row.use_property_split = False
        text = translate("Lowest and Highest") if drain.auto else place_text(drain.point, drain.diameter)
        row.label(text=text, translate=False)
        size = row.row(align=True)
        size.ui_units_x = 4.0
        size.prop(drain, "diameter", text="")
        _draw_remove(row, "drains", index)


def _draw_cuts(layout: Any, solid: Any) -> None:
    """Draw the button that adds a cut, the list, and the pegs on every cut."""
    column = layout.column(align=True)
    column.label(text=translate("Cuts"), translate=False)
    column.operator_menu_enum("ctmc.cut_add", "direction", text="Add Cut", icon="ADD")
    for index, cut in enumerate(solid.cuts):
        row = draw_name(column, translate("Position"), 0.3)
        row.prop(cut, "position", text="")
        row.operator("ctmc.cut_flip", text="", icon="ARROW_LEFTRIGHT").index = index
        _draw_remove(row, "cuts", index)
        _draw_three(draw_name(column, translate("Normal"), 0.3), cut, "normal")
    if not len(solid.cuts):
        return
    row = layout.row()
    row.use_property_split = False
    row.prop(solid, "use_pegs")
    if solid.use_pegs:
        row.prop(solid, "peg_count", text="")
        pegs = layout.column(align=True)
        for name in ("peg_diameter", "peg_length", "clearance"):
            pegs.prop(solid, name)


def _draw_combinations(layout: Any, solid: Any) -> None:
    """Draw the button that adds a combination, and the list."""
    column = layout.column(align=True)
    column.label(text=translate("Combine"), translate=False)
    column.operator_menu_enum("ctmc.combination_add", "how", text="Combine Structures", icon="ADD")
    for index, combination in enumerate(solid.combinations):
        row = column.row(align=True)
        row.use_property_split = False
        row.prop(combination, "how", text="")
        row.prop(combination, "title", text="", placeholder=translate("Name"))
        _draw_remove(row, "combinations", index)
        operands = column.column(align=True)
        operands.use_property_split = False
        for operand in combination.of:
            operands.prop(operand, "structure", text="", placeholder=translate("Structure"))


def _draw_three(row: Any, owner: Any, name: str) -> None:
    """Draw the three numbers of a property side by side."""
    for axis in range(3):
        row.prop(owner, name, index=axis, text="")


def _draw_remove(row: Any, kind: str, index: int) -> None:
    remove = row.operator("ctmc.solid_remove", text="", icon="X")
    remove.kind, remove.index = kind, index


def draw_solid_line(layout: Any, context: bpy.types.Context) -> None:
    """Draw the solid's operations on the next surfaces, with a button that resets them."""
    try:
        text = solid_text(context.scene.ctmc_solid.to_request())
    except SettingsError:  # Shown below, with its remedy.
        text = translate("Makes a solid")
    if text:
        row = layout.row(align=True)
        draw_text(row, context, text, "MOD_SOLIDIFY", reserved=BUTTON)
        row.operator("ctmc.solid_reset", text="", icon="X", emboss=False)


def draw_places(layout: Any, context: bpy.types.Context) -> None:
    """Draw notes on pegs and drains that do not fit, or that they are still being placed."""
    placed = solid_places.places_of(context.scene)
    if solid_places.is_looking(context.scene):
        draw_text(layout, context, translate("Placing pegs and drains"), "TIME")
    if placed is None:
        return
    for note in placed.notes:
        draw_text(layout, context, translate_sentence(note), "ERROR")
    if placed.coarse and (placed.drains.bars or (placed.pegs and placed.pegs.bars)):
        draw_text(layout, context, translate("Placed on a coarse surface; final places may differ"), "INFO")
