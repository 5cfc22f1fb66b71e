# SPDX-License-Identifier: GPL-3.0-or-later
"""The closed panel Results: what is known of the active surface, and what can be done with it."""

from __future__ import annotations

import bpy

from ...blender.surface import Provenance, read_provenance
from ...reporting.formatting import count
from ..state import measurements
from ..state.measurements import Measurement
from ..translations import translate
from .layout import SubPanel, draw_facts, draw_pair, draw_text, prepare


class CTMC_PT_results(SubPanel, bpy.types.Panel):
    """What is known of the active surface."""

    bl_idname = "CTMC_PT_results"
    bl_label = "Results"

    def draw(self, context: bpy.types.Context) -> None:
        """Triangles, distance, volume, area, parts; what can be done with it."""
        layout, obj = self.layout, context.view_layer.objects.active
        prepare(layout)
        provenance = read_provenance(obj)
        if provenance is None:
            layout.label(text=translate("No reconstructed surface is selected"), icon="INFO", translate=False)
            return
        layout.label(text=obj.name, icon="OUTLINER_OB_MESH", translate=False)
        draw_facts(layout, context, facts_of(provenance, measurements.of(obj)), names=0.45)
        row = draw_pair(layout, context)
        row.operator("ctmc.measure", icon="DRIVER_DISTANCE")
        row.operator("ctmc.deviation_map", icon="COLOR")
        column = layout.column(align=True)  # too many words to stand side by side
        column.operator("ctmc.make_final", icon="CHECKMARK")
        column.operator("ctmc.adopt_settings", icon="EYEDROPPER")
        for note in provenance.notes:
            draw_text(layout, context, note, "INFO")


def facts_of(provenance: Provenance, measurement: Measurement | None) -> list[tuple[str, str]]:
    """Names and values of what was counted and measured."""
    faces = provenance.faces if measurement is None else measurement.measures.faces
    of_full = translate("{faces} of {full}").format(faces=count(faces), full=count(provenance.full_faces))
    facts = [
        (translate("Triangles"), count(faces) if faces == provenance.full_faces else of_full),
        (translate("Threshold"), f"{provenance.threshold:.6g}"),
    ]
    if measurement is None:
        return facts
    measures, distance = measurement.measures, measurement.distance
    if distance is not None:
        facts.append((translate("Mean Distance"), f"{distance.mean:.3g} mm"))
        facts.append((translate("Largest Distance"), f"{distance.largest:.3g} mm"))
    return [
        *facts,
        (translate("Surface"), translate("closed") if measures.closed else translate("open")),
        (translate("Volume"), f"{measures.milliliters:.4g} ml" if measures.closed else "-"),
        (translate("Area"), f"{measures.square_centimeters:.4g} cm2"),
        (translate("Components"), count(measures.components)),
    ]


register, unregister = bpy.utils.register_classes_factory((CTMC_PT_results,))
