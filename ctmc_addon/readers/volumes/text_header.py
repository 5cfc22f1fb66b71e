# SPDX-License-Identifier: GPL-3.0-or-later
"""Read numbers from a text header; a field with another count is refused by name."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

from ...core import ReadError

MOST_HEADER = 1 << 20  # Read at most this many bytes of header.


def numbers(fields: Mapping[str, str], keys: Sequence[str], count: int, name: str) -> list[float] | None:
    """Return the numbers of the first field that there is, or None.

    Parameters
    ----------
    fields : mapping of str to str
        By names in small letters.
    keys : sequence of str
        Names of one field.
    count : int
        How many numbers it has.
    name : str
        Of the file, for errors.

    Raises
    ------
    ReadError
        If it has other words, or another count of them.
    """
    key = next((key for key in keys if key.lower() in fields), None)
    if key is None:
        return None
    words = fields[key.lower()].split()
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        expected = "a number" if count == 1 else f"{count} numbers"
        raise ReadError(f"{name} has '{fields[key.lower()][:60]}' as {key}, not {expected}; export it again")
    return values


def whole(text: str, key: str, name: str) -> int:
    """Return the whole number in a field, or raise `ReadError`."""
    if not re.fullmatch(r"[+-]?\d{1,12}", text, re.ASCII):
        raise ReadError(f"{name} has '{text[:60]}' as {key}, not a whole number; export it again")
    return int(text)


def volume_size(sides: Sequence[int], name: str) -> tuple[int, int, int]:
    """Return (columns, rows, slices) of a volume, or raise `ReadError`."""
    if len(sides) != 3 or min(sides) < 1:
        raise ReadError(f"{name} has the sizes {tuple(sides)}, and a volume has 3 above 0; export it again")
    columns, rows, slices = sides
    if slices < 2:
        raise ReadError(f"{name} has only one slice ({columns} x {rows}); a surface needs at least 2 slices")
    return columns, rows, slices
