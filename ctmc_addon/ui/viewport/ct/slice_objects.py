# SPDX-License-Identifier: GPL-3.0-or-later
"""Update slices that are moved from the CT in memory; window and level follow the sidebar."""

from __future__ import annotations

from typing import Any

import bpy
from mathutils import Vector

from ....blender.slices import is_slice, pack_pictures, refresh, show_window, slices_of
from ....blender.viewport import show_from
from ...properties.ct.view import window_and_level
from ...properties.preferences import machine
from ...state import change_events, session
from ...state.ct import volumes

STRAIGHT = 0.999  # Smallest cosine that counts as straight.
MATERIAL, PICTURE = "MATERIAL", "TEXTURE"  # Color types of Solid shading.


def show(scene: bpy.types.Scene, *, again: bool = False) -> None:
    """Update the pictures of the slices of the scene's CT."""
    ct = volumes.loaded(scene)
    if ct is not None:
        refresh(scene, ct.volume, ct.statistics.fingerprint, machine().scale, again=again)


def show_from_sides(scene: bpy.types.Scene) -> None:
    """Show in each clipping view of a quad view its first slice, and nothing in front of it."""
    for area in session.viewports():
        for view in area.spaces.active.region_quadviews:
            seen = _first_seen(scene, view) if view.lock_rotation and view.use_clip_planes else None
            if seen is not None:
                show_from(view, seen.matrix_world.translation)


def _first_seen(scene: bpy.types.Scene, view: bpy.types.RegionView3D) -> bpy.types.Object | None:
    """Return the slice of the panel's CT that faces a view and is nearest to its eye; None without one."""
    back = view.view_rotation @ Vector((0.0, 0.0, 1.0))
    planes = slices_of(scene, scene.ctmc.volume_fingerprint)
    facing = [obj for obj in planes if obj.visible_get() and _is_along(obj, back)]
    return max(facing, key=lambda obj: back.dot(obj.matrix_world.translation), default=None)


def _is_along(obj: bpy.types.Object, back: Vector) -> bool:
    """Return whether a slice is seen from straight above."""
    normal = obj.matrix_world.to_3x3() @ obj.data.polygons[0].normal
    return bool(abs(normal.normalized().dot(back)) > STRAIGHT)


def follow(properties: Any, name: str) -> None:
    """Apply the sidebar's window and level to the slices after a setting has changed."""
    if name == "window":
        scene: bpy.types.Scene = properties.id_data
        show_window(scene, properties.volume_fingerprint, *window_and_level(scene.ctmc_view))


def show_pictures() -> None:
    """Show pictures in Solid shading if it shows the colors of materials; objects without one keep their color."""
    for area in session.viewports():
        shading = area.spaces.active.shading
        if shading.color_type == MATERIAL:
            shading.color_type = PICTURE


def _after_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Update the pictures of slices that a change of the scene has moved."""
    moved = (update.id for update in depsgraph.updates if update.is_updated_transform)
    if any(isinstance(block, bpy.types.Object) and is_slice(block) for block in moved):
        show(scene)
        show_from_sides(scene)


def after_undo(scene: bpy.types.Scene, *_: Any) -> None:
    """Update all pictures: undo restores the positions of slices, but not their pictures."""
    bpy.context.view_layer.update()  # Undo does not restore world matrices.
    show(scene, again=True)
    show_from_sides(scene)


def before_save(*_: Any) -> None:
    """Pack the pictures into the .blend that is being saved."""
    pack_pictures()


register, unregister = change_events.following(
    follow, depsgraph_update_post=_after_update, undo_post=after_undo, redo_post=after_undo, save_pre=before_save
)
