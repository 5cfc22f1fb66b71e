"""What is known of a scene in this session and never stored in the file: its message, its price, its last results."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import bpy

from ...core import Reconstruction


@dataclass
class Session:
    """One scene's.

    Parameters
    ----------
    message : str
        What went wrong last; stays until something else is done.
    load_message : str
        What was wrong with the last load; stays until the next.
    results : dict of object's session_uid to what was measured
    full : dict of object's session_uid to its surface before simplification
        Of the last run only: the next level of simplification needs no extraction.
    """

    message: str = ""
    load_message: str = ""
    results: dict[int, Any] = field(default_factory=dict)
    full: dict[int, Reconstruction] = field(default_factory=dict)
    price: Any = None
    rotation: Any = None


_sessions: dict[int, Session] = {}


def of(scene: bpy.types.Scene) -> Session:
    """The session of a scene."""
    return _sessions.setdefault(scene.session_uid, Session())


def scene_of(uid: int) -> bpy.types.Scene | None:
    """The scene with this session_uid, if it is still there."""
    return next((scene for scene in bpy.data.scenes if scene.session_uid == uid), None)


def object_of(uid: int | None) -> bpy.types.Object | None:
    """The object with this session_uid, if it is still there."""
    return next((thing for thing in bpy.data.objects if thing.session_uid == uid), None)


def redraw_panels() -> None:
    """Draw the sidebars again, and nothing else: a viewport full of triangles is dear."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI":
                        region.tag_redraw()


def redraw_viewports() -> None:
    """Draw the 3D viewports again."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def forget_all(*_: Any) -> None:
    """Another file is loaded: nothing of this one counts any more."""
    _sessions.clear()


def register() -> None:
    """Listen for another file."""
    bpy.app.handlers.load_pre.append(bpy.app.handlers.persistent(forget_all))


def unregister() -> None:
    """Forget everything."""
    bpy.app.handlers.load_pre.remove(forget_all)
    _sessions.clear()
