"""Make surfaces from the loaded CT: the operators `ctmc.reconstruct` and `ctmc.update`."""

from __future__ import annotations

import time
from typing import Any

import bpy
from bpy.props import BoolProperty

from ...blender.surface import require_changeable
from ...core import (
    CtmcError,
    LabelError,
    MeshError,
    ReadError,
    Reconstruction,
    SettingsError,
    Steps,
    full_steps,
    simplified_steps,
    within,
)
from .. import jobs
from ..properties.preferences import machine
from ..state import session, surfaces, volumes
from ..state.surfaces import Wanted
from ..viewport import live
from . import measure

PLACED = 0.97  # of the work comes before Blender makes meshes of the surfaces


class CTMC_OT_reconstruct(jobs.LongOperator, bpy.types.Operator):
    """Make a surface from the loaded CT with the settings of the panel."""

    bl_idname = "ctmc.reconstruct"
    bl_label = "Reconstruct Surface"
    bl_description = (
        "Make a surface from the loaded CT with the settings of the panel. "
        "A selected surface of this CT is updated and keeps its place, materials and modifiers"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    new: BoolProperty(
        name="New Object",
        description="Make a new object even if a surface is selected",
        options={"SKIP_SAVE", "HIDDEN"},
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only with a CT in memory, and with memory enough."""
        return jobs.idle(cls) and ready(cls, context)

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        """Every surface the panel asks for."""
        scene = context.scene
        loaded = in_memory(scene)
        runs = scene.ctmc.all_settings()
        into = {} if self.new else surfaces.targets(context, runs)
        names, fingerprint = loaded.volume.label_names, loaded.survey.fingerprint
        wanted = [
            Wanted(run, scene.ctmc.colour_of(run.label), into.get(run), names.get(run.label or 0, ""), fingerprint)
            for run in runs
        ]
        return surfaces_steps(loaded, wanted, scene.session_uid)


class CTMC_OT_update(jobs.LongOperator, bpy.types.Operator):
    """Give the active surface the settings of the panel."""

    bl_idname = "ctmc.update"
    bl_label = "Update Surface"
    bl_description = (
        "Reconstruct the active surface again with the settings of the panel; "
        "it keeps its place, materials and modifiers"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only with a CT in memory and a surface to update."""
        return jobs.idle(cls) and ready(cls, context) and has_surface(cls, context)

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        """The active surface, anew."""
        scene, thing = context.scene, context.view_layer.objects.active
        loaded = in_memory(scene)
        require_changeable(thing)
        fingerprint = loaded.survey.fingerprint
        wanted = Wanted(scene.ctmc.to_settings(), target=thing.session_uid, fingerprint=fingerprint)
        return surfaces_steps(loaded, [wanted], scene.session_uid)


def ready(operator: Any, context: bpy.types.Context) -> bool:
    """Whether there is a CT in memory and memory enough, with the reason if not."""
    scene = context.scene
    if not volumes.has_volume(operator, context):
        return False
    price = session.of(scene).price
    if isinstance(price, CtmcError):  # the settings as they are give no surface
        operator.poll_message_set(str(price))
        return False
    if isinstance(price, live.Bill) and not price.fits and list(price.settings) == settings_or_none(scene):
        operator.poll_message_set(price.sentence)
        return False
    return True


def has_surface(operator: Any, context: bpy.types.Context) -> bool:
    """Whether the active object is a surface that can be changed, with the reason if not."""
    thing = context.view_layer.objects.active
    if not surfaces.is_surface(thing):
        operator.poll_message_set("Choose a reconstructed surface first")
        return False
    try:
        require_changeable(thing)
    except MeshError as error:
        operator.poll_message_set(str(error))
        return False
    return True


def settings_or_none(scene: bpy.types.Scene) -> Any:
    """The settings of every surface wanted; None while they contradict each other."""
    try:
        return scene.ctmc.all_settings()
    except SettingsError:
        return None


def in_memory(scene: bpy.types.Scene) -> volumes.Loaded:
    """The CT of the scene, or a `ReadError`."""
    loaded = volumes.loaded(scene)
    if loaded is None:
        raise ReadError("the CT is not in memory; load it first")
    return loaded


def surfaces_steps(loaded: volumes.Loaded, wanted: list[Wanted], scene: int) -> Steps[jobs.Conclusion]:
    """Make all of them, then put them into the scene at once."""
    volume, limits = loaded.volume, machine()
    full: list[Reconstruction] = []
    seconds = 0.0  # after the last stages
    made: list[Reconstruction] = []
    measures: list[measure.Result] = []
    for number, one in enumerate(wanted):
        require_labels(loaded, one.settings.label)
        low, share = PLACED * number / len(wanted), PLACED / len(wanted)
        work = full_steps(volume, one.settings, limits.threads, limits.memory_limit)
        full.append((yield from within(work, low, low + 0.5 * share)))
        made.append((yield from within(simplified_steps(full[-1], one.settings), low + 0.5 * share, low + 0.8 * share)))
        start = time.perf_counter()
        measured = measure.result_steps(made[-1], full[-1])
        measures.append((yield from within(measured, low + 0.8 * share, low + share)))
        seconds += time.perf_counter() - start
    start = time.perf_counter()
    ready = yield from within(surfaces.ready_steps(wanted, made), PLACED, 1.0)
    seconds += time.perf_counter() - start

    def end() -> str:
        start = time.perf_counter()
        said = conclude(scene, wanted, full, made, measures, ready)
        live.learn(scene, made, seconds + time.perf_counter() - start)
        return said

    return end


def conclude(
    scene: int,
    wanted: list[Wanted],
    full: list[Reconstruction],
    made: list[Reconstruction],
    measures: list[measure.Result],
    ready: list[surfaces.Ready],
) -> str:
    """Objects for all of them, and what is known of them for the panel."""
    things = surfaces.place(scene, wanted, made, ready)
    where = session.scene_of(scene)
    assert where is not None, "place has put something into it"
    known = session.of(where)
    known.message = ""
    live.hide()
    known.full = {thing.session_uid: one for thing, one in zip(things, full, strict=True)}
    known.results |= {thing.session_uid: one for thing, one in zip(things, measures, strict=True)}
    return surfaces.summary(things, made)


def require_labels(loaded: volumes.Loaded, label: int | None) -> None:
    """Raise `LabelError` if a label is asked of Hounsfield units."""
    if label is not None and loaded.volume.kind == "HU":
        raise LabelError(
            f"{loaded.path.name} holds HU, in which {label} is a density and no label; load the label volume"
        )


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_reconstruct, CTMC_OT_update))
