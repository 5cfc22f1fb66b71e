# SPDX-License-Identifier: GPL-3.0-or-later
"""Store alpha as a shape key: linear crossings over midpoints (Su and Ma, eq. 5 to 7), moved without extraction."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core import MeshError, Surface
from ...core.mesh import blend
from . import mesh_data as meshes
from .placement import Placement
from .provenance import read_provenance, set_settings

KEY = "alpha"
ANIMATION_SETTINGS = ("action_blend_type", "action_extrapolation", "action_influence", "use_nla")
STRIP_SETTINGS = (
    *("action_frame_start", "action_frame_end", "scale", "repeat", "frame_start_raw", "frame_end_raw"),
    *("blend_type", "extrapolation", "use_auto_blend", "blend_in", "blend_out", "mute", "use_reverse"),
    *("use_sync_length", "use_animated_influence", "use_animated_time", "influence", "strip_time"),
)


def alpha_key(mesh: bpy.types.Mesh) -> bpy.types.ShapeKey | None:
    """Return the key `alpha` of a mesh, or None."""
    return None if mesh.shape_keys is None else mesh.shape_keys.key_blocks.get(KEY)


def add_alpha(obj: bpy.types.Object, surface: Surface, alpha: float, placement: Placement) -> None:
    """Add the key of the linear crossings to an object whose vertices are the midpoints.

    Parameters
    ----------
    obj : bpy.types.Object
    surface : Surface
        Both ends of alpha, RAS+ mm.
    alpha : float
        Value of the key, 0 to 1.
    placement : Placement
    """
    obj.shape_key_add(name="Basis", from_mix=False)
    key = obj.shape_key_add(name=KEY, from_mix=False)
    key.points.foreach_set("co", placement.to_local(surface.linear).ravel())
    key.value = alpha


def set_alpha(obj: bpy.types.Object, alpha: float) -> bool:
    """Move a surface to `alpha` and store it in the settings; return whether anything changed.

    Parameters
    ----------
    obj : bpy.types.Object
    alpha : float
        0 to 1; an animation or driver of the key has the last word.
    """
    provenance = read_provenance(obj)
    key = None if provenance is None else alpha_key(obj.data)
    if provenance is None or key is None:
        return False
    if provenance.settings.alpha == alpha and abs(key.value - alpha) < 1e-6:
        return False
    key.value = alpha
    set_settings(obj, replace(provenance.settings, alpha=alpha))
    return True


def keep_key(old: bpy.types.Key, new: bpy.types.Key, old_alpha: float) -> None:
    """Copy the key to a new mesh.

    Parameters
    ----------
    old : bpy.types.Key
    new : bpy.types.Key
    old_alpha : float
        Alpha of the settings; the key's value is kept only if it differs or is animated.
    """
    before, animation = old.key_blocks.get(KEY), old.animation_data
    if before is not None:
        after = new.key_blocks[KEY]
        after.slider_min, after.slider_max, after.mute = before.slider_min, before.slider_max, before.mute
        if before.value != np.float32(old_alpha) or _is_animated(old):
            after.value = before.value
    if animation is None:
        return
    target = new.animation_data_create()
    target.action = animation.action
    if getattr(animation, "action_slot", None) is not None:
        target.action_slot = animation.action_slot
    _copy_settings(animation, target, ANIMATION_SETTINGS)
    for driver in animation.drivers:
        target.drivers.from_existing(src_driver=driver)
    for track in animation.nla_tracks:
        _copy_track(track, target.nla_tracks.new())


def _copy_track(old: bpy.types.NlaTrack, new: bpy.types.NlaTrack) -> None:
    """Give a new NLA track the strips and settings of another; strips without an action cannot be copied."""
    for strip in old.strips:
        if strip.action is None:
            continue
        copy = new.strips.new(strip.name, int(strip.frame_start), strip.action)
        if getattr(strip, "action_slot", None) is not None:
            copy.action_slot = strip.action_slot
        _copy_settings(strip, copy, STRIP_SETTINGS)
    _copy_settings(old, new, ("name", "mute", "lock", "is_solo"))


def _copy_settings(old: bpy.types.bpy_struct, new: bpy.types.bpy_struct, names: tuple[str, ...]) -> None:
    for name in names:
        setattr(new, name, getattr(old, name))


def require_no_other_keys(obj: bpy.types.Object) -> None:
    """Raise `MeshError` for an object with a user's shape keys, which another surface could not keep."""
    keys = obj.data.shape_keys
    other_keys = (
        []
        if keys is None
        else [key.name for key in keys.key_blocks if key not in (keys.reference_key, alpha_key(obj.data))]
    )
    if other_keys:
        raise MeshError(
            f"{obj.name} has the shape key {other_keys[0]}, which a new surface cannot keep; remove it, "
            "or deselect the object to make a new one"
        )


def _is_animated(keys: bpy.types.Key) -> bool:
    """Return whether an action, a driver or the NLA moves a mesh's keys."""
    animation = keys.animation_data
    if animation is None:
        return False
    return animation.action is not None or len(animation.drivers) > 0 or len(animation.nla_tracks) > 0


def mixed_positions(mesh: bpy.types.Mesh) -> NDArray[np.float32]:
    """Return the vertices moved by the key `alpha`, (V, 3) float32, before any modifier."""
    key = alpha_key(mesh)
    if key is None:
        return meshes.read_positions(mesh)
    count = len(mesh.vertices)
    basis = meshes.read_vectors(mesh.shape_keys.reference_key.points, "co", count)
    return blend(basis, meshes.read_vectors(key.points, "co", count), value_of(key))


def value_of(key: bpy.types.ShapeKey) -> float:
    """Return the value of a shape key as Blender applies it: 0 while it is muted."""
    return 0.0 if key.mute else float(key.value)


def key_state(mesh: bpy.types.Mesh, alpha: float | None = None) -> tuple[list[NDArray[np.float32]], list[float]]:
    """Return positions, (V, 3) float32, and value of every key; the key `alpha` at `alpha` if given.

    Without keys the mesh's own positions and no value.
    """
    if mesh.shape_keys is None:
        return [meshes.read_positions(mesh)], []
    keys = mesh.shape_keys.key_blocks
    values = [alpha if key.name == KEY and alpha is not None else value_of(key) for key in keys]
    return (
        [meshes.read_vectors(key.points, "co", len(mesh.vertices)) for key in keys],
        [float(np.float32(value)) for value in values],
    )
