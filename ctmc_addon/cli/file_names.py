# SPDX-License-Identifier: GPL-3.0-or-later
"""Names that a file can have on every system, made of names that come out of files."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable

RESERVED = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?", re.IGNORECASE)  # on Windows
FORBIDDEN = re.compile(r'[<>:"/\\|?*\x00-\x1f]')
MOST_BYTES = 120


def is_file_name(name: str) -> bool:
    """Return whether a file can be called so everywhere."""
    return bool(name) and name == name.strip(" .") and not FORBIDDEN.search(name) and not RESERVED.fullmatch(name)


def file_key(name: str) -> str:
    """Return what two names share that are one file somewhere.

    Windows and macOS do not tell upper from lower case, and macOS not one form of an umlaut from the other.
    """
    return unicodedata.normalize("NFC", name).casefold()


def printable(name: str) -> str:
    r"""Return a name on one line, without what a terminal would obey.

    Examples
    --------
    >>> printable("left\n lung\x1b[31m")
    'left lung [31m'
    """
    return " ".join("".join(letter if letter.isprintable() else " " for letter in name).split())


def file_names(names: Iterable[str]) -> list[str]:
    """Return a stem of a file for each name, all different.

    Examples
    --------
    >>> file_names(["liver", "Liver", "a/b: c", "../..", "CON", ""])
    ['liver', 'Liver 2', 'a_b_ c', '_', 'CON_', 'unnamed']
    """
    out: list[str] = []
    taken: set[str] = set()
    for name in names:
        stem = FORBIDDEN.sub("_", printable(name)).strip(" .")
        stem = stem.encode("utf-8", "ignore")[:MOST_BYTES].decode("utf-8", "ignore").strip(" .") or "unnamed"
        stem += "_" if RESERVED.fullmatch(stem) else ""
        number, unique = 1, stem
        while file_key(unique) in taken:
            number += 1
            unique = f"{stem} {number}"
        taken.add(file_key(unique))
        out.append(unique)
    return out
