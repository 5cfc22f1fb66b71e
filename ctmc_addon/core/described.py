# SPDX-License-Identifier: GPL-3.0-or-later
"""Frozen dataclasses whose fields describe themselves: settings, reading options, the settings of a figure.

A field's text, limits, unit and choices stand in its `Setting`. Checks, the command line's flags, the sidebar's
properties, settings files and reports are made from it, so that none of them can say something else.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import numbers
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from .errors import SettingsError

AUTO = "auto"
"""A word that stands for a value: the surface decides."""
Kind = TypeVar("Kind", bound="Described")


@dataclass(frozen=True)
class Setting:
    """The description of one field.

    Parameters
    ----------
    text, label : str
        The explanation and the name that a user reads.
    unit : str
    low, high : float, optional
        Limits; the limit itself is refused where `low_open` or `high_open`.
    words : tuple of str
        Words that may stand instead of a number, such as 'auto'.
    choices : tuple of str
    choice_labels, choice_texts : mapping of str to str
        The name and the explanation of a choice, where it needs them.
    size : int
        Number of numbers in the value.
    many : bool
        Whether the value is a tuple of any length, each item as the rest of the description says.
    type : type
        Type of the value, or of each of its numbers. `str` without choices is any text.
    flag : str
        On the command line, without dashes; by default the field's name with dashes.
    note : str
        Addition to the text in the command line's help.
    start : optional
        Value that the panel and the settings file offer for a field that is None by default.
    without : str
        Meaning of None for a field that is None by default, such as 'as the files say'.
    kept : bool
        Whether manifests, settings files and reports hold it; what is not kept is given again each time.
    stage : str
        Stage of a reconstruction that it belongs to.
    caption : callable, optional
        Returns the phrase of a figure's caption for a value that is not the default.
    check : callable, optional
        Returns the value in its type or raises a `SettingsError` instead of the general check.
    """

    text: str
    label: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    words: tuple[str, ...] = ()
    choices: tuple[str, ...] = ()
    choice_labels: Mapping[str, str] = field(default_factory=dict)
    choice_texts: Mapping[str, str] = field(default_factory=dict)
    size: int = 1
    many: bool = False
    type: type = float
    flag: str = ""
    note: str = ""
    low_open: bool = False
    high_open: bool = False
    start: Any = None
    without: str = ""
    kept: bool = True
    stage: str = ""
    caption: Callable[[Any], str] | None = None
    check: Callable[[Any], Any] | None = None

    @property
    def is_limited(self) -> bool:
        """Whether there is a limit below or above."""
        return self.low is not None or self.high is not None

    @property
    def limits(self) -> str:
        """The limits in words, for messages: 'from 0 to 1', '0 or more', 'from 0 to 1 or auto'."""
        return " or ".join([self._limits_of_numbers, *self.words])

    @property
    def _limits_of_numbers(self) -> str:
        if self.choices:
            return "one of " + ", ".join(self.choices)
        if self.type is str:
            return "a text"
        if self.low is None and self.high is None:
            return "a finite number"
        if self.high is None:
            return f"above {self.low:g}" if self.low_open else f"{self.low:g} or more"
        if self.high_open:
            return f"at least {self.low:g} and below {self.high:g}"
        if self.low_open:
            return f"above {self.low:g} and at most {self.high:g}"
        return f"from {self.low:g} to {self.high:g}"


def setting(default: Any, text: str, **fields: Any) -> Any:
    """Return a dataclass field with its `Setting`, of which `fields` are the other fields."""
    return dataclasses.field(default=default, metadata={"setting": Setting(text, **fields)})


def descriptions(kind: type) -> dict[str, Setting]:
    """Return the name and the description of every described field of a dataclass, in their order."""
    fields = dataclasses.fields(kind)
    return {field.name: field.metadata["setting"] for field in fields if "setting" in field.metadata}


def defaults(kind: type) -> dict[str, Any]:
    """Return the default of every described field of a dataclass, by name."""
    return {field.name: field.default for field in dataclasses.fields(kind) if "setting" in field.metadata}


class Described:
    """Base of frozen dataclasses whose fields are made by `setting`: checked when they are made.

    The fields' texts stand at the end of the docstring of a class, for `help`.

    Raises
    ------
    SettingsError
        If a value lies outside its limits.
    """

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        own = {name: item for name, item in vars(cls).items() if isinstance(item, dataclasses.Field)}
        about = {name: item.metadata["setting"] for name, item in own.items() if "setting" in item.metadata}
        if about and cls.__doc__:
            lines = [line for name, field in about.items() for line in (name, f"    {field.text}.")]
            cls.__doc__ = "\n".join([inspect.cleandoc(cls.__doc__), "", "Fields", "------", *lines])

    def __post_init__(self) -> None:
        default = defaults(type(self))
        for name, about in descriptions(type(self)).items():
            value = getattr(self, name)
            if value is None and default[name] is not None:
                raise SettingsError(f"{name} needs a value: {about.limits}")
            object.__setattr__(self, name, checked(name, value, about))

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers, strings and lists for JSON and TOML; fields that are None are left out."""
        values = {name: getattr(self, name) for name in descriptions(type(self))}
        return {name: plain(value) for name, value in values.items() if value is not None}

    @classmethod
    def from_dict(cls: type[Kind], values: Mapping[str, Any]) -> Kind:
        """Return the object of a dictionary as `to_dict` makes it; an unknown name is a `SettingsError`."""
        described = descriptions(cls)
        unknown = sorted(set(values) - set(described))
        if unknown:
            raise SettingsError(f"unknown setting {unknown[0]!r}; the settings are {', '.join(described)}")
        return cls(**values)


