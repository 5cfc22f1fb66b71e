# SPDX-License-Identifier: GPL-3.0-or-later
"""Make flags from the fields of a dataclass that describes itself, and collect their values.

Only flags that are given reach the namespace, so that a settings file may stand below them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from typing import Any

from ...core import Setting, SettingsError, checked, defaults, descriptions
from ...reporting.command_line import flag_of

METAVARS = {"mm": "MM", "mm3": "MM3", "dpi": "N", "degrees": "DEG", "%": "PERCENT", "pt": "PT", "s": "S", "fps": "N"}
"""The placeholder for a value of each unit in the help."""


class Numbers(argparse.Action):
    """A flag with up to `most` numbers, which its type reads as one text; lists of a repeated flag are joined."""

    def __init__(self, *args: Any, most: int, **options: Any) -> None:
        super().__init__(*args, **options)
        self.most = most

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: Any = None) -> None:
        """Keep the value."""
        if isinstance(values, list):
            values = [*getattr(namespace, self.dest, []), *values]
        setattr(namespace, self.dest, values)


def add_described(
    group: Any,
    kind: type,
    default: Mapping[str, Any] | None = None,
    readers: Mapping[str, Callable[[str], Any]] | None = None,
    groups: Mapping[str, Any] | None = None,
) -> None:
    """Add a flag for every described field of a dataclass.

    Parameters
    ----------
    kind : type
        A `Described` dataclass.
    default : mapping, optional
        Defaults that the help names instead of the fields' own.
    readers : mapping, optional
        Functions that read the value of a field from text, instead of `value_reader`.
    groups : mapping, optional
        Groups that fields belong to, instead of `group`.
    """
    own = defaults(kind) | dict(default or {})
    for name, about in descriptions(kind).items():
        add_flag((groups or {}).get(name, group), name, about, own[name], (readers or {}).get(name))


def add_flag(group: Any, name: str, about: Setting, default: Any, reader: Callable[[str], Any] | None = None) -> None:
    """Add one field's flag, its help made from the field's text, unit, limits and default."""
    options: dict[str, Any] = {"dest": name, "default": argparse.SUPPRESS, "help": help_of(about, default)}
    if about.type is bool:
        options["action"] = argparse.BooleanOptionalAction
    elif about.choices:
        options["choices"] = about.choices
    else:
        options.update(metavar=metavar_of(about), type=reader or value_reader(name, about))
        if about.size > 1 and not about.many:
            options.update(action=Numbers, most=about.size)
    if about.many:
        options["nargs"] = "+"
    group.add_argument(flag_of(name, about), **options)


def add_labels_flag(group: Any, name: str, about: Setting, default: Any, reader: Callable[[str], Any]) -> None:
    """Add a field's flag that takes several labels, by number or name."""
    words = (
        f"{help_of(about, default)}; by number or name, several separated by commas or by repeating the flag, or all"
    )
    options = {"dest": name, "default": argparse.SUPPRESS, "metavar": "LABEL", "type": reader, "help": words}
    group.add_argument(flag_of(name, about), action=Numbers, most=sys.maxsize, **options)


def given(args: argparse.Namespace, kind: type) -> dict[str, Any]:
    """Return the values of a dataclass's fields that flags gave, by name."""
    flags = vars(args)
    return {name: flags[name] for name in descriptions(kind) if name in flags}


def value_reader(name: str, about: Setting) -> Callable[[str], Any]:
    """Return a function that reads a field from text, such as '2 2 1', and checks its limits; of many, one of them."""

    def read(text: str) -> Any:
        value: Any = text
        if about.type is not str and text not in about.words:
            numbers = tuple(number_of(word, about) for word in separated(text))
            if len(numbers) != about.size and (len(numbers) != 1 or about.size != 3):
                several = f"write {about.size} numbers separated by spaces"
                raise argparse.ArgumentTypeError(
                    several if about.size > 1 else "write one number, with a decimal point"
                )
            value = numbers if len(numbers) > 1 else numbers * 3 if about.size == 3 else numbers[0]
        try:
            return checked(name, (value,), about)[0] if about.many else checked(name, value, about)
        except SettingsError as error:
            raise argparse.ArgumentTypeError(str(error).removeprefix(f"{name} ")) from error

    return read


def number_of(word: str, about: Setting) -> Any:
    """Return a word as the kind of number that a field has."""
    try:
        return about.type(word)
    except ValueError as error:
        expected = " or ".join(["write a whole number" if about.type is int else "write a number", *about.words])
        raise argparse.ArgumentTypeError(f"{expected}, not {word!r}") from error


def help_of(about: Setting, default: Any) -> str:
    """Return text, choices, unit, limits and default: 'Side of ... (px; from 1 to 16; default 1 1 1)'."""
    facts = [about.unit] if about.unit else []
    if not about.choices and about.is_limited:
        facts.append(about.limits)
    if about.note:
        facts.append(about.note)
    if default is None:
        facts += [f"default: {about.without}"] if about.without else []
    elif about.type is bool:
        facts += ["default yes"] if default else []
    elif default not in ("", ()):
        values = default if isinstance(default, tuple) else (default,)
        facts.append("default " + " ".join(value if isinstance(value, str) else f"{value:g}" for value in values))
    choices = "; ".join(f"{choice} = {text}" for choice, text in about.choice_texts.items())
    text = about.text + (f". {choices}" if choices else "") + (f" ({'; '.join(facts)})" if facts else "")
    return text.replace("%", "%%")


def metavar_of(about: Setting) -> str:
    """Return the name of the value in the help: X Y Z, MM, N, VALUE, or the setting's label."""
    if about.size > 1:
        return {2: "N", 3: "X Y Z", 6: "X0 Y0 Z0 X1 Y1 Z1"}[about.size]
    if about.unit in METAVARS:
        return METAVARS[about.unit]
    return (
        "N" if about.type is int else "VALUE" if "gray value" in about.unit else about.label.partition(" (")[0].upper()
    )


def separated(text: str) -> list[str]:
    """Return the words of a text with spaces, commas or semicolons between them."""
    return text.replace(",", " ").replace(";", " ").split()


def is_number(word: str) -> bool:
    """Return whether a word reads as a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True
