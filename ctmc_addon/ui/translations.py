"""Our strings in other languages, through `bpy.app.translations`."""

from __future__ import annotations

import bpy


def say(text: str) -> str:
    """The text in the language of Blender's interface."""
    return str(bpy.app.translations.pgettext_iface(text))


def register() -> None:
    """Nothing yet."""


def unregister() -> None:
    """Nothing yet."""
