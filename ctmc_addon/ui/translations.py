"""Our strings in German and Simplified Chinese, through `bpy.app.translations`.

The tables are TOML, English on the left; sentences of errors and notes, which carry numbers, stay English.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import bpy

from .state.change_events import OURS

TABLES = Path(__file__).with_name("languages")
# What Blender has called the languages from 4.2 on.
LOCALES = {"de_DE.toml": ("de_DE", "de"), "zh_HANS.toml": ("zh_HANS", "zh_CN")}
# Buttons of operators are looked up in a context of Blender's; in our own, Blender's words for other things do not
# stand before ours, such as "Schneiden" (to cut) for a slice.
CONTEXTS = ("*", "Operator", OURS)
CATALOGUE = __name__


def say(text: str) -> str:
    """The text in the language of Blender's interface."""
    return str(bpy.app.translations.pgettext_iface(text, OURS))


def table(name: str) -> dict[str, str]:
    """One language's table."""
    found: dict[str, str] = tomllib.loads((TABLES / name).read_text(encoding="utf-8"))
    return found


def catalogue() -> dict[str, dict[tuple[str, str], str]]:
    """All languages as Blender takes them: locale, then context and English."""
    found = {}
    for name, locales in LOCALES.items():
        messages = {(context, text): said for text, said in table(name).items() for context in CONTEXTS}
        found.update(dict.fromkeys(locales, messages))
    return found


def register() -> None:
    """Teach Blender our words."""
    bpy.app.translations.register(CATALOGUE, catalogue())


def unregister() -> None:
    """Take them back."""
    bpy.app.translations.unregister(CATALOGUE)
