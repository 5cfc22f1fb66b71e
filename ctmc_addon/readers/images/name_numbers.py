# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the number that tells a slice from its neighbors in the names of pictures.

It is whole or has decimals ('0.25', '0,25'), stands in parts ('0_9' before '1_0'), or is a time of day ('12.01.20').
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

WHOLE = r"[0-9]+"
# One decimal mark alone: '12.01.20' and '1.2.840' are several whole numbers.
NUMBER = r"(?<![0-9])(?<![0-9][.,])[0-9]+[.,][0-9]+(?![0-9])(?![.,][0-9])|[0-9]+"
MARKS = (".", ",", "_", "-", " ")  # These stand between the parts of one number.
CLOCK = (24, 60, 60)  # Hours, minutes and seconds stay below these.


def text_around(path: Path, pattern: str) -> tuple[str, ...]:
    """Return the text of a name around its numbers, in small letters.

    Examples
    --------
    >>> text_around(Path("CT_1.5mm.png"), NUMBER), text_around(Path("CT_1.5mm.png"), WHOLE)
    (('ct_', 'mm'), ('ct_', '.', 'mm'))
    """
    return tuple(re.split(pattern, path.stem.casefold()))


def columns_of(paths: Sequence[Path], pattern: str) -> list[list[str]]:
    """Return the numbers of names that are alike around them: those at each place, with their zeros."""
    rows = [re.findall(pattern, path.stem) for path in paths]
    return [list(column) for column in zip(*rows, strict=True)]


def varying(columns: Sequence[Sequence[str]]) -> list[int]:
    """Return which columns have more than one value."""
    return [at for at, column in enumerate(columns) if len(set(map(_value, column))) > 1]


def numbers_in_order(paths: Sequence[Path]) -> list[Fraction] | None:
    """Return the number of each name, or None where the names have no single one.

    Examples
    --------
    >>> [float(number) for number in numbers_in_order([Path("s1.5.png"), Path("s2.0.png"), Path("s2.5.png")])]
    [1.5, 2.0, 2.5]
    """
    decimals = single_number(paths, NUMBER)
    if decimals is not None and is_nearly_even(decimals):
        return decimals
    return single_number(paths, WHOLE) or number_in_parts(paths)


def single_number(paths: Sequence[Path], pattern: str) -> list[Fraction] | None:
    """Return the one number that differs from name to name, None where there are none or several."""
    if len({text_around(path, pattern) for path in paths}) > 1:
        return None
    columns = columns_of(paths, pattern)
    at = varying(columns)
    return list(map(_value, columns[at[0]])) if len(at) == 1 else None


def number_in_parts(paths: Sequence[Path]) -> list[Fraction] | None:
    """Return the numbers that names have in parts or as times of day if they rise in even steps; else None."""
    texts = {text_around(path, WHOLE) for path in paths}
    columns = columns_of(paths, WHOLE) if len(texts) == 1 else []
    at = varying(columns)
    if len(at) < 2:
        return None
    text = texts.pop()
    readings = (_joined(columns, text, at), _time_of_day(columns, text, at))
    return next((values for values in readings if values is not None and is_even(values)), None)


def date_columns(paths: Sequence[Path]) -> range:
    """Return which whole numbers of names that are alike around them are year, month and day, such as 2020-01-31.

    Examples
    --------
    >>> date_columns([Path("scan3_2020-01-31_004.png")]), date_columns([Path("scan3_004.png")])
    (range(1, 4), range(0, 0))
    """
    columns, text = columns_of(paths, WHOLE), text_around(paths[0], WHOLE)
    widths = [set(map(len, column)) for column in columns]
    for at in range(len(columns) - 2):
        if widths[at : at + 3] == [{4}, {2}, {2}] and all(between in MARKS for between in text[at + 1 : at + 3]):
            return range(at, at + 3)
    return range(0)


def is_even(values: Sequence[Fraction]) -> bool:
    """Return whether at least three values rise in equal steps."""
    steps = _steps(values)
    return len(steps) > 1 and steps[0] > 0 and len(set(steps)) == 1


def is_nearly_even(values: Sequence[Fraction]) -> bool:
    """Return whether at least three values rise in equal steps but for a few that are missing.

    Examples
    --------
    >>> is_nearly_even([Fraction(value) for value in (1, 2, 4, 5)]), is_nearly_even([1, 2, 1001, 1002])
    (True, False)
    """
    steps = _steps(values)
    usual = min(steps, default=Fraction(0))
    if len(steps) < 2 or usual <= 0:
        return False
    gaps = sum(step != usual for step in steps)
    places = (values[-1] - values[0]) / usual + 1
    return 2 * gaps < len(values) and places <= 2 * len(values) and not any(step % usual for step in steps)


def _joined(columns: list[list[str]], text: tuple[str, ...], at: list[int]) -> list[Fraction] | None:
    """Join the parts of a number, which starts with a part of 0: '0_9' is 9 and '1_0' is 10.

    After a letter, as in 'scan0_9', the first part counts something else.
    """
    parts = columns[at[0] : at[-1] + 1]
    fixed = all(len(set(map(len, part))) == 1 for part in parts[1:])
    joined_by_marks = all(between in MARKS for between in text[at[0] + 1 : at[-1] + 1])
    if not fixed or not joined_by_marks or text[at[0]][-1:].isalpha() or min(map(_value, parts[0])) > 0:
        return None
    return [_value("".join(row)) for row in zip(*parts, strict=True)]


def _time_of_day(columns: list[list[str]], text: tuple[str, ...], at: list[int]) -> list[Fraction] | None:
    """Return seconds where the numbers that vary are among hours, minutes and seconds of two digits each."""
    for first in range(max(0, at[-1] - 2), min(at[0], len(columns) - 3) + 1):
        parts = columns[first : first + 3]
        if all(between in MARKS for between in text[first + 1 : first + 3]) and all(
            len(word) == 2 and int(word) < limit for part, limit in zip(parts, CLOCK, strict=True) for word in part
        ):
            return [Fraction((int(h) * 60 + int(m)) * 60 + int(s)) for h, m, s in zip(*parts, strict=True)]
    return None


def _value(word: str) -> Fraction:
    return Fraction(word.replace(",", "."))


def _steps(values: Sequence[Fraction]) -> list[Fraction]:
    return [after - before for before, after in pairwise(values)]
