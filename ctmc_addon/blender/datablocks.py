# SPDX-License-Identifier: GPL-3.0-or-later
"""Remove temporary data-blocks."""

from __future__ import annotations

from collections.abc import Iterable

import bpy


def remove_blocks(*blocks: bpy.types.ID) -> None:
    """Remove data-blocks in the order given; `batch_remove` crashes on a scene that was in context."""
    for block in blocks:
        _collection_of(block).remove(block)


def remove_from_scene(scene: bpy.types.Scene, obj: bpy.types.Object) -> bool:
    """Remove an object; return whether it is gone.

    An object that other scenes show too leaves only the collections of this scene.
    """
    if obj.library is not None:
        return False
    if len(obj.users_scene) <= 1:
        bpy.data.objects.remove(obj)
        return True
    shared = {child for each in bpy.data.scenes if each != scene for child in each.collection.children_recursive}
    for owner in {scene.collection, *scene.collection.children_recursive} - shared:
        if obj.name in owner.objects:
            owner.objects.unlink(obj)
    return False


def remove_with_data(scene: bpy.types.Scene, objects: Iterable[bpy.types.Object]) -> None:
    """Remove objects from a scene, and their data where nothing else uses it."""
    for obj in objects:
        data = obj.data
        if remove_from_scene(scene, obj) and data is not None and not data.users:
            bpy.data.batch_remove([data])


def _collection_of(block: bpy.types.ID) -> bpy.types.bpy_prop_collection:
    collections = {
        bpy.types.Scene: bpy.data.scenes,
        bpy.types.Object: bpy.data.objects,
        bpy.types.Mesh: bpy.data.meshes,
        bpy.types.Camera: bpy.data.cameras,
        bpy.types.Light: bpy.data.lights,
        bpy.types.World: bpy.data.worlds,
        bpy.types.Material: bpy.data.materials,
        bpy.types.Collection: bpy.data.collections,
    }
    return next(collection for kind, collection in collections.items() if isinstance(block, kind))


def render_results() -> frozenset[str]:
    """Return the names of the images in which Blender keeps its last render."""
    return frozenset(image.name for image in bpy.data.images if image.type == "RENDER_RESULT")


def remove_render_results(but: frozenset[str]) -> None:
    """Remove render results, except those with these names, which were there before."""
    for name in render_results() - but:
        bpy.data.images.remove(bpy.data.images[name])
