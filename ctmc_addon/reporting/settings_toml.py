# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings as a TOML text that explains itself, and back.

The comments are the settings' own texts, so the file is its own manual. What is not set stands as a comment.
"""

from __future__ import annotations

import json
import textwrap
import tomllib
from collections.abc import Sequence
from typing import Any

from ..core import VERSION, ReconstructionSettings, Setting, SettingsError, described, with_present_names

WIDTH = 100


def to_toml(settings: ReconstructionSettings, labels: Sequence[int | str] = ()) -> str:
    """Return every setting with its text, unit, limits and value; in place of its label several, by number or name.

    Examples
    --------
    >>> print(to_toml(ReconstructionSettings(label=2)).splitlines()[-2])
    # Value that replaces NaN and infinite voxels (HU or gray value).
    >>> from_toml(to_toml(ReconstructionSettings(label=2)))["label"]
    2
    """
    lines = [f"# Settings of ctmc {VERSION}, read back with --settings FILE.toml. Flags given beside it win."]
    for name, about in described().items():
        value = labels_value(labels) if name == "label" and labels else getattr(settings, name)
        lines += ["", *comment_of(about), value_line(name, value, about)]
    return "\n".join(lines) + "\n"


def labels_value(labels: Sequence[int | str]) -> Any:
    """Return the only label, or all of them."""
    return labels[0] if len(labels) == 1 else tuple(labels)


def comment_of(about: Setting) -> list[str]:
    """Return text, unit and limits as lines of comment."""
    facts = [about.unit] if about.unit else []
    if about.choices or about.low is not None or about.high is not None:
        facts.append(about.limits)
    text = about.text.rstrip(".") + (f" ({'; '.join(facts)})" if facts else "") + "."
    return textwrap.wrap(text, WIDTH, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False)


def value_line(name: str, value: Any, about: Setting) -> str:
    """Return `name = value`; where there is no value, an example as a comment."""
    if value is None:
        return f"# {name} = {toml_value(about.start)}"
    return f"{name} = {toml_value(value)}"


def toml_value(value: Any) -> str:
    """Return a switch, number, word or list of numbers in TOML.

    Examples
    --------
    >>> toml_value((2, 2, 1)), toml_value(True), toml_value("mesh"), toml_value(1e-7)
    ('[2, 2, 1]', 'true', '"mesh"', '1e-07')
    """
    if isinstance(value, tuple):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)


def from_toml(text: str, name: str = "the settings file") -> dict[str, Any]:
    """Return the settings in a TOML text, by name.

    Parameters
    ----------
    name : str
        Of the file, for messages.

    Raises
    ------
    SettingsError
        If it is not TOML, or holds an unknown name, a wrong type or a value outside its limits.
    """
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SettingsError(f"{name} is not TOML: {error}; `ctmc settings` writes one to start from") from error
    try:
        values = with_present_names(values)
        for key, value in values.items():
            require_labels(value) if key == "label" else require_type(key, value)
        ReconstructionSettings.from_dict(values | ({"label": 1} if "label" in values else {}))
    except SettingsError as error:
        raise SettingsError(f"{name}: {error}") from error
    return values


def require_labels(value: Any) -> None:
    """Raise a `SettingsError` for what is not a label's number or name, `all`, or a list of these."""
    items = value if isinstance(value, list) else [value]
    if not items or not all(isinstance(item, (int, str)) and not isinstance(item, bool) for item in items):
        raise SettingsError(f"label must be a whole number, a name in quotes, or a list of these, not {value!r}")


def require_type(name: str, value: Any) -> None:
    """Raise a `SettingsError` for what Python would convert silently: "false" to true, true to 1."""
    about = described().get(name)
    if about is None:
        return  # refused by name later
    items = value if isinstance(value, list) and about.size > 1 else [value]
    types, expected = {bool: (bool, "true or false"), str: (str, "a word in quotes")}.get(
        about.type, ((int, float), "a number" if about.size == 1 else f"{about.size} numbers in brackets")
    )
    for item in items:
        if not isinstance(item, types) or (isinstance(item, bool) and about.type is not bool):
            raise SettingsError(f"{name} must be {expected}, not {value!r}")
