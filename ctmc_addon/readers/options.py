# SPDX-License-Identifier: GPL-3.0-or-later
"""Describe how a path is read: facts that its files lack, and values that replace theirs.

`read_volume`, the command line's flags, a manifest's columns, the sidebar's properties and the table `[reading]` of a
settings file are made from these fields.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..core import Described, SettingsError, setting
from ..core.volume import LEAST_SPACING_MM, MOST_SPACING_MM, SPACING_LIMITS, is_spacing


def checked_spacing(spacing: float | Sequence[float] | None) -> tuple[float, float, float] | None:
    """Return a spacing as (x, y, z) mm.

    Parameters
    ----------
    spacing : float or (x, y, z), optional
        Millimeters; one number stands for all three.

    Raises
    ------
    SettingsError
        If it is not three numbers within `SPACING_LIMITS`.

    Examples
    --------
    >>> checked_spacing(0.5)
    (0.5, 0.5, 0.5)
    """
    if spacing is None:
        return None
    try:
        sides = (spacing,) * 3 if isinstance(spacing, (int, float)) else tuple(spacing)
        numbers = tuple(float(value) for value in sides)
    except (TypeError, ValueError) as error:
        raise SettingsError(f"spacing is three numbers x, y, z in mm, not {spacing!r}") from error
    if len(numbers) != 3:
        raise SettingsError(f"spacing is three numbers x, y, z in mm, not {len(numbers)}: {spacing}")
    for axis, value in zip("xyz", numbers, strict=True):
        if not is_spacing([value]):
            raise SettingsError(
                f"spacing along {axis} must be {SPACING_LIMITS}, not {value:g}; measure it or leave it out"
            )
    return (numbers[0], numbers[1], numbers[2])


def checked_flip(flip: str | None) -> str:
    """Return the axes to mirror, each once and in the order x, y, z, or a `SettingsError`.

    Examples
    --------
    >>> checked_flip("ZX")
    'xz'
    """
    letters = (flip or "").lower().replace(",", "").replace(" ", "")
    if set(letters) - set("xyz") or len(set(letters)) != len(letters):
        raise SettingsError(f"flip takes the axes x, y and z, each at most once, such as 'xz', not {flip!r}")
    return "".join(sorted(letters))


def _checked_series(series: str | int) -> str | None:
    """Return a series' UID or number as a word; None for an empty one.

    Examples
    --------
    >>> _checked_series(2), _checked_series(" ")
    ('2', None)
    """
    return str(series).strip() or None


def _checked_name(name: str) -> str:
    """Return a name that can be shown on one line, or a `SettingsError`: an empty one would show the file's own."""
    if not name.strip() or not name.isprintable():
        raise SettingsError(f"name must be printable text, not {name!r}")
    return name.strip()


@dataclass(frozen=True)
class ReadingOptions(Described):
    """Options for reading a path. Frozen, hashable and picklable.

    Raises
    ------
    SettingsError
        If spacing, flip or time are not what they can be.

    Examples
    --------
    >>> ReadingOptions(spacing=0.5, flip="ZX").spacing
    (0.5, 0.5, 0.5)
    """

    spacing: tuple[float, float, float] | None = setting(
        None,
        "Distance between samples along x, y and z",
        label="Spacing",
        unit="mm",
        size=3,
        low=LEAST_SPACING_MM,
        high=MOST_SPACING_MM,
        start=(1.0, 1.0, 1.0),
        without="as the files say, else 1 mm",
        check=checked_spacing,
    )
    flip: str = setting("", "Axes to reverse, such as z or xz", label="Flip", type=str, check=checked_flip)
    series: str | None = setting(
        None,
        "UID, number, folder or description of the DICOM series",
        label="Series",
        note="see info; for an OME-Zarr, the channel's number",
        type=str,
        start="2",
        without="the one with the most slices, masks last",
        check=_checked_series,
    )
    time: int | None = setting(
        None,
        "Time of the CT to read, from 1 on: a time point, phase or acquisition",
        label="Time",
        note="see info",
        type=int,
        low=1,
        start=2,
        without="the first complete one",
    )
    level: int | None = setting(
        None,
        "Resolution level of an OME-Zarr to read; 0 is the full one",
        label="Level",
        note="see info",
        type=int,
        low=0,
        start=1,
        without="the full one",
    )
    strict: bool = setting(
        False, "Refuse uneven gaps between DICOM slices instead of resampling them", label="Strict", type=bool
    )
    allow_outside: bool = setting(
        False,
        "Read data files that an .nhdr or .mhd names outside its own folder; only for headers you trust",
        label="Allow Outside",
        type=bool,
        kept=False,
    )
    name: str | None = setting(
        None,
        "Name of the volume, its surfaces and the report",
        label="Name",
        type=str,
        kept=False,
        without="the name of the file or folder",
        check=_checked_name,
    )
    remove_table: bool = setting(
        False,
        "Replace the table and other objects behind the patient by air; only for a CT in HU",
        label="Remove Patient Table",
        type=bool,
    )
    anatomy_colors: bool = setting(
        False,
        "Color labels by their anatomical names instead of the colors in the file",
        label="Anatomy Colors",
        type=bool,
    )
    file_colors: bool = setting(
        False,
        "Keep the colors in the file even if a program chose them by number, as TotalSegmentator does",
        label="File Colors",
        type=bool,
    )
    skip_damaged: bool = setting(
        False,
        "Leave out truncated or damaged DICOM slices, with a note, instead of refusing the series",
        label="Skip Damaged",
        note="a gap is filled by interpolation",
        type=bool,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.anatomy_colors and self.file_colors:
            raise SettingsError("anatomy_colors and file_colors exclude each other; choose one")


def options_of(options: ReadingOptions | None, fields: dict[str, Any]) -> ReadingOptions:
    """Return the options, by default all at their defaults, some fields replaced.

    Raises
    ------
    SettingsError
        If a field does not exist or is not what it can be.
    """
    names = [field.name for field in dataclasses.fields(ReadingOptions)]
    unknown = sorted(set(fields) - set(names))
    if unknown:
        raise SettingsError(f"unknown reading option {unknown[0]!r}; the options are {', '.join(names)}")
    return dataclasses.replace(options or ReadingOptions(), **fields)
