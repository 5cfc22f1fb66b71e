# SPDX-License-Identifier: GPL-3.0-or-later
"""Work on results: measure, deviation map, copy an object's settings to the panel, copy as command."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ....blender.figure.distance_map import DISTANCE, DISTANCE_RAMP
from ....blender.maps import show_map, write_map
from ....blender.surface import as_shown, other_modifiers, own_mesh, require_editable, settings_of
from ....core import CtmcError, MeshError, Reconstruction, SettingsError, Stages, Steps, TriangleMesh, distance_phrases
from ....core.files.file_names import file_name
from ....core.maps import SurfaceMap, statistics_of, vertex_areas
from ....core.mesh import ReferenceSurface, SurfaceDistance, surface_distance_steps, vertex_distances_steps
from ....readers import ReadingOptions
from ....reporting.command_line import command_line
from ... import jobs
from ...properties.reading import options_of_scene
from ...properties.structures import called
from ...state import drawings, measurements, session, structures, surfaces, volumes
from ...state.measurements import measurement_steps
from ...translations import translate, translate_phrase
from ...viewport import maps as viewport_maps

MAP_STAGES = {"Comparing with the full surface": 2, "Measuring": 1}


class CTMC_OT_measure(jobs.LongOperator, bpy.types.Operator):
    """Measure the active surface as it is now."""

    bl_idname = "ctmc.measure"
    bl_label = "Measure"
    bl_description = (
        "Measure volume, area and components of the active surface as it is now, alpha and modifiers included. "
        "Moving, turning or scaling the object changes nothing: it is measured in the patient's millimeters"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    needs = (jobs.idle, surfaces.can_change)

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        """Return the work on the surface at its position in the patient: moving the object is not a deviation."""
        scene, obj = context.scene, context.view_layer.objects.active
        full = surfaces.full_of_last_run(obj, scene)
        mesh = as_shown(obj, scene).mesh
        return measure_steps(mesh, full, obj.session_uid, measurements.mesh_state(obj))


def measure_steps(
    mesh: TriangleMesh, full: Reconstruction | None, uid: int, state: measurements.State
) -> Steps[jobs.Conclusion]:
    """Measure a surface, and compare it with the full surface if that is known."""
    measurement = yield from measurement_steps(mesh, None if full is None else full.mesh)

    def conclude() -> str:
        obj = session.object_of(uid)
        if obj is not None:
            measurements.keep(obj, measurement, state)
        return translate("Measured")

    return conclude


def _has_full(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether the full surface of the active one is in memory, with the reason if not."""
    obj = context.view_layer.objects.active
    if surfaces.full_of_last_run(obj, context.scene) is None:
        operator.poll_message_set(
            "The full surface is not in memory; reconstruct again, at a larger stride if it does not fit"
        )
        return False
    return True


class CTMC_OT_deviation_map(jobs.LongOperator, bpy.types.Operator):
    """Color the active surface by its distance to the full one."""

    bl_idname = "ctmc.deviation_map"
    bl_label = "Deviation Map"
    bl_description = (
        "Add each vertex's distance to the full surface [mm] as a map, and show it in the viewport, with a legend"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    needs = (jobs.idle, surfaces.can_change, _has_full)

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        scene, obj = context.scene, context.view_layer.objects.active
        require_editable(obj)
        full = surfaces.full_of_last_run(obj, scene)
        assert full is not None, "has_full asks for it"
        measurement = None if any(modifier.show_viewport for modifier in other_modifiers(obj)) else measurements.of(obj)
        distance = None if measurement is None else measurement.distance
        return deviation_steps(own_mesh(obj), full, obj.session_uid, distance)


def deviation_steps(
    mesh: TriangleMesh, full: Reconstruction, uid: int, distance: SurfaceDistance | None = None
) -> Steps[jobs.Conclusion]:
    """Measure every vertex, then write once; the message has the numbers of Results, which may be known already."""
    reference, stages = ReferenceSurface(full.mesh), Stages(MAP_STAGES)
    comparing, measuring = MAP_STAGES
    if distance is None:
        distance = yield from stages.run(comparing, surface_distance_steps(mesh, reference))
    measured = distance
    distances = yield from stages.run(measuring, vertex_distances_steps(mesh, reference))

    def conclude() -> str:
        obj = session.object_of(uid)
        if obj is None or len(obj.data.vertices) != len(distances):
            raise MeshError("the surface was deleted or changed meanwhile; make the deviation map again")
        require_editable(obj)
        largest = max(measured.to_full.largest, float(distances.max(initial=0.0)))
        values = distances.astype(np.float32)
        statistics = statistics_of(values, vertex_areas(mesh))
        write_map(obj.data, SurfaceMap(DISTANCE, "mm", values, (0.0, largest or 1.0), DISTANCE_RAMP, statistics))
        show_map(obj, DISTANCE)
        viewport_maps.show()
        return f"{obj.name}: {', '.join(map(translate_phrase, distance_phrases(measured)))}"

    return conclude


class CTMC_OT_adopt_settings(bpy.types.Operator):
    """Copy the settings of the active surface to the panel."""

    bl_idname = "ctmc.adopt_settings"
    bl_label = "Copy Settings to Panel"
    bl_description = "Copy the settings that the active surface was made with to the panel"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not surfaces.is_surface(context.view_layer.objects.active):
            cls.poll_message_set("Choose a reconstructed surface first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            context.scene.ctmc.from_settings(settings_of(context.view_layer.objects.active))
        except CtmcError as error:
            return jobs.refuse(self, context.scene.session_uid, error)
        return {"FINISHED"}


class CTMC_OT_copy_command(bpy.types.Operator):
    """Copy the command line that makes the same mesh."""

    bl_idname = "ctmc.copy_command"
    bl_label = "Copy as Command"
    bl_description = "Copy the ctmc command line that makes the same mesh as Reconstruct Surface does now"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not context.scene.ctmc.volume_path:
            cls.poll_message_set("Load a CT first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            text = command_text(context.scene)
        except CtmcError as error:
            return jobs.refuse(self, context.scene.session_uid, error)
        context.window_manager.clipboard = text
        self.report({"INFO"}, text)
        return {"FINISHED"}


def command_text(scene: bpy.types.Scene) -> str:
    """Return the command line of every surface the panel asks for."""
    stored, loaded = scene.ctmc, volumes.loaded(scene)
    source = bpy.path.abspath(stored.volume_path)
    reading = loaded.reading if loaded is not None else options_of_scene(stored)
    name = loaded.volume.name if loaded is not None else Path(source).stem
    lines = []
    for settings in stored.all_settings():
        item = stored.structure_of(settings)
        output = file_name(name if settings.label is None else f"{name}_label_{settings.label}") + ".stl"
        if item is not None and drawings.drawn_by(scene, item) is not None:
            raise SettingsError(
                f"no command makes {called(item)}, because it was drawn; save the .blend and use the labels beside it"
            )
        path, number = structures.origin_of(scene, item)
        if path:  # The labels are from a file other than the CT's.
            lines.append(command_line(path, output, replace(settings, label=number), ReadingOptions()))
        else:
            lines.append(command_line(source, output, settings, reading))
    return "\n".join(lines)


register, unregister = bpy.utils.register_classes_factory(
    (CTMC_OT_measure, CTMC_OT_deviation_map, CTMC_OT_adopt_settings, CTMC_OT_copy_command)
)
