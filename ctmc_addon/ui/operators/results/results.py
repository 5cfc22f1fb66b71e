# SPDX-License-Identifier: GPL-3.0-or-later
"""Work on results: measure, copy an object's settings to the panel, copy as command."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy

from ....blender.surface import as_shown, settings_of
from ....core import CtmcError, Reconstruction, SettingsError, Steps, TriangleMesh
from ....core.files.file_names import file_name
from ....readers import ReadingOptions
from ....reporting.command_line import command_line
from ... import jobs
from ...properties.ct.reading import options_of_scene
from ...properties.surface.structures import called
from ...state import session
from ...state.ct import volumes
from ...state.draw import drawings
from ...state.results import measurements, surfaces
from ...state.results.measurements import measurement_steps
from ...state.surface import solids, structures
from ...translations import translate


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
    bl_label = "Copy Command"
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
    """Return the command line of every surface the panel asks for, or of the parts of a solid."""
    stored, loaded = scene.ctmc, volumes.loaded(scene)
    source = bpy.path.abspath(stored.volume_path)
    reading = loaded.reading if loaded is not None else options_of_scene(stored)
    name = loaded.volume.name if loaded is not None else Path(source).stem
    solid = solids.solid_of(scene)
    lines = []
    for settings in solids.runs_of(scene, solid):
        item = stored.structure_of(settings)
        output = file_name(name if settings.label is None else f"{name}_label_{settings.label}")
        output += ".3mf" if solid.cuts else ".stl"
        if item is not None and drawings.drawn_by(scene, item) is not None:
            raise SettingsError(
                f"no command makes {called(item)}, because it was drawn; save the .blend and use the labels beside it"
            )
        path, number = structures.origin_of(scene, item)
        if solid.combinations:
            if path:
                raise SettingsError("no command combines labels of other files than the CT's; combine them here")
            return command_line(source, file_name(name) + ".3mf", replace(settings, label=None), reading, solid)
        if path:  # The labels are from a file other than the CT's.
            lines.append(command_line(path, output, replace(settings, label=number), ReadingOptions(), solid))
        else:
            lines.append(command_line(source, output, settings, reading, solid))
    return "\n".join(lines)


register, unregister = bpy.utils.register_classes_factory(
    (CTMC_OT_measure, CTMC_OT_adopt_settings, CTMC_OT_copy_command)
)
