# SPDX-License-Identifier: GPL-3.0-or-later
"""Format numbers and sentences for panels and reports."""

from __future__ import annotations

import re
from collections.abc import Callable
from unicodedata import east_asian_width

# Spaces that no line breaks at: around the x of sizes, and before a unit.
_WITHIN = re.compile(r"(?<=\d) (?=x \d)|(?<=\d x) (?=\d)|(?<=\d) (?=(?:mm|ml|um|px|HU|s|GiB|MiB)\b)")
_KEPT = "\N{NO-BREAK SPACE}"
SIDES = {"L": "left", "R": "right", "P": "back", "A": "front", "S": "head", "I": "feet"}


def capitalized(text: str) -> str:
    """Return a text with a capital at its beginning; the rest stays, so that names keep theirs.

    Examples
    --------
    >>> capitalized("distance vertebrae L3")
    'Distance vertebrae L3'
    """
    return text[:1].upper() + text[1:]


def count(number: int) -> str:
    """Return a count with thousands separators.

    Examples
    --------
    >>> count(1234567)
    '1,234,567'
    """
    return f"{number:,}"


def size_of_bytes(number: float) -> str:
    """Return bytes in MiB or GiB.

    Parameters
    ----------
    number : float
        Bytes.

    Examples
    --------
    >>> size_of_bytes(3 * 2**20), size_of_bytes(1.5 * 2**30)
    ('3 MiB', '1.5 GiB')
    """
    return f"{number / 2**30:.1f} GiB" if number >= 2**30 else f"{max(1, round(number / 2**20))} MiB"


def file_size(number: float) -> str:
    """Return the size of a file in kB, MB or GB, as file managers show it.

    Parameters
    ----------
    number : float
        Bytes.

    Examples
    --------
    >>> file_size(300), file_size(23.4e6), file_size(1.25e9)
    ('1 kB', '23 MB', '1.2 GB')
    """
    if number >= 1e9:
        return f"{number / 1e9:.1f} GB"
    return f"{number / 1e6:.0f} MB" if number >= 1e6 else f"{max(1, round(number / 1e3))} kB"


def duration(seconds: float) -> str:
    """Return seconds or minutes, with no more digits than an estimate has.

    Parameters
    ----------
    seconds : float

    Examples
    --------
    >>> duration(0.04), duration(3.21), duration(47.6), duration(200)
    ('0.1 s', '3.2 s', '48 s', '3.3 min')
    """
    if seconds >= 120:
        return f"{seconds / 60:.1f} min"
    return f"{seconds:.0f} s" if seconds >= 10 else f"{max(seconds, 0.1):.1f} s"


def directions(orientation: str) -> tuple[str, str, str]:
    """Return the sides that columns, rows and slices run towards.

    Examples
    --------
    >>> directions("LPS")
    ('left', 'back', 'head')
    """
    x, y, z = (SIDES[letter] for letter in orientation)
    return x, y, z


def in_lines(text: str, width: float, measure: Callable[[str], float] | None = None) -> list[str]:
    """Return a sentence in lines; text without spaces, such as Chinese, breaks anywhere.

    Parameters
    ----------
    text : str
    width : float
        In the unit of `measure`.
    measure : callable, optional
        Returns the width of a text; by default its letters, of which a Chinese one takes the room of two.

    Examples
    --------
    >>> in_lines("a threshold of 40 is low", 12)
    ['a threshold', 'of 40 is low']
    >>> in_lines("slices of 512 x 512, 0.7 mm", 21)
    ['slices of 512 x 512,', '0.7 mm']
    >>> in_lines("体素体素", 5)
    ['体素', '体素']
    """
    measure = measure or letters
    lines, line = [], ""
    for word in _WITHIN.sub(_KEPT, text).split(" "):
        remainder = word.replace(_KEPT, " ")
        while measure(remainder) > width:
            lines += [line] if line else []
            line = ""
            end = next(end for end in range(len(remainder), 0, -1) if measure(remainder[:end]) <= width or end == 1)
            if end == len(remainder):  # a single letter, wider than the line
                break
            lines.append(remainder[:end])
            remainder = remainder[end:]
        joined = f"{line} {remainder}" if line else remainder
        if line and measure(joined) > width:
            lines.append(line)
            joined = remainder
        line = joined
    return [*lines, line] if line else lines


def letters(text: str) -> int:
    """Return the width of a text in Latin letters."""
    return sum(2 if east_asian_width(letter) in "FW" else 1 for letter in text)
