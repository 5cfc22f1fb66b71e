# SPDX-License-Identifier: GPL-3.0-or-later
"""Values read back from a custom property, which any hand or add-on may have written: checked, or a `ValueError`."""

from __future__ import annotations

import json
import math
from dataclasses import fields
from typing import Any

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
    """Return a finite number, or NaN for what cannot be measured, as the volume of an open surface."""
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
        As a file holds it.
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
    """Return a dataclass of truth values, whole numbers and measures from the dictionary that `asdict` makes of it.

    Parameters
    ----------
    kind : type
        The dataclass; its annotations are texts. Fields of another type cannot be in the dictionary.
    """
    readers = {"bool": truth, "int": lambda value: whole(value, -LARGEST_COUNT), "float": measured}
    if not isinstance(values, dict):
        raise ValueError(f"{type(values).__name__} is not a dictionary")
    types = {field.name: str(field.type) for field in fields(kind)}
    field_readers = {name: readers[type_] for name, type_ in types.items() if type_ in readers}
    return kind(**{name: field_readers[name](value) for name, value in values.items()})


def truth(value: Any) -> bool:
    """Return True or False."""
    if not isinstance(value, bool):
        raise ValueError("not a truth value")
    return value
