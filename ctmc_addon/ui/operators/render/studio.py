# SPDX-License-Identifier: GPL-3.0-or-later
"""Set up camera, lights and engine for the visible surfaces, and render: `ctmc.setup_studio`, `ctmc.render`."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import BoolProperty, StringProperty

from ....blender.figure.spec import ENGINES
from ....blender.scene.background import is_studio_world
from ....blender.scene.engine import engine_here, engine_of, render_plan, set_render_engine
from ....blender.scene.lighting import has_placed_camera, set_up_studio
from ....core import CtmcError
from ....reporting.formatting import duration
from ... import jobs
from ...state.results import surfaces
from ...translations import translate
from ..paths import RELATIVE


def _rendered_surfaces(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Return the surfaces of the scene that a render shows."""
    return [
        obj
        for obj in context.scene.objects
        if surfaces.is_surface(obj) and obj.mode != "EDIT" and not obj.hide_render and obj.visible_get()
    ]


def render_text(context: bpy.types.Context) -> str:
    """Return the settings of F12 as text: 'Cycles, 24 samples, 1920 x 1080, about 40 s'."""
    plan = render_plan(context.scene, sum(len(obj.data.polygons) for obj in _rendered_surfaces(context)))
    label = ENGINES[plan.engine].label if plan.engine else context.scene.render.engine
    parts = [label]
    if plan.samples:
        parts.append(translate("{count} samples").format(count=plan.samples))
    parts.append("{} x {}".format(*plan.size))
    if plan.seconds is not None:
        parts.append(translate("about {time}").format(time=duration(plan.seconds)))
    return ", ".join(parts)


def _set_engine(context: bpy.types.Context) -> str:
    """Set the engine of the panel in the scene; return a sentence if it had to be another one."""
    figure = context.scene.ctmc_figure
    requested = figure.engine
    figure.engine = engine_here(requested)
    set_render_engine(context.scene, figure.engine)
    if figure.engine == requested:
        return ""
    text = translate("{engine} would take minutes without a graphics card")
    return ". " + text.format(engine=ENGINES[requested].label)


def _has_surface(operator: type[bpy.types.Operator], context: bpy.types.Context) -> bool:
    """Return whether there is a surface to render, with the reason if not."""
    if not _rendered_surfaces(context):
        operator.poll_message_set("Show or reconstruct a surface first")
        return False
    return True


class CTMC_OT_setup_studio(bpy.types.Operator):
    """Add camera, lights and background, and set the engine."""

    bl_idname = "ctmc.setup_studio"
    bl_label = "Set Up Camera and Lights"
    bl_description = (
        "Add a camera that frames what is shown, with key, fill and rim lights and the background, in a collection of "
        "their own, CTMC Studio, which may be deleted. Set the engine, with samples for a render of a minute or two"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    keeps_engine: BoolProperty(options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _has_surface(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        panel, background = scene.ctmc_figure, scene.ctmc_studio.background
        try:
            note = "" if self.keeps_engine else _set_engine(context)
            set_up_studio(scene, _rendered_surfaces(context), panel.azimuth, panel.elevation, background)
        except CtmcError as error:
            return jobs.refuse(self, scene.session_uid, error)
        self.report({"INFO"}, f"F12: {render_text(context)}{note}")
        return {"FINISHED"}


class CTMC_OT_render(bpy.types.Operator):
    """Render the scene; set it up first, unless a person has placed the camera."""

    bl_idname = "ctmc.render"
    bl_label = "Render"
    bl_description = (
        "Render what is shown with this engine and background in a window; Esc in it stops. Camera and lights are set "
        "up first, unless you placed them"
    )

    filepath: StringProperty(
        name="File", description="Picture to write. Empty = none", subtype="FILE_PATH", options={"SKIP_SAVE", *RELATIVE}
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if bpy.app.is_job_running("RENDER"):
            cls.poll_message_set("Wait for the current render to end")
            return False
        return _has_surface(cls, context)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        if not self._prepare(context):
            return {"CANCELLED"}
        bpy.ops.render.render("INVOKE_DEFAULT")
        return {"FINISHED"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not self._prepare(context):
            return {"CANCELLED"}
        render = context.scene.render
        before = render.filepath
        try:
            if self.filepath:
                render.filepath = str(Path(bpy.path.abspath(self.filepath)).absolute())
            bpy.ops.render.render(write_still=bool(self.filepath))
        except RuntimeError as error:  # Blender has said why, such as a folder that cannot be written to.
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        finally:
            render.filepath = before
        return {"FINISHED"}

    def _prepare(self, context: bpy.types.Context) -> bool:
        """Set up what is missing in an undo step of its own; return whether the scene can be rendered."""
        scene = context.scene
        if not has_placed_camera(scene):
            keeps_engine = is_studio_world(scene.world) and engine_of(scene) == scene.ctmc_figure.engine
            try:
                done: set[str] = bpy.ops.ctmc.setup_studio("EXEC_DEFAULT", True, keeps_engine=keeps_engine)
            except RuntimeError:  # Set Up has said why.
                return False
            return "FINISHED" in done
        if engine_of(scene) == scene.ctmc_figure.engine:
            return True
        try:
            note = _set_engine(context)
        except CtmcError as error:
            jobs.refuse(self, scene.session_uid, error)
            return False
        bpy.ops.ed.undo_push(message="Set Engine")
        self.report({"INFO"}, render_text(context) + note)
        return True


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_setup_studio, CTMC_OT_render))
