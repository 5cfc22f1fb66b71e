"""Take a surface to another number of triangles, and make it final: `ctmc.simplify`, `ctmc.make_final`."""

from __future__ import annotations

from dataclasses import replace

import bpy

from ... import blender as scenes
from ...blender.surface import read_back, require_changeable, settings_of
from ...core import (
    GOALS,
    CtmcError,
    MeshError,
    Reconstruction,
    ReconstructionSettings,
    Steps,
    Volume,
    full_steps,
    simplified_steps,
    within,
)
from .. import jobs
from ..properties.preferences import machine
from ..state import session, surfaces, volumes
from ..state.surfaces import Wanted
from ..translations import say
from . import measure
from .reconstruct import PLACED, conclude, has_surface


class CTMC_OT_simplify(jobs.LongOperator, bpy.types.Operator):
    """Bring the active surface to the goal of the panel."""

    bl_idname = "ctmc.simplify"
    bl_label = "Simplify Surface"
    bl_description = (
        "Bring the active surface to the number of triangles or the error set above, starting from the full surface; "
        "nothing is extracted again while that is known"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only with a surface to simplify."""
        return jobs.idle(cls) and has_surface(cls, context)

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        """The active surface, from its full form."""
        scene, thing = context.scene, context.view_layer.objects.active
        require_changeable(thing)
        asked = scene.ctmc.to_settings()
        goal = {name: getattr(asked, name) for name in ("simplifier", *GOALS)}
        settings = replace(settings_of(thing), **goal)
        full = full_of(scene, thing)
        volume = volumes.current(scene)
        if full is None and not surfaces.is_of_ct(thing, scene):
            raise MeshError(
                f"{thing.name} is simplified already and its full surface is not in memory; load its CT again"
            )
        fingerprint = surfaces.fingerprint_of(thing)
        wanted = Wanted(settings, target=thing.session_uid, fingerprint=fingerprint)
        return simplify_job(full, volume, wanted, scene.session_uid)


def full_of(scene: bpy.types.Scene, thing: bpy.types.Object) -> Reconstruction | None:
    """The surface before simplification: of the last run, or as the object itself still has it."""
    kept = session.of(scene).full.get(thing.session_uid)
    if kept is not None and kept.mesh is not None:
        return kept
    return read_back(thing)


def simplify_job(
    full: Reconstruction | None, volume: Volume | None, wanted: Wanted, scene: int
) -> Steps[jobs.Conclusion]:
    """Extract again only where there is no other way; then simplify and measure."""
    if full is None:
        assert volume is not None, "plan asks for one of the two"
        limits = machine()
        extract = full_steps(volume, wanted.settings, limits.threads, limits.memory_limit)
        full = yield from within(extract, 0.0, 0.4)
    full = at_alpha(full, wanted.settings)
    made = yield from within(simplified_steps(full, wanted.settings), 0.4, 0.8)
    result = yield from within(measure.result_steps(made, full), 0.8, PLACED)
    ready = yield from within(surfaces.ready_steps([wanted], [made]), PLACED, 1.0)
    found = full
    return lambda: conclude(scene, [wanted], [found], [made], [result], ready)


def at_alpha(full: Reconstruction, settings: ReconstructionSettings) -> Reconstruction:
    """The full surface at the alpha of the settings: a slider may have moved it since."""
    if full.surface is None or full.settings.alpha == settings.alpha:
        return full
    return replace(full, mesh=full.surface.at(settings.alpha), settings=settings)


class CTMC_OT_make_final(bpy.types.Operator):
    """Bake alpha and modifiers of the active surface."""

    bl_idname = "ctmc.make_final"
    bl_label = "Make Final"
    bl_description = "Bake alpha and every modifier that shows in the viewport into a plain mesh"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only with a surface to bake."""
        return jobs.idle(cls) and has_surface(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Bake it."""
        thing = context.view_layer.objects.active
        try:
            scenes.make_final(thing)
        except CtmcError as error:
            return jobs.refuse(self, context.scene.session_uid, error)
        self.report({"INFO"}, say("{name}: {faces} triangles").format(name=thing.name, faces=len(thing.data.polygons)))
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_simplify, CTMC_OT_make_final))
