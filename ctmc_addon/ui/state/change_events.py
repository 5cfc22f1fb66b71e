# SPDX-License-Identifier: GPL-3.0-or-later
"""Follow changes: of settings, and of what Blender reports to handlers, such as undo and another file.

This module must not hold `bpy`: properties call it, and where they hold `bpy`, the module `bpy` of Blender 4.2 crashes
when Python ends.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

NAME, COLOR, OPACITY = "label_name", "label_color", "label_opacity"
"""The events of a structure's look in the list."""
DRAWN = "drawn"
"""The event of what was drawn by hand: masks, looks, the structure that is drawn on. It moves no setting."""
COMBINED = "combined"
"""The event of the combinations of the solid, which may name structures that are not ticked."""
RELEASED = "released"
"""The event of a CT that is no longer in memory: whoever holds its samples must let them go."""
Listener = Callable[[Any, str], None]
_listeners: list[Listener] = []


def notify(properties: Any, name: str) -> None:
    """Tell all listeners that a property of `scene.ctmc` has a new value."""
    for listener in _listeners:
        listener(properties, name)


def following(
    listener: Listener | None = None, *, at_end: Callable[[], Any] | None = None, **handlers: Callable[..., None]
) -> tuple[Callable[[], None], Callable[[], None]]:
    """Return `register` and `unregister` of a module that follows changes.

    Parameters
    ----------
    listener : callable, optional
        Called at every change, with the scene's settings and the property's name.
    at_end : callable, optional
        Called last by `unregister`.
    **handlers
        Handlers of `bpy.app.handlers`, by their event.
    """

    def register() -> None:
        import bpy

        if listener is not None:
            _listeners.append(listener)
        for event, handler in handlers.items():
            getattr(bpy.app.handlers, event).append(bpy.app.handlers.persistent(handler))

    def unregister() -> None:
        import bpy

        if listener is not None:
            _listeners.remove(listener)
        for event, handler in handlers.items():
            getattr(bpy.app.handlers, event).remove(handler)
        if at_end is not None:
            at_end()

    return register, unregister
