# SPDX-License-Identifier: GPL-3.0-or-later
"""Show a map on an object, or its own materials again.

The material of a map belongs to the object instead of the mesh, so the materials of the mesh stay in place and a linked
copy of the object does not change.
"""

from __future__ import annotations

import bpy

from .colors import paint, unpaint
from .material import MAP, blocks_of, map_material, set_colors
from .stored import StoredMap, change_map, remove_map, stored_map, stored_maps


def show_map(obj: bpy.types.Object, name: str) -> None:
    """Show a map of the object's mesh, by its material and by the colors of Solid shading."""
    stored = stored_map(obj.data, name)
    if stored is None:
        return
    _drop_material(obj)
    material = map_material(stored)
    if not obj.material_slots:
        obj.data.materials.append(None)
    for slot in obj.material_slots:
        if slot.link == "DATA":
            slot.link = "OBJECT"
            slot.material = material
    paint(obj.data, stored)


def hide_map(obj: bpy.types.Object) -> None:
    """Show an object in its own materials."""
    _drop_material(obj)
    if not any(shown_name(user) for user in bpy.data.objects if user.data == obj.data):
        unpaint(obj.data)


def shown_name(obj: bpy.types.Object | None) -> str:
    """Return the name of the map that the material of an object shows; empty for none."""
    material = _map_material_of(obj)
    return "" if material is None else str(material[MAP])


def shown_map(obj: bpy.types.Object | None) -> StoredMap | None:
    """Return the map that an object shows, or None."""
    name = shown_name(obj)
    return stored_map(obj.data, name) if obj is not None and name else None


def recolor_map(obj: bpy.types.Object, stored: StoredMap) -> None:
    """Store the range, ramp and limits of a map, and apply them to all objects of the mesh that show it."""
    change_map(obj.data, stored)
    painted = False
    for user in bpy.data.objects:
        material = _map_material_of(user) if user.data == obj.data else None
        if material is not None and material[MAP] == stored.name:
            set_colors(material, stored)
            painted = True
    if painted:
        paint(obj.data, stored)


def delete_map(obj: bpy.types.Object, name: str) -> None:
    """Remove a map from the mesh of an object, and from all objects that show it."""
    for user in bpy.data.objects:
        if user.data == obj.data and shown_name(user) == name:
            hide_map(user)
    remove_map(obj.data, name)


def drop_missing(obj: bpy.types.Object) -> None:
    """Show an object in its own materials if its new mesh lacks the shown map."""
    if shown_name(obj) and shown_map(obj) is None:
        hide_map(obj)


def forget_maps(obj: bpy.types.Object) -> None:
    """Remove all maps of an object whose surface has changed."""
    for stored in stored_maps(obj.data):
        delete_map(obj, stored.name)
    drop_missing(obj)


def _map_material_of(obj: bpy.types.Object | None) -> bpy.types.Material | None:
    if obj is None or obj.type != "MESH":
        return None
    slots = (slot.material for slot in obj.material_slots if slot.link == "OBJECT")
    return next((material for material in slots if material is not None and MAP in material), None)


def _drop_material(obj: bpy.types.Object) -> None:
    """Return the slots of a map to the mesh, and remove a material without users."""
    dropped = set()
    for slot in obj.material_slots:
        if slot.link == "OBJECT" and slot.material is not None and MAP in slot.material:
            dropped.add(slot.material)
            slot.material = None
            slot.link = "DATA"
    for material in dropped:
        if not material.users:
            bpy.data.batch_remove(blocks_of(material))
