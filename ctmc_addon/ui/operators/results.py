"""What came out: measure, deviation map, settings of an object taken over, the command that makes the same."""

from __future__ import annotations

from pathlib import Path

import bpy

from ... import blender as scenes
from ...blender.figure.colour_map import paint_deviation
from ...blender.surface import (
    Trees,
    closeness_steps,
    evaluated_triangles,
    middle_of,
    own_mesh,
    require_changeable,
    settings_of,
)
from ...core import CtmcError, MeshError, Reconstruction, Steps, TriangleMesh, within
from ...core.mesh import measures_steps
from ...reporting.command_line import command_line
from .. import jobs
from ..state import session, surfaces, volumes
from ..translations import say
from . import measure
from .reconstruct import has_surface


class CTMC_OT_measure(jobs.LongOperator, bpy.types.Operator):
    """Measure the active surface as it is now."""

    bl_idname = "ctmc.measure"
    bl_label = "Measure"
    bl_description = "Measure volume, area and parts of the active surface as it is now, alpha and modifiers included"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only with a surface to measure."""
        return jobs.idle(cls) and has_surface(cls, context)

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        """The evaluated surface."""
        scene, thing = context.scene, context.view_layer.objects.active
        mesh = evaluated_triangles(thing, scene)
        full = session.of(scene).full.get(thing.session_uid)
        return measure_job(mesh, full, scene.session_uid, thing.session_uid, scenes.remembered(thing)["full_faces"])


def measure_job(
    mesh: TriangleMesh, full: Reconstruction | None, scene: int, thing: int, full_faces: int
) -> Steps[jobs.Conclusion]:
    """Measure, and compare with the full surface where that is known."""
    found = yield from within(measures_steps(mesh), 0.0, 0.4)
    close = None
    if full is not None and len(mesh.faces) < full_faces:
        close = yield from within(closeness_steps(mesh, full.mesh), 0.4, 1.0)
    result = measure.Result(found, full_faces, close)

    def conclude() -> str:
        where = session.scene_of(scene)
        if where is not None:
            session.of(where).results[thing] = result
        return say("Measured")

    return conclude


class CTMC_OT_deviation_map(jobs.LongOperator, bpy.types.Operator):
    """Colour the active surface by its distance to the full one."""

    bl_idname = "ctmc.deviation_map"
    bl_label = "Deviation Map"
    bl_description = (
        "Write each vertex's distance to the full surface [mm] and a colour into the mesh as attributes; "
        "solid view shows them with Color: Attribute"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only where the full surface is known."""
        if not (jobs.idle(cls) and has_surface(cls, context)):
            return False
        thing = context.view_layer.objects.active
        if thing.session_uid not in session.of(context.scene).full:
            cls.poll_message_set("The full surface is not in memory; reconstruct again first")
            return False
        return True

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        """Distances of the object's own vertices."""
        scene, thing = context.scene, context.view_layer.objects.active
        require_changeable(thing)
        full = session.of(scene).full[thing.session_uid]
        own = own_mesh(thing)
        return deviation_job(own, full, thing.session_uid)


def deviation_job(own: TriangleMesh, full: Reconstruction, uid: int) -> Steps[jobs.Conclusion]:
    """Measure every vertex, then write once."""
    trees = Trees(middle_of(full.mesh))
    yield from within(trees.add_steps(full.mesh), 0.0, 0.4)
    found = yield from within(trees.distances_steps(own.vertices.astype("float64")), 0.4, 1.0)

    def conclude() -> str:
        thing = session.object_of(uid)
        if thing is None or len(thing.data.vertices) != len(found):
            raise MeshError("the surface was deleted or changed meanwhile; make the deviation map again")
        require_changeable(thing)
        paint_deviation(thing.data, found)
        return say("{name}: at most {most} mm from the full surface").format(name=thing.name, most=f"{found.max():.3g}")

    return conclude


class CTMC_OT_adopt_settings(bpy.types.Operator):
    """Take the settings of the active surface into the panel."""

    bl_idname = "ctmc.adopt_settings"
    bl_label = "Use Its Settings"
    bl_description = "Take the settings that the active surface was made with into the panel"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only with a surface that remembers."""
        if not surfaces.is_surface(context.view_layer.objects.active):
            cls.poll_message_set("Choose a reconstructed surface first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Take them."""
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
        """Only where a CT is known."""
        if not context.scene.ctmc.volume_path:
            cls.poll_message_set("Load a CT first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Copy it, a line for each surface."""
        try:
            text = command_text(context.scene)
        except CtmcError as error:
            return jobs.refuse(self, context.scene.session_uid, error)
        context.window_manager.clipboard = text
        self.report({"INFO"}, text)
        return {"FINISHED"}


def command_text(scene: bpy.types.Scene) -> str:
    """The command line of every surface the panel asks for."""
    stored, loaded = scene.ctmc, volumes.loaded(scene)
    source = bpy.path.abspath(stored.volume_path)
    reading = loaded.reading if loaded is not None else {}
    name = loaded.volume.name if loaded is not None else Path(source).stem
    lines = []
    for settings in stored.all_settings():
        output = f"{name}.stl" if settings.label is None else f"{name}_label_{settings.label}.stl"
        lines.append(command_line(source, output, settings, reading))
    return "\n".join(lines)


register, unregister = bpy.utils.register_classes_factory(
    (CTMC_OT_measure, CTMC_OT_deviation_map, CTMC_OT_adopt_settings, CTMC_OT_copy_command)
)
