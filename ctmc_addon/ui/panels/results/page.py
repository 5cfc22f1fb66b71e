# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the page Results: facts of the active surface, and operators on it.

While something else is active, such as a slice, the surface that was active last stays, dimmed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy

from ....blender.surface import Provenance, read_provenance, shown_faces
from ....blender.units import shows_mm
from ....core import UNKNOWN, FinishedSurface, Place, measures_in, printed_of, volume_text
from ....core.mesh import Measures
from ....reporting.formatting import count
from ...operators.results.pick_component import ACTIONS
from ...properties.preferences import machine
from ...state.results import measurements, surfaces
from ...state.results.measurements import Measurement
from ...translations import translate, translate_sentence
from ..ct.slice import draw_cuts
from ..layout import (
    PagePanel,
    begin,
    block,
    draw_shape_change,
    draw_status,
    draw_table,
    draw_text,
    fold,
    text_width,
    width_of,
)
from .maps import draw_maps
from .rulers import draw_rulers
from .table import TABLE, draw_measurements, measure_text

NAMES = 0.47  # Share of the width for names.
BESIDE, PADDING = 56.0, 8.0  # Pixels of the sidebar beside its lines, and of a label beside its text.


class CTMC_PT_results(PagePanel, bpy.types.Panel):
    """Page for facts of the active surface, and for operators on it."""

    bl_idname = "CTMC_PT_results"
    bl_label = "Results"
    page = "RESULTS"

    def draw(self, context: bpy.types.Context) -> None:
        layout, obj = begin(self.layout), surfaces.surface_of_results(context)
        if obj is None:
            layout.label(text=translate("No surface is selected"), icon="INFO", translate=False)
            draw_status(self.layout, context)
            return
        _draw_surface(layout, context, obj)
        for name, text, draw in FOLDS:
            body = fold(self.layout, name, text=text)
            if body is not None:
                draw(body, context)
        draw_status(self.layout, context, TABLE)


def _draw_surface(layout: Any, context: bpy.types.Context, obj: bpy.types.Object) -> None:
    """Draw the look of a surface, its facts, and what can be done to it."""
    is_active = obj == context.view_layer.objects.active
    layout.active = is_active
    provenance = read_provenance(obj)
    row = layout.split(factor=0.8)
    row.use_property_split = False
    row.label(text=obj.name, icon="OUTLINER_OB_MESH", translate=False)
    color = row.row()
    color.enabled = is_active
    color.prop(context.scene.ctmc, "color", text="")
    opacity = layout.row()
    opacity.enabled = is_active
    opacity.prop(context.scene.ctmc, "opacity", slider=True)
    _draw_display(layout, context, obj, is_active)
    measurement = None if provenance is None else measurements.of(obj)
    unit = surfaces.unit_of(obj, context.scene)
    item = None if provenance is None else context.scene.ctmc.structure_of(provenance.settings)
    name = item.name if item is not None and surfaces.is_of_ct(obj, context.scene) else ""
    facts = facts_of(provenance, measurement, unit, name)
    draw_table(layout, fitting([fact for fact in facts if fact[1] != UNKNOWN], width_of(context)), NAMES)
    if provenance is not None and obj.data.is_editmode:
        draw_text(layout, context, translate("Leave Edit Mode first"), "INFO")
    _draw_mending(layout, context, measurement)
    column = layout.column(align=True)
    column.label(text=translate("Pick Component"), translate=False)
    row = column.row(align=True)
    for action, (label, _) in ACTIONS.items():
        row.operator("ctmc.pick_component", text=label).action = action
    layout.operator("ctmc.measure", icon="DRIVER_DISTANCE")
    layout.operator("ctmc.export", text="Export ...", icon="EXPORT")
    if provenance is not None:
        draw_shape_change(layout, context, obj)
    for note in () if provenance is None else measurements.other_notes(provenance.notes, measurement):
        draw_text(layout, context, translate_sentence(note), "INFO")


def _draw_display(layout: Any, context: bpy.types.Context, obj: bpy.types.Object, is_active: bool) -> None:
    """Draw the choice of what the viewport shows of a large surface, and how much that is."""
    if not surfaces.can_be_light(obj):
        return
    row = layout.row()
    row.enabled = is_active and not obj.data.is_editmode
    row.prop(context.scene.ctmc, "display", expand=True)
    shown = shown_faces(obj)
    if shown is not None:
        text = translate("Shown with {shown} of {faces} triangles; renders and exports are full")
        draw_text(layout, context, text.format(shown=count(shown), faces=count(len(obj.data.polygons))), "INFO")


