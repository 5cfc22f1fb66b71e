"""From finished reconstructions to objects of the scene: new ones, or those that are selected.

Data-blocks are remembered by their session_uid while a job runs: undo, deletion and renaming do no harm then.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import bpy

from ... import blender as scenes
from ...blender.surface import MEMORY, edges_steps, read_provenance, require_changeable
from ...core import MeshError, Reconstruction, ReconstructionSettings, Step, Steps, within
from ..properties.preferences import machine
from ..translations import say
from . import session, volumes

FINGERPRINT = "fingerprint"
"""Where a surface remembers its CT, beside what `scene.surfaces` notes."""


@dataclass(frozen=True)
class Wanted:
    """A surface to make: settings, colour, the object that takes it or None, its label's name, its CT's fingerprint."""

    settings: ReconstructionSettings
    color: tuple[float, float, float] | None = None
    target: int | None = None
    structure: str = ""
    fingerprint: str = ""


def is_surface(thing: bpy.types.Object | None) -> bool:
    """Whether an object was reconstructed by us."""
    return read_provenance(thing) is not None


def active_surface(context: bpy.types.Context) -> bpy.types.Object | None:
    """The active object, if it is selected and was reconstructed by us."""
    thing = context.view_layer.objects.active
    return thing if is_surface(thing) and thing.select_get() else None


def chosen_surfaces(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Every selected object that was reconstructed by us."""
    return [thing for thing in context.view_layer.objects.selected if is_surface(thing)]


def selected_surfaces(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The selected surfaces of the CT in memory, the active one first."""
    active = context.view_layer.objects.active
    found = [thing for thing in context.selected_objects if is_of_ct(thing, context.scene)]
    return sorted(found, key=lambda thing: thing != active)


def is_of_ct(thing: bpy.types.Object | None, scene: bpy.types.Scene) -> bool:
    """Whether a surface was made of the CT in memory: of the same values at the same place, whatever its name."""
    loaded = volumes.loaded(scene)
    return loaded is not None and is_surface(thing) and fingerprint_of(thing) == loaded.survey.fingerprint


def fingerprint_of(thing: bpy.types.Object) -> str:
    """The fingerprint of the CT a surface was made from; empty where that is not known."""
    return str(thing[MEMORY].get(FINGERPRINT, ""))


def targets(context: bpy.types.Context, runs: list[ReconstructionSettings]) -> dict[ReconstructionSettings, int]:
    """Which selected object each of the wanted surfaces goes into; those not in it get a new object.

    A single surface goes into the active one, several into those with the same label.

    Raises
    ------
    MeshError
        If one of the objects cannot be changed.
    """
    selected = selected_surfaces(context)
    if len(runs) == 1:
        found = {runs[0]: selected[0]} if selected[:1] == [active_surface(context)] else {}
    else:
        by_label = {scenes.remembered(thing)["settings"].get("label"): thing for thing in reversed(selected)}
        found = {run: by_label[run.label] for run in runs if run.label in by_label}
    for thing in found.values():
        require_changeable(thing)
    return {run: thing.session_uid for run, thing in found.items()}


@dataclass(frozen=True)
class Ready:
    """A mesh that no object has yet, and the object it was made for; None for a new one."""

    mesh: int
    target: int | None


def ready_steps(wanted: Iterable[Wanted], results: Sequence[Reconstruction]) -> Steps[list[Ready]]:
    """Meshes of finished surfaces, one between two steps; they are gone again if the job is left here.

    Raises
    ------
    MeshError
        If a surface has no triangles, or an object cannot be changed any more.
    """
    made: list[Ready] = []
    whole = False
    try:
        for one, result in zip(wanted, results, strict=True):
            share = len(made) / len(results), (len(made) + 1) / len(results)
            vertices = len(result.mesh.vertices)
            edges = yield from within(edges_steps(result.mesh.faces, vertices), *share)
            thing = session.object_of(one.target)
            if thing is not None:
                require_changeable(thing)
            mesh = scenes.surface_mesh(result, thing, machine().scale, edges)
            made.append(Ready(mesh.session_uid, None if thing is None else one.target))
        yield Step(1.0, "Adding the surface")  # whoever pressed Esc while Blender was busy is heard
        whole = True
        return made
    finally:
        if not whole:
            forget(made)


def forget(ready: Iterable[Ready]) -> None:
    """Remove the meshes that no object has taken."""
    uids = {one.mesh for one in ready}
    for mesh in [mesh for mesh in bpy.data.meshes if mesh.session_uid in uids and mesh.users == 0]:
        bpy.data.meshes.remove(mesh)


def place(
    uid: int, wanted: Iterable[Wanted], results: Iterable[Reconstruction], ready: Sequence[Ready]
) -> list[bpy.types.Object]:
    """Put finished surfaces into the scene and select them; the last one is active.

    Raises
    ------
    MeshError
        If the scene is gone, or an object cannot be changed any more.
    """
    try:
        scene = session.scene_of(uid)
        if scene is None:
            raise MeshError("the scene was deleted meanwhile; reconstruct again in another")
        pairs = [(one, session.object_of(one.target), result) for one, result in zip(wanted, results, strict=True)]
        for _, thing, _ in pairs:
            if thing is not None:
                require_changeable(thing)  # before any of them is touched
        meshes = {mesh.session_uid: mesh for mesh in bpy.data.meshes}
        made = []
        for (one, thing, result), known in zip(pairs, ready, strict=True):
            # Undo may have taken the mesh, and a deleted object its place: then another is made.
            mesh = meshes.get(known.mesh) if known.target == (None if thing is None else one.target) else None
            if thing is None:
                thing = scenes.add_reconstruction(result, scene, machine().scale, one.color, mesh, one.structure)
            else:
                scenes.update_reconstruction(thing, result, mesh)
            thing[MEMORY][FINGERPRINT] = one.fingerprint
            made.append(thing)
    finally:
        forget(ready)
    select(scene, made)
    return made


def select(scene: bpy.types.Scene, things: list[bpy.types.Object]) -> None:
    """Select these and nothing else, where Blender's mode allows it."""
    context = bpy.context
    layer = context.view_layer if context.scene == scene else scene.view_layers[0]
    active = layer.objects.active
    if active is not None and active.mode != "OBJECT":
        return
    layer.update()
    for other in layer.objects:
        other.select_set(False, view_layer=layer)
    for thing in things:
        if layer.objects.get(thing.name) == thing:
            thing.select_set(True, view_layer=layer)
            layer.objects.active = thing


def summary(things: list[bpy.types.Object], results: list[Reconstruction]) -> str:
    """For the report: names and triangles."""
    return ", ".join(
        say("{name}: {faces} triangles").format(name=thing.name, faces=len(result.mesh.faces))
        for thing, result in zip(things, results, strict=True)
    )
