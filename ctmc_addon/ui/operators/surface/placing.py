# SPDX-License-Identifier: GPL-3.0-or-later
"""Put finished surfaces into the scene, as new objects or into the selected ones.

A job refers to data-blocks by their session_uid, so undo, deletion and renaming do no harm.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import bpy

from ....blender.surface import (
    add_reconstruction,
    call,
    require_updatable,
    set_drawn,
    set_part,
    surface_mesh_steps,
    update_reconstruction,
)
from ....core import MeshError, Reconstruction, ReconstructionSettings, Step, Steps, equal_part
from ....core.mesh import Topology
from ....core.volume import ValueKind, surface_name
from ....reporting.formatting import count
from ...properties.preferences import machine
from ...state import session
from ...state.results import measurements
from ...state.results.measurements import Measurement
from ...translations import translate

MOST_NAMED = 3  # A report names at most this many surfaces.


@dataclass(frozen=True)
class ObjectRequest:
    """An object to make or to update, and the settings of its surface.

    Parameters
    ----------
    color : (red, green, blue) or None
        Linear; None takes that of the label.
    target : int or None
        `session_uid` of the object that takes it; None makes a new one.
    structure : str
        Name of the label; empty for a threshold.
    fingerprint, kind : str
        Fingerprint and kind of its CT; without a kind, an updated object keeps its name.
    prefix : str
        Name of the CT in the panel, before the name of the surface.
    opacity : float or None
        Opacity of a new object, 0 to 1; None for an opaque one.
    drawn : str or None
        A hash of the structure's drawing, empty without one; None keeps the object's own.
    part : str
        Name of the part of a solid; empty for a surface as the settings alone make it.
    """

    settings: ReconstructionSettings
    color: tuple[float, float, float] | None = None
    target: int | None = None
    structure: str = ""
    fingerprint: str = ""
    kind: str = ""
    prefix: str = ""
    opacity: float | None = None
    drawn: str | None = None
    part: str = ""


@dataclass(frozen=True)
class MeasuredSurface:
    """A surface before and after simplification with its request, measurement and topology.

    `full` is None where the surface before simplification did not fit in memory.
    """

    request: ObjectRequest
    full: Reconstruction | None
    result: Reconstruction
    measurement: Measurement
    topology: Topology


@dataclass(frozen=True)
class NewMesh:
    """A mesh without an object yet, and the object it was made for; None for a new one."""

    mesh: int
    target: int | None


def mesh_steps(surfaces: Sequence[MeasuredSurface]) -> Steps[list[NewMesh]]:
    """Make the meshes of finished surfaces in small steps; closing the steps removes them.

    Raises
    ------
    MeshError
        If a surface has no triangles, or an object cannot be changed any more.
    """
    meshes: list[NewMesh] = []
    complete = False
    try:
        for number, surface in enumerate(surfaces):
            obj = session.object_of(surface.request.target)
            if obj is not None:
                require_updatable(obj)
            making = surface_mesh_steps(surface.result, obj, machine().scale, surface.topology.edges, light=True)
            block = yield from equal_part(making, number, len(surfaces))
            obj = session.object_of(surface.request.target)
            meshes.append(NewMesh(block.session_uid, None if obj is None else surface.request.target))
        yield Step(1.0, "Adding the surface")  # Esc that was pressed while Blender was busy is handled here.
        complete = True
        return meshes
    finally:
        if not complete:
            _remove_unused(meshes)


def _remove_unused(meshes: Iterable[NewMesh]) -> None:
    """Remove the meshes that no object has taken."""
    uids = {new.mesh for new in meshes}
    for mesh in [mesh for mesh in bpy.data.meshes if mesh.session_uid in uids and mesh.users == 0]:
        bpy.data.meshes.remove(mesh)


def place(scene_uid: int, surfaces: Sequence[MeasuredSurface], meshes: Sequence[NewMesh]) -> list[bpy.types.Object]:
    """Put finished surfaces into the scene, with their measurements, and select them; the last one is active.

    Raises
    ------
    MeshError
        If the scene is gone, or an object cannot be changed any more.
    """
    try:
        scene = session.scene_of(scene_uid)
        if scene is None:
            raise MeshError("the scene was deleted meanwhile; reconstruct again in another")
        targets = [session.object_of(surface.request.target) for surface in surfaces]
        for obj in targets:
            if obj is not None:
                require_updatable(obj)  # Check before any of them is changed.
        blocks = {mesh.session_uid: mesh for mesh in bpy.data.meshes}
        objects = []
        for surface, obj, new in zip(surfaces, targets, meshes, strict=True):
            request, result = surface.request, surface.result
            # Undo may have taken the mesh, and a deleted object its place: then another is made.
            mesh = blocks.get(new.mesh) if new.target == (None if obj is None else request.target) else None
            if obj is None:
                color, name, fingerprint = request.color, name_of(request, result), request.fingerprint
                obj = add_reconstruction(
                    result, scene, machine().scale, color, mesh, name, fingerprint, request.opacity
                )
            else:
                update_reconstruction(obj, result, mesh, request.fingerprint)
                if request.structure or request.kind:
                    call(obj, name_of(request, result))
            if request.drawn is not None:
                set_drawn(obj, request.drawn)
            if request.part:
                set_part(obj, request.part)
            # The measurement is of this alpha and no modifiers; the object may have others.
            state = measurements.plain_state(obj, result.settings.alpha_number)
            measurements.keep(obj, surface.measurement, state)
            objects.append(obj)
    finally:
        _remove_unused(meshes)
    select(scene, objects)
    return objects


def name_of(request: ObjectRequest, result: Reconstruction) -> str:
    """Return the name of a surface: its part or label, else tissue and threshold."""
    if request.part:
        return f"{request.prefix} {request.part}".strip()
    by_values = surface_name(request.kind or ValueKind.GRAY, result.threshold, result.settings.upper)
    return f"{request.prefix} {request.structure or by_values}".strip()


def select(scene: bpy.types.Scene, objects: list[bpy.types.Object]) -> None:
    """Select only these objects, where Blender's mode allows it; the last one is active."""
    context = bpy.context
    layer = context.view_layer if context.scene == scene else scene.view_layers[0]
    active = layer.objects.active
    if active is not None and active.mode != "OBJECT":
        return
    layer.update()
    for each in layer.objects:
        each.select_set(False, view_layer=layer)
    for obj in objects:
        if layer.objects.get(obj.name) == obj:
            obj.select_set(True, view_layer=layer)
            layer.objects.active = obj


def summary(objects: Sequence[bpy.types.Object], surfaces: Sequence[MeasuredSurface]) -> str:
    """Return names and triangles for the report: a line, so the names of few surfaces alone."""
    faces = [len(surface.result.mesh.faces) for surface in surfaces]
    if len(objects) > MOST_NAMED:
        text = translate("{count} surfaces: {faces} triangles; Measure All lists them")
        return text.format(count=count(len(objects)), faces=count(sum(faces)))
    text = translate("{name}: {faces} triangles")
    return ", ".join(
        text.format(name=obj.name, faces=count(number)) for obj, number in zip(objects, faces, strict=True)
    )
