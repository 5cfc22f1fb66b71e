# SPDX-License-Identifier: GPL-3.0-or-later
"""Make surfaces from the loaded CT: the operator `ctmc.reconstruct`, and work that Simplify shares with it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import bpy
from bpy.props import BoolProperty

from ....core import (
    CtmcError,
    MadeSurface,
    Reconstruction,
    ReconstructionSettings,
    SettingsError,
    Stages,
    Steps,
    SurfaceRequest,
    TriangleMesh,
    Volume,
    make_surfaces_steps,
    side_by_side_steps,
)
from ....core.mesh import Topology, topology_steps
from ....core.volume import require_labels
from ... import jobs
from ...properties.preferences import machine
from ...properties.surface.structures import called, chosen_opacity
from ...state import session
from ...state.ct import volumes
from ...state.draw import drawings
from ...state.results import surfaces
from ...state.results.measurements import Measurement, measurement_steps
from ...state.surface import cost_estimates, solids, structures
from ...translations import translate, translate_sentence
from ...viewport.surface import preview
from . import placing
from .placing import MeasuredSurface, NewMesh, ObjectRequest
from .solid import SolidParts

JOB_STAGES = {"Reconstructing": 80, "Measuring": 17, "Adding the surface": 3}


def _is_possible(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether the cost estimate found a surface that fits into memory, with the reason if not."""
    cost = cost_estimates.of_scene(context.scene)
    if cost is not None and cost.refusal and list(cost.settings) == _settings_or_none(context.scene):
        operator.poll_message_set(translate_sentence(cost.refusal))
        return False
    return True


def _settings_or_none(scene: bpy.types.Scene) -> list[ReconstructionSettings] | None:
    """Return the settings of every surface of the panel; None if they contradict each other."""
    try:
        return solids.counted_runs(scene)
    except SettingsError:
        return None


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

    needs = (jobs.idle, volumes.has_volume, _is_possible)

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        scene = context.scene
        loaded = volumes.require_loaded(scene)
        solid = solids.solid_of(scene)
        runs = solids.runs_of(scene, solid)
        parts = surfaces.part_targets(context) if solid and not self.new else {}
        targets = {} if self.new or solid else surfaces.targets(context, runs)
        fingerprint, kind = loaded.statistics.fingerprint, loaded.volume.kind
        volume_name = scene.ctmc.volume_name.strip()
        name = volumes.called(scene)
        labels = None
        for run in runs:
            if run.label is not None:
                labels = structures.require_volume_of(scene, run)
                require_labels(labels)
        items = [scene.ctmc.structure_of(run) for run in runs]
        has_neighbors = len(runs) > 1 or any(surfaces.is_of_ct(obj, scene) for obj in scene.objects)
        requests = [
            ObjectRequest(
                run,
                None if item is None else tuple(item.color),
                targets.get(run),
                scene.ctmc.name_of(run.label) if run.label is not None else "" if item is None else called(item),
                fingerprint,
                kind,
                volume_name,
                chosen_opacity(item) if has_neighbors else None,
                drawings.hash_of(scene, item),
            )
            for run, item in zip(runs, items, strict=True)
        ]
        volume = replace(loaded.full, name=name)
        if solid:
            labels = structures.named_labels(scene)
        labels = None if labels is None else replace(labels, name=name)
        return surfaces_steps(
            volume, requests, scene.session_uid, labels=labels, solid=SolidParts(solid, parts) if solid else None
        )


