# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluate an object as Blender does: keys mixed, modifiers applied, with every triangle where it is shown light."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy

from ...core import MeshError
from .light import light_modifier


@contextmanager
def evaluated_object(
    obj: bpy.types.Object, scene: bpy.types.Scene | None = None
) -> Iterator[tuple[bpy.types.Object, bpy.types.Depsgraph]]:
    """Give the object as evaluated in `scene`, by default in the first that holds it, and its depsgraph.

    Within the block the full surface is evaluated; afterwards the object is shown as before.

    Raises
    ------
    MeshError
        If the object is not a mesh, is in edit mode, in no scene, or is switched off in viewports, so that Blender
        does not evaluate it.
    """
    if obj.type != "MESH":
        raise MeshError(f"{obj.name} is not a mesh; choose a reconstructed object")
    require_object_mode(obj)
    holders = obj.users_scene if scene is None else [scene]
    light = light_modifier(obj)
    if light is not None and not light.show_viewport:
        light = None
    try:
        if light is not None:
            light.show_viewport = False
        layer = next((layer for holder in holders for layer in holder.view_layers if holds(layer, obj)), None)
        if layer is None:
            raise MeshError(f"{obj.name} is in no scene; link it to a collection first")
        evaluated = obj.evaluated_get(layer.depsgraph)
        if not evaluated.is_evaluated:
            raise MeshError(f"{obj.name} is disabled in viewports; switch its monitor icon on first")
        yield evaluated, layer.depsgraph
    finally:
        light = None if light is None else light_modifier(obj)  # The block may have removed it.
        if light is not None:
            light.show_viewport = True


def require_object_mode(obj: bpy.types.Object) -> None:
    """Raise `MeshError` for an object in edit mode, whose mesh has no attributes until that ends."""
    if obj.data.is_editmode:
        raise MeshError(f"{obj.name} is in Edit Mode; leave it first")


def holds(layer: bpy.types.ViewLayer, obj: bpy.types.Object) -> bool:
    """Return whether an object is in a view layer, once both are up to date."""
    layer.update()
    # Not by name: one linked from a file may be called as another of the scene.
    return any(each == obj for each in layer.objects)


def evaluated_copy(
    obj: bpy.types.Object, scene: bpy.types.Scene | None = None
) -> tuple[bpy.types.Mesh, bpy.types.Object]:
    """Return a new plain mesh of the evaluated object, in its local space, and that evaluated object."""
    with evaluated_object(obj, scene) as (evaluated, depsgraph):
        mesh = bpy.data.meshes.new_from_object(evaluated, preserve_all_data_layers=True, depsgraph=depsgraph)
    return mesh, evaluated
