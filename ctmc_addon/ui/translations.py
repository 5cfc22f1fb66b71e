# SPDX-License-Identifier: GPL-3.0-or-later
"""Translate our strings to German and Simplified Chinese, through `bpy.app.translations`.

The tables are TOML, English on the left. Missing strings are shown in English; `make translations` lists them.
Sentences of errors and notes carry names and numbers: the tables hold them with fields in their place.
"""

from __future__ import annotations

import re
import tomllib
from functools import cache, lru_cache
from pathlib import Path

import bpy

from ..reporting.formatting import capitalized

TABLES = Path(__file__).with_name("languages")
# What Blender has called the languages from 4.2 on.
LOCALES = {"de_DE.toml": ("de_DE", "de"), "zh_HANS.toml": ("zh_HANS", "zh_CN")}
OURS = "CTMC"
"""Our own context: in it, Blender's words for other things do not stand before ours, as "Schneiden" for a slice."""
CONTEXTS = ("*", "Operator", OURS)  # Blender looks up buttons of operators in a context of its own.

FIELD = re.compile(r"(\{\w+\})")
LEAST_WORDS = 8
"""Fewest letters of a template outside of its fields; shorter ones would match any sentence."""


def translate(text: str) -> str:
    """Return the text in the language of Blender's interface."""
    return str(bpy.app.translations.pgettext_iface(text, OURS))


def translate_sentence(text: str) -> str:
    """Return a sentence of an error or a note in the language of Blender's interface, with its names and numbers.

    It begins with a capital unless it begins with a name, such as a file's.
    """
    translated = translate_phrase(text)
    return capitalized(translated) if _begins_with_a_word(text) else translated


def translate_phrase(text: str) -> str:
    """Return a part of a sentence in the language of Blender's interface, with its names and numbers."""
    return _by_template(text, bpy.app.translations.locale)


@lru_cache(256)
def _begins_with_a_word(text: str) -> bool:
    """Return whether a sentence begins with words of ours, and not with a field or with words that are not known."""
    if text in table("de_DE.toml"):
        return True
    template = next((template for pattern, template in templates() if pattern.fullmatch(text)), "{")
    return not template.startswith("{")


@lru_cache(256)
def _by_template(text: str, locale: str) -> str:
    """Return the sentence translated by its template; fields may hold words to translate as well."""
    translated = translate(text)
    if translated != text:
        return translated
    for pattern, template in templates():
        match = pattern.fullmatch(text)
        if match:
            values = {name: _by_template(value, locale) for name, value in match.groupdict().items()}
            return translate(template).format(**values)
    return text


def _part(text: str) -> str:
    """Return a piece of a template as a part of its pattern."""
    return f"(?P<{text[1:-1]}>.+?)" if FIELD.fullmatch(text) else re.escape(text)


@cache
def templates() -> tuple[tuple[re.Pattern[str], str], ...]:
    """Return the English sentences with fields, as pattern and as text, those with most words first."""
    texts = {text for name in LOCALES for text in table(name) if FIELD.search(text)}
    texts = {text for text in texts if len(FIELD.sub("", text)) >= LEAST_WORDS}
    ordered = sorted(texts, key=lambda text: (-len(FIELD.sub("", text)), text))
    return tuple((re.compile("".join(map(_part, FIELD.split(text))), re.DOTALL), text) for text in ordered)


@cache
def table(name: str) -> dict[str, str]:
    """Return the table of one language."""
    return tomllib.loads((TABLES / name).read_text(encoding="utf-8"))


@cache
def catalogue() -> dict[str, dict[tuple[str, str], str]]:
    """Return all languages as Blender takes them: locale, then context and English."""
    languages = {}
    for name, locales in LOCALES.items():
        messages = {(context, text): words for text, words in table(name).items() for context in CONTEXTS}
        languages.update(dict.fromkeys(locales, messages))
    return languages


def register() -> None:
    """Register the tables of all languages with Blender."""
    bpy.app.translations.register(__name__, catalogue())


def unregister() -> None:
    """Unregister them."""
    bpy.app.translations.unregister(__name__)