def _draw_mending(layout: Any, context: bpy.types.Context, measurement: Measurement | None) -> None:
    """Draw whether the surface is closed, its number of components, and buttons to fix both."""
    measures = None if measurement is None else measurement.measures
    for text, buttons in (
        (surface_text(measures), (("ctmc.close_border", "Close Border"),)),
        (components_text(measures), (("ctmc.keep_largest", "Keep Largest"), ("ctmc.remove_small", "Remove Small"))),
    ):
        column = layout.column(align=True)
        draw_text(column, context, text)
        row = column.row(align=True)
        for name, label in buttons:
            row.operator(name, text=label)


def surface_text(measures: Measures | None) -> str:
    """Return whether a surface is closed, and what cuts it."""
    if measures is None:
        return translate("Surface: not measured")
    if measures.closed:
        return translate("Surface: closed")
    text = "Surface: open, 1 border" if measures.borders == 1 else "Surface: open, {count} borders"
    return translate(text).format(count=count(measures.borders))


def components_text(measures: Measures | None) -> str:
    """Return how many components and cavities a surface has, and how many of both are small."""
    if measures is None:
        return translate("Components: not counted")
    counts = [_counted("1 component", "{count} components", measures.bodies)]
    if measures.cavities:
        counts.append(_counted("1 cavity", "{count} cavities", measures.cavities))
    if measures.has_many_small_components:
        small = count(measures.small_components)
        counts.append(translate("{small} below {volume}").format(small=small, volume=volume_text(measures.small)))
    return ", ".join(counts)


def _counted(single: str, several: str, number: int) -> str:
    return translate(single if number == 1 else several).format(count=count(number))


def facts_of(
    provenance: Provenance | None, measurement: Measurement | None, unit: str = "", name: str = ""
) -> list[tuple[str, str]]:
    """Return names and values of counts and measures; a dash for an unknown value.

    A threshold is shown with its unit, and a label with its name in the list.
    """
    surface = FinishedSurface() if measurement is None else measurement.finished
    shown = measures_in(Place.PANEL, printed=printed_of([surface]))
    facts = {each.name: (each.label, measure_text(each, surface)) for each in shown}
    threshold = ("Threshold", UNKNOWN)
    if provenance is not None:
        faces = provenance.faces if surface.measures is None else surface.measures.faces
        of_full = translate("{faces} of {full}").format(faces=count(faces), full=count(provenance.full_faces))
        facts["faces"] = (facts["faces"][0], count(faces) if faces == provenance.full_faces else of_full)
        threshold = ("Threshold", f"{provenance.threshold:.6g} {unit}".rstrip())
        if provenance.settings.label is not None:
            threshold = ("Label", f"{provenance.settings.label}, {name}".removesuffix(", "))
    lines = [facts.pop("faces"), threshold, *facts.values()]
    return [(translate(label), value) for label, value in lines]


def fitting(facts: Sequence[tuple[str, str]], width: float) -> list[tuple[str, str]]:
    """Return facts with what stands in brackets on a line of its own where a value does not fit beside its name.

    Parameters
    ----------
    facts : sequence of (name, value)
    width : float
        Of the sidebar, pixels at Blender's usual size.
    """
    room, lines = (1 - NAMES) * (width - BESIDE) - PADDING, list[tuple[str, str]]()
    for name, value in facts:
        first, bracket, rest = value.partition(" (")
        is_cut = bracket and text_width(value) > room
        lines += [(name, first), ("", rest.removesuffix(")"))] if is_cut else [(name, value)]
    return lines


def _draw_more(room: Any, context: bpy.types.Context) -> None:
    """Draw what is seldom done to a surface."""
    column = block(room).column(align=True)  # Too many words to be side by side.
    column.operator("ctmc.make_final", icon="CHECKMARK")
    column.operator("ctmc.adopt_settings", icon="EYEDROPPER")
    if not shows_mm(context.scene, machine().scale):
        column.operator("ctmc.set_units", icon="DRIVER_DISTANCE")


FOLDS = (
    ("maps", "Maps", draw_maps),
    ("cuts", "Cut", draw_cuts),
    ("rulers", "Distances and Angles", draw_rulers),
    ("measurements", "Measurements", draw_measurements),
    ("more", "Shape and Settings", _draw_more),
)
"""Name, heading and drawing function of what opens in place."""
