# SPDX-License-Identifier: GPL-3.0-or-later
"""Subscribe to changes of settings. Does not import Blender, so that properties can import it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

DRAWN = "drawn"
"""The event of what was drawn by hand: masks, looks, the structure that is drawn on. It moves no setting."""
COMBINED = "combined"
"""The event of the combinations of the solid, which may name structures that are not ticked."""
RELEASED = "released"
"""The event of a CT that is no longer in memory: whoever holds its samples must let them go."""
Listener = Callable[[Any, str], None]
_listeners: list[Listener] = []


def subscribe(listener: Listener) -> None:
    """Call `listener` at every change from now on, with the scene's settings and the property's name."""
    _listeners.append(listener)


def unsubscribe(listener: Listener) -> None:
    """Stop calling `listener`."""
    if listener in _listeners:
        _listeners.remove(listener)


def notify(properties: Any, name: str) -> None:
    """Tell all listeners that a property of `scene.ctmc` has a new value."""
    for listener in _listeners:
        listener(properties, name)
