# SPDX-License-Identifier: GPL-3.0-or-later
"""Which cases of a batch differ from the others, and why; those of each label are looked at by themselves."""

from __future__ import annotations

import re
import statistics
from collections import Counter
from collections.abc import Sequence

from ..files import DONE
from .rows import NOTES_BETWEEN, SummaryRow, known

FEWEST = 5  # cases, below which nothing is unusual
DEVIATIONS = 3.0
NORMAL_MAD = 1.4826  # standard deviations of a normal distribution, in median absolute deviations
NORMAL_MEAN = 1.2533  # in mean absolute deviations
MOST_COMPONENTS = 10  # that are never many
TIMES_MEDIAN = 3.0  # components, beyond which they are many
RARE = 0.1  # of the cases, at most, have a note that is unusual


def mark_outliers(rows: Sequence[SummaryRow]) -> None:
    """Give every row that is done the reasons why it should be looked at; empty where there is none."""
    groups: dict[str, list[SummaryRow]] = {}
    for row in rows:
        row.outlier = ""
        if row.status == DONE:
            groups.setdefault(str(row.label), []).append(row)
    for group in groups.values():
        center, deviation = center_and_deviation(known("volume_mm3", group))
        median = statistics.median(known("components", group) or [0])
        often = Counter(pattern for row in group for pattern in {pattern_of(note) for note in notes_of(row)})
        most = max(1, int(RARE * len(group))) if len(group) >= FEWEST else 0
        for row in group:
            reasons = []
            volume, components, crossings = map(row.values.get, ("volume_mm3", "components", "self_intersections"))
            is_open = row.values.get("closed") is False
            if is_open:
                reasons.append("open")
            if components is not None and components > max(MOST_COMPONENTS, TIMES_MEDIAN * median):
                reasons.append(f"{components} components, the median is {median:g}")
            if crossings:
                reasons.append(f"{crossings} self-intersections")
            if volume is not None and deviation and abs(volume - center) > DEVIATIONS * deviation:
                off = (volume - center) / deviation
                reasons.append(f"volume {abs(off):.1f} deviations {'above' if off > 0 else 'below'} the median")
            # What says that a surface is open is said already.
            rare = [note for note in notes_of(row) if not is_open and often[pattern_of(note)] <= most]
            row.outlier = "; ".join([*reasons, *rare])


def center_and_deviation(values: Sequence[float]) -> tuple[float, float]:
    """Return the median, and how far others lie from it as a standard deviation; 0 where they are few or all the same.

    The median absolute deviation, which a few outliers do not move; the mean where more than half are the same.

    Examples
    --------
    >>> center, deviation = center_and_deviation([9.0, 10.0, 11.0, 10.0, 12.0, 8.0, 1000.0])
    >>> center, round(deviation, 4)
    (10.0, 1.4826)
    >>> center_and_deviation([1.0, 2.0])
    (1.5, 0.0)
    """
    if not values:
        return 0.0, 0.0
    center = statistics.median(values)
    if len(values) < FEWEST:
        return center, 0.0
    distances = [abs(value - center) for value in values]
    return center, NORMAL_MAD * statistics.median(distances) or NORMAL_MEAN * statistics.fmean(distances)


def notes_of(row: SummaryRow) -> list[str]:
    """Return the notes of a row, one by one."""
    return row.notes.split(NOTES_BETWEEN) if row.notes else []


def pattern_of(note: str) -> str:
    """Return a note without its numbers and names of files, so that those of different cases are the same.

    Examples
    --------
    >>> pattern_of("volume-7.nii.gz has 3 gaps of 2.5 mm")
    '# has # gaps of # mm'
    """
    return re.sub(r"\S*\d\S*", "#", note)