def plain(value: Any) -> Any:
    """Return a value with lists instead of tuples."""
    return [plain(item) for item in value] if isinstance(value, tuple) else value


def checked(name: str, value: Any, about: Setting) -> Any:
    """Return the value of the field `name` in its type, None as it is.

    Raises
    ------
    SettingsError
        If it is outside its limits, with the value and the limits.
    """
    if value is None:
        return None
    if about.check is not None:
        return about.check(value)
    if about.many:
        single = dataclasses.replace(about, many=False)
        return tuple(checked(name, item, single) for item in value)
    if about.size > 1:
        if isinstance(value, str) or not isinstance(value, (numbers.Real, Iterable)):
            raise SettingsError(f"{name} takes {about.size} numbers, not {value!r}")
        items = (value,) * about.size if isinstance(value, numbers.Real) else tuple(value)
        if len(items) != about.size:
            raise SettingsError(f"{name} takes {about.size} numbers, not {len(items)}: {value}")
        return tuple(_checked_item(name, item, about) for item in items)
    return _checked_item(name, value, about)


def _checked_item(name: str, value: Any, about: Setting) -> Any:
    """Return one number, word or switch of a setting in its type; raise a `SettingsError` outside its limits."""
    if about.type is str:
        if value not in about.choices if about.choices else not isinstance(value, str):
            raise SettingsError(f"{name} is {about.limits}, not {value!r}")
        return str(value)
    if about.type is bool:
        if isinstance(value, str) or value not in (0, 1):
            raise SettingsError(f"{name} is on or off, True or False, not {value!r}")
        return bool(value)
    if about.words and isinstance(value, str):
        if value not in about.words:
            raise SettingsError(f"{name} must be {about.limits}, not {value!r}")
        return value
    try:
        number = about.type(value)
        exact = number == float(value) and math.isfinite(number)
    except (TypeError, ValueError, OverflowError):
        exact = False
    if not exact:
        kind = "a whole number" if about.type is int else "a finite number"
        raise SettingsError(f"{name} must be {kind}, not {value!r}")
    too_low = about.low is not None and (number < about.low or (about.low_open and number == about.low))
    too_high = about.high is not None and (number > about.high or (about.high_open and number == about.high))
    if too_low or too_high:
        raise SettingsError(f"{name} must be {about.limits}, not {number:g}")
    return number
