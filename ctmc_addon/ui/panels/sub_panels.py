"""The closed panels below the main one: parts, normals, rotation test, results."""

from __future__ import annotations

from typing import Any

import bpy

from ...blender.surface import Provenance, read_provenance
from ...reporting.formatting import count
from .. import jobs
from ..state import measurements, session
from ..state.measurements import Measurement
from ..translations import translate
from .layout import SubPanel, draw_facts, draw_job, draw_pair, draw_setting, draw_text, prepare


class CTMC_PT_parts(SubPanel, bpy.types.Panel):
    """Which parts of the surface are kept, and whether it is closed."""

    bl_idname = "CTMC_PT_parts"
    bl_label = "Parts"

    def draw(self, context: bpy.types.Context) -> None:
        """Largest, smallest, border."""
        prepare(self.layout)
        for name in ("keep_parts", "min_part_mm3", "close_border"):
            draw_setting(self.layout, context.scene.ctmc, name)


class CTMC_PT_normals(SubPanel, bpy.types.Panel):
    """Shading and topology."""

    bl_idname = "CTMC_PT_normals"
    bl_label = "Normals"

    def draw(self, context: bpy.types.Context) -> None:
        """Where normals come from, how ambiguous voxels are cut, how broken values are read."""
        prepare(self.layout)
        for name in ("normals", "topology", "nan_as"):
            draw_setting(self.layout, context.scene.ctmc, name)


class CTMC_PT_rotation(SubPanel, bpy.types.Panel):
    """The timed turntable."""

    bl_idname = "CTMC_PT_rotation"
    bl_label = "Rotation Test"

    def draw(self, context: bpy.types.Context) -> None:
        """Levels, step, rounds; then the table."""
        layout, settings = self.layout.column(), context.scene.ctmc
        prepare(self.layout, lock=False)
        prepare(layout)
        for name in ("rotation_kind", "rotation_levels", "rotation_step", "rotation_rounds"):
            layout.prop(settings, name)
        job = jobs.running("ctmc.rotation_test")
        if job is not None:
            draw_job(self.layout, job)
        else:
            self.layout.operator("ctmc.rotation_test", icon="FILE_3D")
        layout = self.layout.column()
        layout.enabled = not jobs.locked()
        table = session.of(context.scene).rotation
        if table is not None:
            draw_table(layout, table.rows(translate("Round"), translate("Average"), translate("Saving")))
            row = draw_pair(layout, context)
            row.operator("ctmc.rotation_copy", icon="COPYDOWN")
            row.operator("ctmc.rotation_save", icon="FILE_TICK")


def draw_table(layout: Any, rows: list[list[str]]) -> None:
    """Text in columns."""
    flow = layout.box().grid_flow(row_major=True, columns=len(rows[0]), even_columns=True, align=True)
    for row in rows:
        for cell in row:
            flow.label(text=cell, translate=False)


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
        row = draw_pair(layout, context)
        row.operator("ctmc.make_final", icon="CHECKMARK")
        row.operator("ctmc.adopt_settings", icon="EYEDROPPER")
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
        (translate("Volume"), f"{measures.millilitres:.4g} ml" if measures.closed else "-"),
        (translate("Area"), f"{measures.square_centimetres:.4g} cm2"),
        (translate("Components"), count(measures.components)),
    ]


register, unregister = bpy.utils.register_classes_factory(
    (CTMC_PT_parts, CTMC_PT_normals, CTMC_PT_rotation, CTMC_PT_results)
)
