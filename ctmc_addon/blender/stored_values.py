# SPDX-License-Identifier: GPL-3.0-or-later
"""Check values read from a custom property, which any user or add-on may have written."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import is_dataclass
from functools import partial
from types import UnionType
from typing import Any, Union, cast, get_args, get_origin, get_type_hints

LARGEST_COUNT = 2**63


def parsed_json(text: Any) -> dict[str, Any]:
    """Return the JSON object that a text holds.

    Examples
    --------
    >>> parsed_json('{"faces": 12}')
    {'faces': 12}
    """
    if not isinstance(text, str):
        raise ValueError(f"{type(text).__name__} is not a text")
    try:
        values = json.loads(text)
    except RecursionError as error:
        raise ValueError("the JSON is nested too deep") from error
    if not isinstance(values, dict):
        raise ValueError(f"{type(values).__name__} is not a JSON object")
    return values


def finite(value: Any) -> float:
    """Return a finite number.

    Examples
    --------
    >>> finite(3)
    3.0
    """
    if isinstance(value, bool) or not isinstance(value, (int, float)) or abs(value) > 1e300 or not math.isfinite(value):
        raise ValueError("not a finite number")
    return float(value)


def measured(value: Any) -> float:
    """Return a finite number, or NaN for a quantity that cannot be measured, such as the volume of an open surface."""
    return value if isinstance(value, float) and math.isnan(value) else finite(value)


def positive(value: Any) -> float:
    """Return a finite number above 0."""
    number = finite(value)
    if number <= 0:
        raise ValueError(f"{number:g} is not above 0")
    return number


def whole(value: Any, lowest: int = 0) -> int:
    """Return a whole number of at least `lowest`, and small enough for every table.

    Parameters
    ----------
    value : number
        As stored in the file.
    lowest : int
    """
    if isinstance(value, bool) or not isinstance(value, int) or not lowest <= value <= LARGEST_COUNT:
        raise ValueError("not a whole number in range")
    return value


def texts(values: Any) -> tuple[str, ...]:
    """Return a list of texts."""
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise ValueError("not a list of texts")
    return tuple(values)


def from_stored(kind: Any, values: Any) -> Any:
    """Return a value of a type from the JSON that `asdict` makes of it; fields that are missing have their defaults.

    Parameters
    ----------
    kind : type
        A dataclass, a truth value, a number, a text, a tuple of a fixed length or of texts, a dictionary by text, or one
        of them or None.
    values : object
        Parsed JSON.

    Raises
    ------
    ValueError
        If the JSON is not of this type.
    NotImplementedError
        If the type is none of these, a mistake in this code and not in the file.

    Examples
    --------
    >>> from_stored(tuple[float, float], [1.5, 2]), from_stored(dict[str, int] | None, {"count": 3})
    ((1.5, 2.0), {'count': 3})
    """
    if kind in READERS:
        return READERS[kind](values)
    if is_dataclass(kind):
        if not isinstance(values, dict):
            raise ValueError(f"{type(values).__name__} is not a dictionary")
        types, made_of = get_type_hints(kind), cast(Callable[..., Any], kind)
        if not values.keys() <= types.keys():
            raise ValueError(f"unknown: {sorted(values.keys() - types.keys())}")
        return made_of(**{name: from_stored(types[name], value) for name, value in values.items()})
    outer, inner = get_origin(kind), get_args(kind)
    if outer in (Union, UnionType) and len(inner) == 2 and inner[1] is type(None):
        return None if values is None else from_stored(inner[0], values)
    if outer is tuple and Ellipsis not in inner:
        if not isinstance(values, list) or len(values) != len(inner):
            raise ValueError(f"not a list of {len(inner)}")
        return tuple(map(from_stored, inner, values))
    if outer is dict and inner[0] is str:
        if not isinstance(values, dict):
            raise ValueError(f"{type(values).__name__} is not a dictionary")
        return {name: from_stored(inner[1], value) for name, value in values.items()}
    raise NotImplementedError(f"{kind} cannot be kept with an object")


def truth(value: Any) -> bool:
    """Return True or False."""
    if not isinstance(value, bool):
        raise ValueError("not a truth value")
    return value


def text(value: Any) -> str:
    """Return a text."""
    if not isinstance(value, str):
        raise ValueError("not a text")
    return value


READERS: Mapping[Any, Callable[[Any], Any]] = {
    bool: truth,
    int: partial(whole, lowest=-LARGEST_COUNT),
    float: measured,
    str: text,
    tuple[str, ...]: texts,
}
