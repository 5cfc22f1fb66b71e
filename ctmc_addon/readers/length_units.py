# SPDX-License-Identifier: GPL-3.0-or-later
"""Convert names of length units to millimeters: one table for all formats.

Names after UDUNITS-2, which OME-Zarr takes, and symbols after OME-XML and ImageJ; letters' case does not matter.
"""

from __future__ import annotations

from collections.abc import Iterable

PREFIXES = {"nano": 1e-6, "micro": 1e-3, "milli": 1.0, "centi": 10.0, "deci": 100.0, "": 1000.0}  # In millimeters.
TO_MM = {
    **{f"{prefix}{meter}": mm for prefix, mm in PREFIXES.items() for meter in ("meter", "meters", "metre", "metres")},
    **{"nm": 1e-6, "um": 1e-3, "\u03bcm": 1e-3, "mm": 1.0, "cm": 10.0, "dm": 100.0, "m": 1000.0},
    **{"micron": 1e-3, "microns": 1e-3, "angstrom": 1e-7, "angstroms": 1e-7, "\u00e5": 1e-7},
    **{"inch": 25.4, "inches": 25.4, "in": 25.4, '"': 25.4, "foot": 304.8, "feet": 304.8, "ft": 304.8},
}
OTHER_IN_CAPITALS = ("Mm",)  # Units that mean something else in small letters: Mm is a megameter.


def mm_of(unit: str) -> float | None:
    """Return the millimeters of a unit, None for a word that is not known.

    Examples
    --------
    >>> mm_of("Microns"), mm_of(" cm "), mm_of("pixel"), mm_of("Mm")
    (0.001, 10.0, None, None)
    """
    word = unit.strip()
    # `casefold` maps both micro signs, and both angstrom signs, to one.
    return None if word in OTHER_IN_CAPITALS else TO_MM.get(word.casefold())


def in_mm(units: Iterable[str]) -> tuple[list[float], tuple[str, ...]]:
    """Return the millimeters of the unit of each axis, and notes about them.

    Parameters
    ----------
    units : iterable of str
        An empty word, and one that is not known, is taken as mm.

    Examples
    --------
    >>> in_mm(["um", "um", ""])
    ([0.001, 0.001, 1.0], ("the file's positions are in um and were converted to mm",))
    """
    words = [unit.strip() for unit in units]
    lengths = {word: mm_of(word) for word in words}
    converted = sorted(word for word, mm in lengths.items() if mm not in (None, 1.0))
    unknown = sorted(word for word, mm in lengths.items() if word and mm is None)
    notes = []
    if converted:
        notes.append(f"the file's positions are in {' and '.join(converted)} and were converted to mm")
    notes += [
        f"the file's unit '{unit[:60]}' is not a known unit of length: taken as mm; give the spacing in mm for another"
        for unit in unknown
    ]
    return [lengths[word] or 1.0 for word in words], tuple(notes)
