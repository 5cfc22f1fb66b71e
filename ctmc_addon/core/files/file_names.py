# SPDX-License-Identifier: GPL-3.0-or-later
"""Make names that a file can have on every system from the names of patients, labels and objects.

The command line, its batches and the sidebar name files by these rules and no others.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Container, Iterable
from pathlib import Path

RESERVED = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?", re.IGNORECASE)  # Windows reserves these names.
FORBIDDEN = re.compile(r'[<>:"/\\|?*\x00-\x1f]')
MOST_BYTES = 120  # A name that is made here has at most this many bytes.
LONGEST_BYTES = 240  # A stem has at most this many bytes: systems allow 255 with the suffix.


def name_problem(name: str) -> str:
    r"""Return why a file cannot be called so everywhere; empty where it can.

    Examples
    --------
    >>> name_problem("liver 7"), name_problem("a:b"), name_problem("a\t")
    ('', "':' is not allowed", "'\\t' is not allowed")
    >>> name_problem("liver."), name_problem("con")
    ("it begins or ends with '.'", 'Windows keeps it for a device')
    """
    forbidden = FORBIDDEN.search(name)
    if forbidden:
        return f"{forbidden[0]!r} is not allowed"
    for letter in (name[:1], name[-1:]):
        if letter in " .":  # of nothing too
            return f"it begins or ends with {letter!r}" if letter else "it is empty"
    return "Windows keeps it for a device" if RESERVED.fullmatch(name) else ""


def file_key(name: str) -> str:
    """Return the same text for two names that are one file on some system.

    Windows and macOS do not tell upper from lower case, and macOS not one form of an umlaut from the other.
    """
    return unicodedata.normalize("NFC", name).casefold()


def printable(name: str) -> str:
    r"""Return a name on one line, without control characters that a terminal obeys.

    Examples
    --------
    >>> printable("left\n lung\x1b[31m")
    'left lung [31m'
    """
    return " ".join("".join(letter if letter.isprintable() else " " for letter in name).split())


def file_name(name: str) -> str:
    """Return a stem of a file for a name: without folders, and fit for every system.

    Examples
    --------
    >>> file_name("CT Kidney/left"), file_name("a/b: c"), file_name("../.."), file_name("CON"), file_name("")
    ('CT Kidney_left', 'a_b_ c', '_', 'CON_', 'unnamed')
    """
    stem = FORBIDDEN.sub("_", printable(name)).strip(" .")
    stem = stem.encode("utf-8", "ignore")[:MOST_BYTES].decode("utf-8", "ignore").strip(" .") or "unnamed"
    return stem + "_" * bool(RESERVED.fullmatch(stem))


def file_names(names: Iterable[str]) -> list[str]:
    """Return a stem of a file for each name, all different.

    Examples
    --------
    >>> file_names(["liver", "Liver", "a/b"])
    ['liver', 'Liver 2', 'a_b']
    """
    out: list[str] = []
    taken: set[str] = set()
    for stem in map(file_name, names):
        number, unique = 1, stem
        while file_key(unique) in taken:
            number += 1
            unique = f"{stem} {number}"
        taken.add(file_key(unique))
        out.append(unique)
    return out


def with_suffix(path: str, suffix: str, allowed: Container[str] = ()) -> str:
    """Return a path with `suffix` if its file has a name without one.

    A suffix is one of the `allowed` (in small letters), or begins with a letter: one that no writer knows is refused
    later. What else follows a dot is a part of the name.

    Examples
    --------
    >>> [with_suffix(path, ".stl", (".stl", ".3mf")) for path in ("a", "a.STL", "a.3mf", "a.xyz", "liver 1.5mm", "b/")]
    ['a.stl', 'a.STL', 'a.3mf', 'a.xyz', 'liver 1.5mm.stl', 'b/']
    """
    name = "" if path.endswith(("/", "\\")) else Path(path).name
    own = Path(name).suffix.lower()
    return path + suffix if name and own not in allowed and not own[1:2].isalpha() else path
