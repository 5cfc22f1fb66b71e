# SPDX-License-Identifier: GPL-3.0-or-later
"""Make surfaces from the loaded CT: the operator `ctmc.reconstruct`, and the work that Simplify shares with it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import bpy
from bpy.props import BoolProperty

from ....core import (
    Budget,
    CtmcError,
    Reconstruction,
    ReconstructionSettings,
    SettingsError,
    Stages,
    Steps,
    Volume,
    advised_steps,
    each_label_steps,
    equal_part,
    result_and_full_steps,
    shared_surfaces_steps,
    simplified_steps,
    without_small_steps,
)
from ....core.volume import require_labels
from ... import jobs
from ...properties.preferences import machine
from ...properties.structures import called, chosen_opacity
from ...state import cost_estimates, drawings, session, structures, surfaces, volumes
from ...state.measurements import measurement_steps
from ...translations import translate_sentence
from ...viewport import preview
from . import placing
from .placing import FinishedSurface, NewMesh, SurfaceRequest

SURFACE_STAGES = {"Reconstructing": 80, "Measuring": 17}
JOB_STAGES = {"Reconstructing": 97, "Adding the surface": 3}


def is_possible(operator: Any, context: bpy.types.Context) -> bool:
    """Whether the cost estimate of these settings has found a surface that fits into memory, with the reason if not."""
    cost = session.of(context.scene).cost
    if cost is not None and cost.refusal and list(cost.settings) == settings_or_none(context.scene):
        operator.poll_message_set(translate_sentence(cost.refusal))
        return False
    return True


def settings_or_none(scene: bpy.types.Scene) -> list[ReconstructionSettings] | None:
    """Return the settings of every surface of the panel; None while they contradict each other."""
    try:
        settings: list[ReconstructionSettings] = scene.ctmc.all_settings()
    except SettingsError:
        return None
    return settings


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

    needs = (jobs.idle, volumes.has_volume, is_possible)

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        """Return every surface the panel asks for."""
        scene = context.scene
        loaded = volumes.require_loaded(scene)
        runs = scene.ctmc.all_settings()
        targets = {} if self.new else surfaces.targets(context, runs)
        fingerprint, kind = loaded.statistics.fingerprint, loaded.volume.kind
        volume_name = scene.ctmc.volume_name.strip()
        name = volumes.called(scene)
        labels = None
        for run in runs:
            if run.label is not None:
                labels = structures.require_volume_of(scene, run)
                require_labels(labels)
        items = [scene.ctmc.structure_of(run) for run in runs]
        beside = len(runs) > 1 or any(surfaces.is_of_ct(obj, scene) for obj in scene.objects)
        requests = [
            SurfaceRequest(
                run,
                None if item is None else tuple(item.color),
                targets.get(run),
                scene.ctmc.name_of(run.label) if run.label is not None else "" if item is None else called(item),
                fingerprint,
                kind,
                volume_name,
                chosen_opacity(item) if beside else None,
                drawings.hash_of(scene, item),
            )
            for run, item in zip(runs, items, strict=True)
        ]
        labels = None if labels is None else replace(labels, name=name)
        return surfaces_steps(replace(loaded.full, name=name), requests, scene.session_uid, labels=labels)


def surfaces_steps(
    volume: Volume | None,
    requests: Sequence[SurfaceRequest],
    scene_uid: int,
    full: Reconstruction | None = None,
    *,
    labels: Volume | None = None,
) -> Steps[jobs.Conclusion]:
    """Make all surfaces, then put them into the scene at once; `full` takes the place of extraction.

    Those of labels are made from `labels`, where they are not in the volume itself.
    """
    stages = Stages(JOB_STAGES)
    reconstructing, adding = JOB_STAGES
    if len(requests) == 1:
        [request], budget = requests, machine().budget
        source = volume if request.settings.label is None else labels or volume
        making = surface_steps(source, request, full, budget)
        if full is None and source is not None:
            making = advised_steps(making, source, request.settings, budget)
        finished = [(yield from stages.run(reconstructing, making))]
    else:
        assert volume is not None, "several surfaces are extracted"
        finished = yield from stages.run(reconstructing, structures_steps(volume, labels or volume, requests))
    meshes = yield from stages.run(adding, placing.mesh_steps(finished))

    def conclude() -> str:
        start = time.perf_counter()
        message = add_to_scene(scene_uid, finished, meshes)
        measuring = sum(surface.measuring_seconds for surface in finished)
        seconds = measuring + stages.seconds[adding] + time.perf_counter() - start
        cost_estimates.learn(scene_uid, [surface.result for surface in finished], seconds)
        return message

    return conclude


def structures_steps(
    volume: Volume, labels: Volume, requests: Sequence[SurfaceRequest]
) -> Steps[list[FinishedSurface]]:
    """Make the surfaces of several structures, in their order: labels as one work, each threshold by itself."""
    of_labels = [request for request in requests if request.settings.label is not None]
    works = [(labels, of_labels)] if of_labels else []
    works += [(volume, [request]) for request in requests if request.settings.label is None]
    made: dict[SurfaceRequest, FinishedSurface] = {}
    for number, (source, group) in enumerate(works):
        for surface in (yield from equal_part(labels_steps(source, group), number, len(works))):
            made[surface.request] = surface
    return [made[request] for request in requests]


def labels_steps(volume: Volume, requests: Sequence[SurfaceRequest]) -> Steps[list[FinishedSurface]]:
    """Make the surfaces of several labels: together where they share their interfaces, else side by side."""
    runs = [request.settings for request in requests]
    if len(runs) > 1 and all(run.interfaces == "shared" for run in runs):
        return (yield from shared_steps(volume, requests))

    def work_steps(number: int, budget: Budget) -> Steps[FinishedSurface]:
        return (yield from surface_steps(volume, requests[number], None, budget))

    made = yield from each_label_steps(volume, runs, work_steps, machine().budget)
    finished = []
    for result in made:
        if isinstance(result, CtmcError):
            raise result
        finished.append(result)
    return finished


def shared_steps(volume: Volume, requests: Sequence[SurfaceRequest]) -> Steps[list[FinishedSurface]]:
    """Make surfaces of labels that share their interfaces, and measure each."""
    stages = Stages(SURFACE_STAGES)
    reconstructing, measuring = SURFACE_STAGES
    labels = [request.settings.label for request in requests if request.settings.label is not None]
    making = shared_surfaces_steps(volume, requests[0].settings, labels, machine().budget)
    made = yield from stages.run(reconstructing, making)
    finished = []
    for number, (label, request) in enumerate(zip(labels, requests, strict=True)):
        if label in made.errors:
            raise made.errors[label]
        result, full = made.results[label], made.full[label]
        before = stages.seconds.get(measuring, 0.0)
        measurement = measurement_steps(result.mesh, full.mesh)
        measured = yield from stages.run(measuring, equal_part(measurement, number, len(labels)))
        finished.append(FinishedSurface(request, full, result, measured, stages.seconds[measuring] - before))
    return finished


def surface_steps(
    volume: Volume | None,
    request: SurfaceRequest,
    full: Reconstruction | None,
    budget: Budget,
) -> Steps[FinishedSurface]:
    """Extract a surface where `full` is None, simplify and measure it; Blender is not asked: a thread may do this."""
    stages = Stages(SURFACE_STAGES)
    reconstructing, measuring = SURFACE_STAGES
    if full is not None:
        making = remade_steps(full, request.settings, budget)
    else:
        assert volume is not None, "the caller has one of the two"
        making = result_and_full_steps(volume, request.settings, budget)
    result, full = yield from stages.run(reconstructing, making)
    measuring_steps = measurement_steps(result.mesh, None if full is None else full.mesh, result.self_intersections)
    measurement = yield from stages.run(measuring, measuring_steps)
    return FinishedSurface(request, full, result, measurement, stages.seconds[measuring])


def remade_steps(
    full: Reconstruction, settings: ReconstructionSettings, budget: Budget
) -> Steps[tuple[Reconstruction, Reconstruction | None]]:
    """Return the surface that the settings ask for, of the full one of other settings; and the full one of these."""
    if full.surface is not None and full.settings.alpha != settings.alpha:
        full = replace(
            full, mesh=full.surface.at(settings.alpha_number), settings=settings
        )  # the slider has moved since
    if full.settings.min_part_mm3 < settings.min_part_mm3 or (settings.keep_parts and not full.settings.keep_parts):
        full = yield from without_small_steps(full, settings.min_part_mm3, settings.keep_parts)
    return (yield from simplified_steps(full, settings, budget)), full


def add_to_scene(scene_uid: int, finished: Sequence[FinishedSurface], meshes: Sequence[NewMesh]) -> str:
    """Add objects for all surfaces and keep their full surfaces for the panel; return the message of success."""
    objects = placing.place(scene_uid, finished, meshes)
    scene = session.scene_of(scene_uid)
    assert scene is not None, "place has put something into it"
    scene_session = session.of(scene)
    scene_session.message = ""
    scene_session.full = {
        surfaces.origin(surface.request.fingerprint, surface.request.settings): surface.full
        for surface in finished
        if surface.request.fingerprint and surface.full is not None
    }
    preview.hide()
    return placing.summary(objects, finished)


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_reconstruct,))
