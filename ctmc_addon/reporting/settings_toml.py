# SPDX-License-Identifier: GPL-3.0-or-later
"""Write settings as a TOML text that explains itself, and read them back.

The comments are the settings' own texts, so the file is its own manual. Unset settings are comments.
"""

from __future__ import annotations

import dataclasses
import json
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from ..core import (
    SETTINGS,
    VERSION,
    ReconstructionSettings,
    Setting,
    SettingsError,
    checked,
    defaults,
    descriptions,
    with_present_names,
)

WIDTH = 100
Tables = Mapping[str, Sequence[type]]
"""Names of the tables below the settings, and the described dataclasses whose fields stand in each."""


def to_toml(
    settings: ReconstructionSettings,
    labels: Sequence[int | str] = (),
    tables: Tables | None = None,
    given: Mapping[str, Mapping[str, Any]] | None = None,
) -> str:
    """Return every setting with its text, unit, limits and value, and the tables below.

    Parameters
    ----------
    settings : ReconstructionSettings
    labels : sequence of int or str
        Several labels instead of the settings' label, by number or name.
    tables : mapping of str to sequence of type, optional
    given : mapping of str to mapping, optional
        For a table the values of its fields, by name; what is not given stands as a comment.

    Examples
    --------
    >>> print(to_toml(ReconstructionSettings(label=2)).splitlines()[-2])
    # Value that replaces NaN and infinite voxels (HU or gray value).
    >>> from_toml(to_toml(ReconstructionSettings(label=2)))["label"]
    2
    """
    lines = [f"# Settings of ctmc {VERSION}, read back with --settings FILE.toml. Flags take precedence."]
    for name, about in SETTINGS.items():
        value = _labels_value(labels) if name == "label" and labels else getattr(settings, name)
        lines += ["", *_comment_of(about), _value_line(name, value, about.start)]
    for table, kinds in (tables or {}).items():
        lines += ["", f"[{table}]", *_table_lines(kinds, (given or {}).get(table, {}))]
    return "\n".join(lines) + "\n"


def _table_lines(kinds: Sequence[type], given: Mapping[str, Any]) -> list[str]:
    """Return the lines of a table's fields, those that are not given as comments."""
    lines = []
    for kind in kinds:
        own = defaults(kind)
        for name, about in kept(kind).items():
            example = own[name] if about.start is None else about.start
            lines += [*_comment_of(about), _value_line(name, given.get(name), example), ""]
    return lines[:-1]


def kept(kind: type) -> dict[str, Setting]:
    """Return the descriptions of the fields that a settings file holds."""
    return {name: about for name, about in descriptions(kind).items() if about.kept}


def _labels_value(labels: Sequence[int | str]) -> Any:
    """Return the only label, or all of them."""
    return labels[0] if len(labels) == 1 else tuple(labels)


def _comment_of(about: Setting) -> list[str]:
    """Return text, unit, limits and what holds without a value as lines of comment."""
    facts = [about.unit] if about.unit else []
    if about.choices or about.is_limited:
        facts.append(about.limits)
    if about.without:
        facts.append(f"default: {about.without}")
    text = about.text.rstrip(".") + (f" ({'; '.join(facts)})" if facts else "") + "."
    return textwrap.wrap(text, WIDTH, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False)


def _value_line(name: str, value: Any, example: Any) -> str:
    """Return `name = value`; without a value, an example as a comment."""
    if value is None:
        return f"# {name} = {_toml_value(example)}"
    return f"{name} = {_toml_value(value)}"


def _toml_value(value: Any) -> str:
    """Return a switch, number, word or list of numbers in TOML.

    Examples
    --------
    >>> _toml_value((2, 2, 1)), _toml_value(True), _toml_value("mesh"), _toml_value(1e-7)
    ('[2, 2, 1]', 'true', '"mesh"', '1e-07')
    """
    if isinstance(value, (tuple, list)):
        return "[" + ", ".join(_toml_value(item) for item in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)


def from_toml(text: str, name: str = "the settings file", tables: Tables | None = None) -> dict[str, Any]:
    """Return the settings in a TOML text, by name, and each of the tables as a dictionary.

    Parameters
    ----------
    name : str
        Of the file, for messages.
    tables : mapping of str to sequence of type, optional

    Raises
    ------
    SettingsError
        If it is not TOML, or holds an unknown name, a wrong type or a value outside its limits.
    """
    import tomllib  # takes long to import

    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SettingsError(f"{name} is not TOML: {error}; `ctmc settings` writes one to start from") from error
    try:
        table_values = {table: table_of(table, values.pop(table), kinds) for table, kinds in _in_both(tables, values)}
        values = with_present_names(values)
        for key, value in values.items():
            if key == "label":
                require_labels(value)
            elif key in SETTINGS:
                _require_type(key, value, SETTINGS[key])
        ReconstructionSettings.from_dict(values | ({"label": 1} if "label" in values else {}))
    except SettingsError as error:
        raise SettingsError(f"{name}: {error}") from error
    return values | table_values


def _in_both(tables: Tables | None, values: Mapping[str, Any]) -> list[tuple[str, Sequence[type]]]:
    """Return the tables that the file has."""
    return [(table, kinds) for table, kinds in (tables or {}).items() if table in values]


def table_of(table: str, values: Any, kinds: Sequence[type]) -> dict[str, Any]:
    """Return a table's values, checked.

    Parameters
    ----------
    table : str
        Its name.
    values : Any
        As TOML gives it.
    kinds : sequence of dataclasses
        Whose fields the values are.

    Raises
    ------
    SettingsError
        For an unknown name, or a value outside its limits.
    """
    if not isinstance(values, dict):
        raise SettingsError(f"{table} is a table, [{table}] on a line of its own, not {values!r}")
    described = {name: about for kind in kinds for name, about in kept(kind).items()}
    for key, value in values.items():
        if key not in described:
            raise SettingsError(f"unknown setting {key!r} in [{table}]; its settings are {', '.join(described)}")
        _require_type(key, value, described[key])
    return {key: checked(key, value, described[key]) for key, value in values.items()}


def require_labels(value: Any) -> None:
    """Raise a `SettingsError` for what is not a label's number or name, `all`, or a list of these."""
    items = value if isinstance(value, list) else [value]
    if not items or not all(isinstance(item, (int, str)) and not isinstance(item, bool) for item in items):
        raise SettingsError(f"label must be a whole number, a name in quotes, or a list of these, not {value!r}")


def _require_type(name: str, value: Any, about: Setting) -> None:
    """Raise a `SettingsError` for what Python would convert silently: "false" to true, true to 1."""
    if about.many:
        if not isinstance(value, list):
            raise SettingsError(f"{name} must be a list in brackets, not {value!r}")
        for item in value:
            _require_type(name, item, dataclasses.replace(about, many=False))
        return
    items = value if isinstance(value, list) and about.size > 1 else [value]
    types, expected = {bool: (bool, "true or false"), str: (str, "a word in quotes")}.get(
        about.type, ((int, float), "a number" if about.size == 1 else f"{about.size} numbers in brackets")
    )
    for item in items:
        if isinstance(item, str) and about.words:
            continue  # A wrong word is reported with the limits.
        if not isinstance(item, types) or (isinstance(item, bool) and about.type is not bool):
            raise SettingsError(f"{name} must be {expected}, not {value!r}")
