# SPDX-License-Identifier: GPL-3.0-or-later
"""Make Blender properties from the fields of a dataclass that describes itself: name, text, unit, limits, choices.

As in settings.py, this module must not hold `bpy` itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core import Setting
from .kinds import boolean, choice, decimal, decimals, integer, integers, text
from .limits import highest, lowest

SIGNS = {"degrees": "°"}
"""Units that labels write as a sign."""


def property_of(about: Setting, default: Any, **options: Any) -> Any:
    """Return the Blender property of a field.

    Parameters
    ----------
    about : Setting
    default
        None for an optional field without a switch: 0 or an empty text then means that it is absent.
    **options
        Arguments of Blender's property, `name` included, instead of those made here.
    """
    is_absent = default is None
    label = options.pop("name", about.label)
    description = tooltip(about, is_absent)
    if about.type is bool:
        return boolean(label, description, default=bool(default), **options)
    if about.choices:
        return choice(label, description, **{"items": items_of(about), "default": default, **options})
    if about.type is str:
        return text(label, description, default=default or "", **options)
    is_integer = about.type is int
    limits: dict[str, Any] = {} if is_absent else {"default": default}
    if about.low is not None:
        limits["min"] = 0 if is_absent else int(about.low) if is_integer else lowest(about)
    if about.high is not None:
        limits["max"] = int(about.high) if is_integer else highest(about)
    if not is_integer:
        limits["precision"] = 1 if about.unit == "degrees" else 3
    if about.size > 1:
        return (integers if is_integer else decimals)(label, description, **{"size": about.size, **limits, **options})
    return (integer if is_integer else decimal)(label, description, **limits | options)


def items_of(about: Setting) -> list[tuple[str, str, str]]:
    """Return the choices of a field with their names and explanations."""
    texts = {word: words[0].upper() + words[1:] for word, words in about.choice_texts.items()}
    return [(word, about.choice_labels.get(word, word.title()), texts.get(word, "")) for word in about.choices]


def tooltip(about: Setting, is_absent: bool = False) -> str:
    """Return the field's text with its unit; without a switch, also the value and meaning of its absence."""
    words = f"{about.text} [{about.unit}]" if about.unit else about.text
    if not is_absent or not about.without:
        return words
    return f"{words}. {'Empty' if about.type is str else '0'} = {about.without}"


def with_unit(about: Setting) -> str:
    """Return the field's label with its unit, for numbers whose unit Blender does not show: 'Width [mm]'."""
    return f"{about.label} [{SIGNS.get(about.unit, about.unit)}]" if about.unit else about.label


def as_written(number: float) -> float:
    """Return the number as typed: Blender stores 0.9 in float32, which reads back as 0.89999998."""
    return float(str(np.float32(number)))


def as_typed(value: Any, about: Setting) -> Any:
    """Return the field's number or numbers, word or switch, as typed."""
    if about.type is float:
        typed = tuple(as_written(number) for number in np.atleast_1d(value))
        return typed if about.size > 1 else typed[0]
    return tuple(value) if about.size > 1 else value
