# SPDX-License-Identifier: GPL-3.0-or-later
"""Our strings in German and Simplified Chinese, through `bpy.app.translations`.

The tables are TOML, English on the left. What is not in them is shown in English, as are sentences of errors and
notes, which carry numbers; `make translations` lists what is missing.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import bpy

TABLES = Path(__file__).with_name("languages")
# What Blender has called the languages from 4.2 on.
LOCALES = {"de_DE.toml": ("de_DE", "de"), "zh_HANS.toml": ("zh_HANS", "zh_CN")}
OURS = "CTMC"
"""Our own context: in it, Blender's words for other things do not stand before ours, as "Schneiden" for a slice."""
CONTEXTS = ("*", "Operator", OURS)  # buttons of operators are looked up in a context of Blender's


def translate(text: str) -> str:
    """The text in the language of Blender's interface."""
    return str(bpy.app.translations.pgettext_iface(text, OURS))


def table(name: str) -> dict[str, str]:
    """One language's table."""
    return tomllib.loads((TABLES / name).read_text(encoding="utf-8"))


def catalogue() -> dict[str, dict[tuple[str, str], str]]:
    """All languages as Blender takes them: locale, then context and English."""
    languages = {}
    for name, locales in LOCALES.items():
        messages = {(context, text): words for text, words in table(name).items() for context in CONTEXTS}
        languages.update(dict.fromkeys(locales, messages))
    return languages


def register() -> None:
    """Hand Blender our tables."""
    bpy.app.translations.register(__name__, catalogue())


def unregister() -> None:
    """Take them back."""
    bpy.app.translations.unregister(__name__)
