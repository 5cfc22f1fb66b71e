# SPDX-License-Identifier: GPL-3.0-or-later
"""Show the CT as an object of the scene: an empty as large as its box, in a collection of everything made from it.

Slice and preview are only drawn, so Blender knows nothing of them. Home and View Selected frame the empty.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import bpy
import numpy as np
from numpy.typing import NDArray

from ..datablocks import remove_from_scene

PROPERTY = "ctmc_ct"
"""The empty's custom property: fingerprint and path of its CT."""
FOLDER = "ctmc_folder"
"""The collection's: the folder that its CTs lie in."""


def _is_box(obj: bpy.types.Object) -> bool:
    return obj.type == "EMPTY" and hasattr(obj.get(PROPERTY), "keys")


def fingerprint_of_box(obj: bpy.types.Object | None) -> str:
    """Return the fingerprint of the CT whose box an object is; empty for everything else."""
    return str(obj[PROPERTY].get("fingerprint", "")) if obj is not None and _is_box(obj) else ""


def boxes_in(collection: bpy.types.Collection) -> list[bpy.types.Object]:
    """Return the CTs' boxes in a collection."""
    return [obj for obj in collection.objects if _is_box(obj)]


def boxes_of_scene(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Return the boxes of all CTs in a scene."""
    return [obj for obj in scene.objects if _is_box(obj)]


def box_of(scene: bpy.types.Scene, fingerprint: str, path: str = "") -> bpy.types.Object | None:
    """Return the box of a CT in a scene; with `path`, that of an earlier reading of the same file."""
    boxes = boxes_of_scene(scene)
    same = [obj for obj in boxes if obj[PROPERTY].get("fingerprint") == fingerprint]
    read_before = [obj for obj in boxes if path and obj[PROPERTY].get("path") == path]
    return next(iter(same + read_before), None)


def paths_of_boxes(scene: bpy.types.Scene) -> dict[str, str]:
    """Return the path of each CT that has a box in a scene, by fingerprint."""
    boxes = [obj[PROPERTY] for obj in boxes_of_scene(scene)]
    return {str(box.get("fingerprint", "")): str(box.get("path", "")) for box in boxes}


def remove_box(scene: bpy.types.Scene, fingerprint: str) -> None:
    """Remove the box of a CT from a scene, and its collection if that is empty then."""
    box = box_of(scene, fingerprint)
    if box is None:
        return
    owners = list(box.users_collection)
    if not remove_from_scene(scene, box):
        return
    for owner in owners:
        if FOLDER in owner and not owner.all_objects:
            bpy.data.collections.remove(owner)


def give_box(scene: bpy.types.Scene, fingerprint: str, second: str) -> None:
    """Make the box of a CT that of a second reading of the same path."""
    box = box_of(scene, fingerprint)
    if box is not None and box.library is None:
        box[PROPERTY]["fingerprint"] = second


def objects_beside(scene: bpy.types.Scene, fingerprint: str) -> list[bpy.types.Object]:
    """Return the other objects in the collection of a CT; none if it holds several CTs or is the scene's own."""
    collection = _collection_of_ct(scene, fingerprint)
    if collection == scene.collection or len(boxes_in(collection)) > 1:
        return []
    return [obj for obj in collection.objects if not _is_box(obj)]


def noted_paths() -> list[tuple[str, Callable[[str], None]]]:
    """Return the paths that boxes and their collections store, each with a function that stores another."""
    boxes = [obj[PROPERTY] for obj in bpy.data.objects if _is_box(obj) and obj.library is None]
    notes = [(str(box.get("path", "")), partial(box.__setitem__, "path")) for box in boxes]
    folders = [owner for owner in bpy.data.collections if FOLDER in owner and owner.library is None]
    return notes + [(str(owner[FOLDER]), partial(owner.__setitem__, FOLDER)) for owner in folders]


def show_box(
    scene: bpy.types.Scene,
    corners: NDArray[np.float64],
    name: str,
    fingerprint: str,
    path: str,
    folder: tuple[str, str],
) -> tuple[bpy.types.Object, bool]:
    """Return the box of a CT, added or moved to its position, and whether it is new.

    Parameters
    ----------
    corners : (8, 3) float64
        Corners of the volume, Blender units.
    name : str
        Name of the CT.
    folder : (path, name)
        Folder of the CT: its collection is found by the path and has the name.
    """
    obj = box_of(scene, fingerprint, path)
    is_new = obj is None
    if obj is None:
        obj = bpy.data.objects.new(name, None)
        obj.empty_display_type, obj.empty_display_size = "CUBE", 1.0
        _collection_for(scene, *folder).objects.link(obj)
    low, high = corners.min(axis=0), corners.max(axis=0)
    obj.location, obj.scale = (low + high) / 2, (high - low) / 2
    obj[PROPERTY] = {"fingerprint": fingerprint, "path": path}
    return obj, is_new


def _collection_for(scene: bpy.types.Scene, folder: str, name: str) -> bpy.types.Collection:
    """Return the collection of a patient's folder in a scene; make it if needed."""
    for collection in scene.collection.children_recursive:
        if collection.get(FOLDER) == folder:
            return collection
    collection = bpy.data.collections.new(name)
    collection[FOLDER] = folder
    scene.collection.children.link(collection)
    return collection


def _collection_of_ct(scene: bpy.types.Scene, fingerprint: str) -> bpy.types.Collection:
    """Return the collection of a CT's objects: that of its box, else the scene's own."""
    box = box_of(scene, fingerprint) if fingerprint else None
    inside = {collection.session_uid for collection in scene.collection.children_recursive}
    owners = [] if box is None else [owner for owner in box.users_collection if owner.session_uid in inside]
    return next(iter(owners), scene.collection)


def link_beside_ct(scene: bpy.types.Scene, obj: bpy.types.Object, fingerprint: str) -> None:
    """Link a new object made from a CT to the scene: a surface, slice, cut, volume or ruler."""
    _collection_of_ct(scene, fingerprint).objects.link(obj)
