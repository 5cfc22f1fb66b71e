# SPDX-License-Identifier: GPL-3.0-or-later
"""Values read back from a custom property, which any hand or add-on may have written: checked, or a `ValueError`."""

from __future__ import annotations

import json
import math
from dataclasses import fields
from typing import Any

LARGEST_COUNT = 2**63


def parsed_json(text: Any) -> dict[str, Any]:
    """The JSON object that a text holds.

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
    """A finite number.

    Examples
    --------
    >>> finite(3)
    3.0
    """
    if isinstance(value, bool) or not isinstance(value, (int, float)) or abs(value) > 1e300 or not math.isfinite(value):
        raise ValueError("not a finite number")
    return float(value)


def measured(value: Any) -> float:
    """A finite number, or NaN for what cannot be measured, as the volume of an open surface."""
    return value if isinstance(value, float) and math.isnan(value) else finite(value)


def positive(value: Any) -> float:
    """A finite number above 0."""
    number = finite(value)
    if number <= 0:
        raise ValueError(f"{number:g} is not above 0")
    return number


def whole(value: Any, lowest: int = 0) -> int:
    """A whole number of at least `lowest`, and small enough for every table."""
    if isinstance(value, bool) or not isinstance(value, int) or not lowest <= value <= LARGEST_COUNT:
        raise ValueError("not a whole number in range")
    return value


def texts(values: Any) -> tuple[str, ...]:
    """A list of texts."""
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise ValueError("not a list of texts")
    return tuple(values)


def from_stored(kind: Any, values: Any) -> Any:
    """A dataclass of truth values, whole numbers and measures from the dictionary that `asdict` makes of it.

    Parameters
    ----------
    kind : type
        The dataclass; its annotations are texts. Fields of another type cannot be in the dictionary.
    """
    readers = {"bool": truth, "int": lambda value: whole(value, -LARGEST_COUNT), "float": measured}
    if not isinstance(values, dict):
        raise ValueError(f"{type(values).__name__} is not a dictionary")
    known = {field.name: readers[str(field.type)] for field in fields(kind) if str(field.type) in readers}
    return kind(**{name: known[name](value) for name, value in values.items()})


def truth(value: Any) -> bool:
    """True or False."""
    if not isinstance(value, bool):
        raise ValueError("not a truth value")
    return value
