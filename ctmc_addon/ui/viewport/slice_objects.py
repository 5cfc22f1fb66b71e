# SPDX-License-Identifier: GPL-3.0-or-later
"""Slices that are moved by hand show the CT where they are, while it is in memory."""

from __future__ import annotations

from typing import Any

import bpy

from ...blender.slices import is_slice, pack_pictures, refresh
from ..properties.preferences import machine
from ..state import volumes


def show(scene: bpy.types.Scene, *, again: bool = False) -> None:
    """Take the pictures of the slices of the scene's CT."""
    ct = volumes.loaded(scene)
    if ct is not None:
        refresh(scene, ct.volume, ct.statistics.fingerprint, machine().scale, again=again)


def after_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Something of the scene has changed: a slice may have moved."""
    moved = (update.id for update in depsgraph.updates if update.is_updated_transform)
    if any(isinstance(block, bpy.types.Object) and is_slice(block) for block in moved):
        show(scene)


def after_undo(scene: bpy.types.Scene, *_: Any) -> None:
    """Places are back as they were, pictures are not."""
    show(scene, again=True)


def before_save(*_: Any) -> None:
    """The .blend takes the pictures."""
    pack_pictures()


HANDLERS = {
    "depsgraph_update_post": after_update,
    "undo_post": after_undo,
    "redo_post": after_undo,
    "save_pre": before_save,
}


def register() -> None:
    """Listen for changes."""
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(bpy.app.handlers.persistent(handler))


def unregister() -> None:
    """Listen no more."""
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