def surfaces_steps(
    volume: Volume | None,
    requests: Sequence[ObjectRequest],
    scene_uid: int,
    full: Reconstruction | None = None,
    *,
    labels: Volume | None = None,
    solid: SolidParts | None = None,
) -> Steps[jobs.Conclusion]:
    """Make all surfaces, or the parts of a `solid`, then put them into the scene at once; `full` replaces extraction.

    Surfaces of labels are made from `labels` if these are not in the volume itself.
    """
    begun = time.perf_counter()
    stages = Stages(JOB_STAGES)
    reconstructing, measuring, adding = JOB_STAGES
    budget = machine().budget
    outcomes: Sequence[MadeSurface | CtmcError]
    left_out: Sequence[str] = ()
    if solid is not None:
        assert volume is not None, "a solid is made from a CT"
        parts, left_out = yield from stages.run(reconstructing, solid.parts_steps(volume, requests, budget, labels))
        requests, outcomes = solid.requests_of(parts, requests), [MadeSurface(part) for part in parts]
    else:
        surface_requests = [SurfaceRequest(request.settings, needs_full=True, full=full) for request in requests]
        making = make_surfaces_steps(volume, surface_requests, budget, labels=labels, all_needed=True)
        outcomes = yield from stages.run(reconstructing, making)
    finished = yield from stages.run(measuring, measured_steps(requests, outcomes, budget.thread_count))
    meshes = yield from stages.run(adding, placing.mesh_steps(finished))

    def conclude() -> str:
        start = time.perf_counter()
        if solid is not None:
            cost_estimates.learn_solid(scene_uid, [surface.result for surface in finished])
        message = _add_to_scene(scene_uid, finished, meshes, left_out)
        end = time.perf_counter()
        if full is None and solid is None:  # Only then were these surfaces extracted, and nothing else done.
            cost_estimates.learn(
                scene_uid,
                [surface.result for surface in finished],
                measuring=stages.seconds[measuring],
                adding=stages.seconds[adding] + end - start,
                seconds=end - begun,
            )
        return message

    return conclude


def measured_steps(
    requests: Sequence[ObjectRequest], outcomes: Sequence[MadeSurface | CtmcError], threads: int
) -> Steps[list[MeasuredSurface]]:
    """Measure surfaces, several at a time; no Blender data is used, so threads may do this."""

    def work_steps(request: ObjectRequest, surface: MadeSurface) -> Steps[MeasuredSurface]:
        result, full = surface
        # Beside labels that share interfaces, pairs of two labels count for both; here the surface's own are shown.
        crossings = result.self_intersections if result.beyond is None else None
        measuring = _with_topology_steps(result, None if full is None else full.mesh, crossings)
        measurement, topology = yield from measuring
        if full is not None and full.mesh.faces is result.mesh.faces:
            full = replace(full, components=topology.components)
        return MeasuredSurface(request, full, result, measurement, topology)

    new_surfaces = [surface for surface in outcomes if isinstance(surface, MadeSurface)]
    pairs = list(zip(requests, new_surfaces, strict=True))
    weights = [1.0 + len(surface.result.mesh.faces) for surface in new_surfaces]
    return (yield from side_by_side_steps([partial(work_steps, *pair) for pair in pairs], weights, threads))


def _with_topology_steps(
    result: Reconstruction, full: TriangleMesh | None, crossings: int | None
) -> Steps[tuple[Measurement, Topology]]:
    """Measure a surface; its topology is found once, for the measures, Blender and Remove Small Components."""
    mesh = result.mesh
    topology = yield from topology_steps(mesh.faces, len(mesh.vertices))
    return (yield from measurement_steps(mesh, full, crossings, topology, result.printing)), topology


def _add_to_scene(
    scene_uid: int, finished: Sequence[MeasuredSurface], meshes: Sequence[NewMesh], left_out: Sequence[str]
) -> str:
    """Add objects for all surfaces and keep their full surfaces for the panel; return the message of success.

    The panel keeps the sentences on what was left out.
    """
    objects = placing.place(scene_uid, finished, meshes)
    scene = session.scene_of(scene_uid)
    assert scene is not None, "place has put something into it"
    scene_session = session.of(scene)
    sentences = [translate_sentence(sentence.removesuffix(".")) for sentence in left_out[: placing.MOST_NAMED]]
    if len(left_out) > len(sentences):
        sentences.append(translate("{count} more are left out").format(count=len(left_out) - len(sentences)))
    scene_session.message = ". ".join(sentences)
    scene_session.full = {
        surfaces.origin(surface.request.fingerprint, surface.request.settings, surface.request.part): surface.full
        for surface in finished
        if surface.request.fingerprint and surface.full is not None
    }
    scene_session.full_labels = structures.label_volume(scene)
    preview.hide()
    summary = placing.summary(objects, finished)
    return f"{summary}. {scene_session.message}" if sentences else summary


register, unregister = bpy.utils.register_classes_factory((CTMC_OT_reconstruct,))
