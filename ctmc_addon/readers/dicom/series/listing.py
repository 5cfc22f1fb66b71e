# SPDX-License-Identifier: GPL-3.0-or-later
"""List the series of a DICOM folder, with the names that the scanner's operator gave them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from statistics import median

import numpy as np
from numpy.typing import NDArray

from ....core import ReadError, one_line
from ...series import Series
from ..header import Slice
from ..pixels.pixels import output_types
from .stack_geometry import SAME_MM
from .times import heights, times_of

SAME_DIRECTION = 1e-4  # Unit vectors that differ by less are equal: files round, by 0.05 mm over 512 pixels.
ROUNDED_DEGREES = 5e-4  # Smaller turns come from rounded directions.
LONGEST_FOLDER = 64  # Longer names of folders, in letters, are cut.


def listed(series: Mapping[str, Sequence[Slice]], path: Path) -> tuple[Series, ...]:
    """Return the series of a path in the order of their files, numbered from 1.

    Parameters
    ----------
    series : mapping of str to sequence of Slice
        By SeriesInstanceUID.
    path : Path
        The opened file or folder.
    """
    folders = {uid: {ct_slice.image.path.parent for ct_slice in slices} for uid, slices in series.items()}
    several = len(set().union(*folders.values())) > 1
    lines = []
    for number, (uid, slices) in enumerate(series.items(), 1):
        image = slices[0].image
        sizes = Counter((ct_slice.image.columns, ct_slice.image.rows) for ct_slice in slices)
        positions = {ct_slice.geometry.position for ct_slice in slices} - {None}
        dtype = np.dtype(output_types([ct_slice.geometry for ct_slice in slices], image.is_float)[0])
        times, default_time, spacing_mm = _times_and_spacing(slices, path)
        lines.append(
            Series(
                number,
                uid,
                len(positions) or len(slices),
                sizes.most_common(1)[0][0],
                image.modality,
                dtype.name,
                times,
                default_time,
                *image.called,
                spacing_mm,
                _folder_of(folders[uid], path) if several else "",
            )
        )
    return tuple(lines)


def series_names(series: Sequence[Series]) -> tuple[str, ...]:
    """Return names for the screen that tell series apart: the operator's descriptions, else folders, else numbers.

    Examples
    --------
    >>> series_names([Series(1, "", 9, (8, 8), "CT", folder="MASKS/liver"), Series(2, "", 9, (8, 8), "CT")])
    ('MASKS/liver', '2: CT')
    """
    descriptions = Counter(line.description for line in series)
    folders = Counter(line.folder for line in series)
    names = []
    for line in series:
        name = f"{line.number}: {line.description or line.modality}"
        if line.description and descriptions[line.description] == 1:
            name = line.description
        elif line.folder not in ("", ".") and folders[line.folder] == 1:
            name = line.folder
        names.append(one_line(name))
    return tuple(names)


def _times_and_spacing(slices: Sequence[Slice], path: Path) -> tuple[int, int, float | None]:
    """Return the number of times in the largest group of a series, the default time, and the mm between its slices.

    The default is the time that holds the file `path`, else the first of those with the most slices. A series that
    cannot be read has one time; reading it gives the reason.
    """
    group = largest_group(slices, path)
    if not group:
        return 1, 1, None
    try:
        times = times_of(group)
        along = heights(times[0])
    except ReadError:
        return 1, 1, None
    default = 0
    if len(times) > 1:
        own = [any(ct_slice.image.path == path for ct_slice in time) for time in times]
        default = max(range(len(times)), key=lambda at: (own.count(True) == 1 and own[at], len(times[at]), -at))
    gaps = np.diff(np.unique(np.round(along / SAME_MM) * SAME_MM))
    return len(times), default + 1, float(np.median(gaps)) if len(gaps) else None


def largest_group(slices: Sequence[Slice], path: Path) -> list[Slice]:
    """Return the slices of one geometry that are read by default, scouts left out.

    Parameters
    ----------
    slices : sequence of Slice
        Slices of one series.
    path : Path
        For errors.

    Returns
    -------
    list of Slice
        Empty where none has a position.
    """
    groups = _geometry_groups([ct_slice for ct_slice in slices if is_placed(ct_slice) and not is_scout(ct_slice)])
    if not groups:
        return []
    group = max(groups, key=len)  # the first of equals; but a file given by itself chooses its own
    if len(groups) > 1:
        group = next((own for own in groups if any(ct_slice.image.path == path for ct_slice in own)), group)
    return sorted(group, key=in_order)


def _folder_of(folders: set[Path], path: Path) -> str:
    """Return the folder of a series below `path`, such as 'a/b', '.' for `path` itself, or '2 folders'."""
    if len(folders) > 1:
        return f"{len(folders)} folders"
    folder = next(iter(folders))
    start = path if path.is_dir() else path.parent
    inner = folder.relative_to(start).as_posix() if folder.is_relative_to(start) else folder.name
    return inner if len(inner) <= LONGEST_FOLDER else f"...{inner[-LONGEST_FOLDER:]}"


def is_placed(ct_slice: Slice) -> bool:
    """Return whether a slice has a position and a direction."""
    return bool(ct_slice.geometry.position and ct_slice.geometry.orientation)


def is_scout(ct_slice: Slice) -> bool:
    """Return whether a slice is a picture to plan the scan by."""
    return ct_slice.image.scout or ct_slice.geometry.scout


def _geometry_groups(slices: Sequence[Slice]) -> list[list[Slice]]:
    """Group slices by size, orientation and spacing."""
    groups: list[list[Slice]] = []
    for ct_slice in slices:
        group = next((group for group in groups if alike(group[0], ct_slice)), None)
        if group is None:
            groups.append([ct_slice])
        else:
            group.append(ct_slice)
    return groups


def alike(first: Slice, second: Slice) -> bool:
    """Return whether two slices can belong to one volume."""
    a, b = first.geometry, second.geometry
    if a.orientation == b.orientation:
        return _same_grid(first, second)
    turn = max(abs(p - q) for p, q in zip(a.orientation or (), b.orientation or (), strict=True))
    return turn <= SAME_DIRECTION and _same_grid(first, second)


def _same_grid(first: Slice, second: Slice) -> bool:
    """Return whether two slices have the same size and spacing, in whatever direction."""
    if (first.image.rows, first.image.columns) != (second.image.rows, second.image.columns):
        return False
    a, b = first.geometry.spacing, second.geometry.spacing
    if a == b or a is None or b is None:
        return a == b
    return max(abs(p - q) / max(p, 1e-9) for p, q in zip(a, b, strict=True)) <= SAME_DIRECTION


def turning(slices: Sequence[Slice], best: Sequence[Slice]) -> str:
    """Describe how slices turn against each other if that leaves few in one direction; else return ''.

    Parameters
    ----------
    slices : sequence of Slice
        Slices of one series with positions, without scouts.
    best : sequence of Slice
        The largest group of one direction.
    """
    ordered = sorted((ct_slice for ct_slice in slices if _same_grid(best[0], ct_slice)), key=in_order)
    steps = [_turn_degrees(before, following) for before, following in pairwise(ordered)]
    if not steps or (len(best) > 1 and (2 * len(best) >= len(ordered) or median(steps) < ROUNDED_DEGREES)):
        return ""
    first, last = ordered[0], max(ordered, key=lambda ct_slice: _turn_degrees(ordered[0], ct_slice))
    return (
        f"the {len(ordered)} slices turn: ImageOrientationPatient differs by {median(steps):.2g} degrees from one to "
        f"the next and by {_turn_degrees(first, last):.2g} degrees between {first.name} and {last.name}, and slices of "
        f"one volume differ by at most {math.degrees(SAME_DIRECTION):.1g} degrees"
    )


def _turn_degrees(first: Slice, second: Slice) -> float:
    """Return the angle of the turn that carries the axes of one slice to those of another."""
    difference = _axes_of(first) - _axes_of(second)
    return 2 * math.degrees(math.asin(min(1.0, math.sqrt(float((difference**2).sum()) / 8))))


def _axes_of(ct_slice: Slice) -> NDArray[np.float64]:
    """Return the directions of a slice's rows, columns and normal, (3, 3)."""
    row, column = np.array(ct_slice.geometry.orientation, np.float64).reshape(2, 3)
    return np.stack([row, column, np.cross(row, column)])


def in_order(ct_slice: Slice) -> tuple[int, int]:
    """Return the key by which slices are sorted before their positions are known."""
    return ct_slice.image.instance, ct_slice.frame
