"""The closed panels below the main one: parts, normals, rotation test, results."""

from __future__ import annotations

from typing import Any

import bpy

from ... import blender as scenes
from ...reporting.formatting import count
from .. import jobs
from ..state import session, surfaces
from ..translations import say
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
        job = jobs.running()
        if job is not None and job.title == "Run Rotation Test":
            draw_job(self.layout)
        else:
            self.layout.operator("ctmc.rotation_test", icon="FILE_3D")
        layout = self.layout.column()
        layout.enabled = not jobs.locked()
        table = session.of(context.scene).rotation
        if table is not None:
            draw_table(layout, table.rows(say("Round"), say("Average"), say("Saving")))
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
        layout, thing = self.layout, context.view_layer.objects.active
        prepare(layout)
        if not surfaces.is_surface(thing):
            layout.label(text=say("No reconstructed surface is selected"), icon="INFO", translate=False)
            return
        layout.label(text=thing.name, icon="OUTLINER_OB_MESH", translate=False)
        known = scenes.remembered(thing)
        result = session.of(context.scene).results.get(thing.session_uid)
        draw_facts(layout, context, facts_of(known, result), names=0.45)
        row = draw_pair(layout, context)
        row.operator("ctmc.measure", icon="DRIVER_DISTANCE")
        row.operator("ctmc.deviation_map", icon="COLOR")
        row = draw_pair(layout, context)
        row.operator("ctmc.make_final", icon="CHECKMARK")
        row.operator("ctmc.adopt_settings", icon="EYEDROPPER")
        for note in known.get("notes", ()):
            draw_text(layout, context, note, "INFO")


def facts_of(known: dict[str, Any], result: Any) -> list[tuple[str, str]]:
    """Names and values of what was counted and measured."""
    faces = known["faces"] if result is None else result.measures.faces
    of_full = say("{faces} of {full}").format(faces=count(faces), full=count(known["full_faces"]))
    facts = [
        (say("Triangles"), count(faces) if faces == known["full_faces"] else of_full),
        (say("Threshold"), f"{known['threshold']:.6g}"),
    ]
    if result is None:
        return facts
    measures = result.measures
    if result.closeness is not None:
        facts.append((say("Mean Distance"), f"{result.closeness.mean:.3g} mm"))
        facts.append((say("Largest Distance"), f"{result.closeness.maximum:.3g} mm"))
    return [
        *facts,
        (say("Surface"), say("closed") if measures.closed else say("open")),
        (say("Volume"), f"{measures.millilitres:.4g} ml" if measures.closed else "-"),
        (say("Area"), f"{measures.square_centimetres:.4g} cm2"),
        (say("Parts"), count(measures.parts)),
    ]


register, unregister = bpy.utils.register_classes_factory(
    (CTMC_PT_parts, CTMC_PT_normals, CTMC_PT_rotation, CTMC_PT_results)
)
