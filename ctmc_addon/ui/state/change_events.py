"""What properties share with the rest of the room: who hears of a change, and the context of translations.

Knows no Blender, so that properties may see it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

OURS = "CTMC"
"""The context that our words are translated in; here, where properties may see it."""
TAB = "CTMC"
"""The tab in the sidebar."""
Listener = Callable[[Any, str], None]
_listeners: list[Listener] = []


def listen(listener: Listener) -> None:
    """Tell `listener` of every change from now on, with the scene's settings and the property's name."""
    _listeners.append(listener)


def forget(listener: Listener) -> None:
    """Tell `listener` nothing any more."""
    if listener in _listeners:
        _listeners.remove(listener)


def changed(properties: Any, name: str) -> None:
    """A property of `scene.ctmc` has a new value."""
    for listener in _listeners:
        listener(properties, name)
