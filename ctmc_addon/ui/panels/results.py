# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the panel Results, below the button: facts of the active surface, and operators on it.

Its lines are the same with and without a surface, so that nothing below it jumps when one is selected. While something
else is active, such as a slice, the surface that was active last stays, dimmed.
"""

from __future__ import annotations

from typing import Any

import bpy

from ...blender.surface import Provenance, read_provenance
from ...core import HU, UNKNOWN, FinishedSurface, Measure, Place, measures_in, volume_text
from ...core.mesh import Measures
from ...reporting.formatting import count
from ..operators.surface.pick_component import ACTIONS
from ..state import measurements, surfaces
from ..state.measurements import Measurement
from ..translations import translate, translate_sentence
from ..viewport import deviation
from .layout import StepPanel, draw_shape_change, draw_table, draw_text, prepare


class CTMC_PT_results(StepPanel, bpy.types.Panel):
    """Panel for facts of the active surface."""

    bl_idname = "CTMC_PT_results"
    bl_label = "Results"

    def draw(self, context: bpy.types.Context) -> None:
        layout, obj = self.layout.column(), surfaces.surface_of_results(context)
        prepare(self.layout)
        prepare(layout)
        is_active = obj is not None and obj == context.view_layer.objects.active
        layout.active = is_active or obj is None
        provenance = read_provenance(obj)
        name = translate("No surface is selected") if obj is None else obj.name
        row = layout.split(factor=0.8)
        row.use_property_split = False
        row.label(text=name, icon="OUTLINER_OB_MESH", translate=False)
        color = row.row()
        color.enabled = is_active
        color.prop(context.scene.ctmc, "color", text="")
        opacity = layout.row()
        opacity.enabled = is_active
        opacity.prop(context.scene.ctmc, "opacity", slider=True)
        measurement = None if provenance is None else measurements.of(obj)
        unit = surfaces.unit_of(obj, context.scene)
        item = None if provenance is None else context.scene.ctmc.structure_of(provenance.settings)
        name = item.name if item is not None and surfaces.is_of_ct(obj, context.scene) else ""
        draw_table(layout, facts_of(provenance, measurement, unit, name), 0.46)
        if obj is not None and obj.data.is_editmode:
            draw_text(layout, context, translate("Leave edit mode first"), "INFO")
        _draw_mending(layout, measurement)
        column = layout.column(align=True)
        column.label(text=translate("Pick Component"), translate=False)
        row = column.row(align=True)
        for action, (label, _) in ACTIONS.items():
            row.operator("ctmc.pick_component", text=label).action = action
        layout.operator("ctmc.measure", icon="DRIVER_DISTANCE")
        column = layout.column(align=True)
        column.operator("ctmc.deviation_map", icon="COLOR")
        column.operator("ctmc.deviation_view", icon="SHADING_SOLID", depress=deviation.is_shown_on(obj))
        column = layout.column(align=True)  # Too many words to be side by side.
        column.operator("ctmc.make_final", icon="CHECKMARK")
        column.operator("ctmc.adopt_settings", icon="EYEDROPPER")
        if provenance is not None:
            draw_shape_change(layout, context, obj)
        for note in () if provenance is None else measurements.other_notes(provenance.notes, measurement):
            draw_text(layout, context, translate_sentence(note), "INFO")


def _draw_mending(layout: Any, measurement: Measurement | None) -> None:
    """Draw whether the surface is closed, its number of components, and buttons to fix both."""
    measures = None if measurement is None else measurement.measures
    for text, buttons in (
        (surface_text(measures), (("ctmc.close_border", "Close Border"),)),
        (components_text(measures), (("ctmc.keep_largest", "Keep Largest"), ("ctmc.remove_small", "Remove Small"))),
    ):
        column = layout.column(align=True)
        column.label(text=text, translate=False)
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
    """Return how many components a surface has, and how many are small."""
    if measures is None:
        return translate("Components: not counted")
    text = "{count} components"
    if measures.has_many_small_components:
        text = "{count} components, {small} below {volume}"
    text = translate("1 component" if measures.components == 1 else text)
    small = count(measures.small_components)
    return text.format(count=count(measures.components), small=small, volume=volume_text(measures.small))


def facts_of(
    provenance: Provenance | None, measurement: Measurement | None, unit: str = "", name: str = ""
) -> list[tuple[str, str]]:
    """Return names and values of counts and measures; a dash for an unknown value.

    A threshold is shown with its unit, and a label with its name in the list.
    """
    surface = FinishedSurface() if measurement is None else measurement.finished
    facts = {each.name: (each.label, measure_text(each, surface)) for each in measures_in(Place.PANEL)}
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


def measure_text(about: Measure, surface: FinishedSurface, unit: str = "") -> str:
    """Return a measure of a surface in the panel's language; `unit` is that of gray values."""
    value = about.value(surface)
    if about.unit == "mm3" and surface.measures is not None and not surface.measures.closed:
        return translate("- (open)")
    if isinstance(value, int) and not isinstance(value, bool):
        return count(value)
    return f"{about.text(value)} {unit if about.unit == HU else ''}".rstrip()


register, unregister = bpy.utils.register_classes_factory((CTMC_PT_results,))
