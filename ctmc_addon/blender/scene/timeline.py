# SPDX-License-Identifier: GPL-3.0-or-later
"""Show objects one after the other on the timeline, such as a volume's times."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import bpy

SWITCHES = ("hide_viewport", "hide_render")


@contextmanager
def shown_in_turn(objects: Sequence[bpy.types.Object], frames: Sequence[int], scene: bpy.types.Scene) -> Iterator[None]:
    """Show each object only at its frame within the block, with the scene playing them from frame 1.

    Parameters
    ----------
    objects : sequence of Object
        Without animation of their own, and shown; they are so again after the block.
    frames : sequence of int
        Frame of each object, rising.
    scene : Scene
        Gets its range and its present frame.
    """
    scene.frame_start, scene.frame_end = 1, frames[-1]
    scene.frame_current = frames[0]
    try:
        for obj, frame in zip(objects, frames, strict=True):
            _show_at(obj, frame, frames[-1])
            obj.hide_viewport = obj.hide_render = frame != frames[0]
        yield
    finally:
        for obj in objects:
            action = obj.animation_data.action if obj.animation_data else None
            obj.animation_data_clear()
            obj.hide_viewport = obj.hide_render = False
            if action is not None:
                bpy.data.actions.remove(action)


def _show_at(obj: bpy.types.Object, frame: int, last: int) -> None:
    """Key the object to be hidden at all frames from 1 to `last` but one."""
    hidden = {at: at != frame for at in (1, frame, frame + 1) if at <= last}
    for switch in SWITCHES:
        for at, value in hidden.items():
            setattr(obj, switch, value)
            obj.keyframe_insert(switch, frame=at)
    for curve in _curves_of(obj.animation_data.action):
        for key in curve.keyframe_points:
            key.interpolation = "CONSTANT"
    obj.animation_data.action.name = obj.name


def _curves_of(action: Any) -> list[Any]:
    """Return the curves of an action: since Blender 4.4 in layers, before that its own."""
    if not hasattr(action, "layers"):
        return list(action.fcurves)
    return [
        curve
        for layer in action.layers
        for strip in layer.strips
        for channels in strip.channelbags
        for curve in channels.fcurves
    ]
