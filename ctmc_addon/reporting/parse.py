# SPDX-License-Identifier: GPL-3.0-or-later
"""Read lists of numbers as people type them: separated by blanks, commas or semicolons."""

from __future__ import annotations

import re

from ..core import SettingsError


def parsed_numbers(text: str, name: str, example: str) -> tuple[float, ...]:
    """Return the numbers in a text, each once; `name` and `example` are for the error message.

    Examples
    --------
    >>> parsed_numbers("0 0.25; 1", "alphas", "0 1")
    (0.0, 0.25, 1.0)
    """
    try:
        return tuple(dict.fromkeys(float(word) for word in _words(text, name, example)))
    except ValueError as error:
        raise SettingsError(f"{name} are numbers such as {example}, not '{text}'") from error


def parsed_levels(text: str) -> tuple[float, ...]:
    """Return levels of simplification, per cent of the triangles to remove.

    Examples
    --------
    >>> parsed_levels("0, 50 90 %")
    (0.0, 50.0, 90.0)
    """
    try:
        levels = tuple(float(word) for word in _split(text))
    except ValueError:
        levels = ()
    if not levels or not all(0 <= level < 100 for level in levels) or len(set(levels)) < len(levels):
        raise SettingsError(f"levels are different shares of triangles to remove, from 0 to 99, not '{text}'")
    return levels


def parsed_strides(text: str) -> tuple[tuple[int, int], ...]:
    """Return the strides along x and y in a text, each once.

    Examples
    --------
    >>> parsed_strides("1, 2x1 3")
    ((1, 1), (2, 1), (3, 3))
    """
    return tuple(dict.fromkeys(parsed_stride(word) for word in _words(text, "strides", "1 2 3")))


def parsed_stride(word: str) -> tuple[int, int]:
    """Return a stride along x and y.

    Examples
    --------
    >>> parsed_stride("2"), parsed_stride("2x1")
    ((2, 2), (2, 1))
    """
    match = re.fullmatch(r"(-?\d+)(?:x(\d+))?", word)
    if match is None:
        raise SettingsError(f"'{word}' is not a stride; write 2, or 2x1 for different strides along x and y")
    x = int(match[1])
    return (x, x if match[2] is None else int(match[2]))


def _words(text: str, name: str, example: str) -> list[str]:
    words = _split(text)
    if not words:
        raise SettingsError(f"{name} to compare are missing; give some, such as {example}")
    return words


def _split(text: str) -> list[str]:
    return re.sub("[,;%]", " ", text).split()
