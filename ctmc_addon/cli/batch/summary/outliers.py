# SPDX-License-Identifier: GPL-3.0-or-later
"""Find cases of a batch that differ from the others with the same label, and the reasons."""

from __future__ import annotations

import re
import statistics
from collections import Counter
from collections.abc import Sequence

from ..files import DONE
from .rows import NOTES_BETWEEN, SummaryRow, present_values

FEWEST = 5  # Among fewer cases no volume and no note is unusual.
DEVIATIONS = 3.0  # A volume is unusual if it is more standard deviations from the median.
# The standard deviation of a normal distribution, in median and in mean absolute deviations.
NORMAL_MAD, NORMAL_MEAN = 1.4826, 1.2533
# Components are many if they are more than this number and more than this multiple of the median.
MOST_COMPONENTS, TIMES_MEDIAN = 10, 3.0
RARE = 0.1  # A note is unusual if at most this share of the cases has it.


def mark_outliers(rows: Sequence[SummaryRow]) -> None:
    """Give every row that is done the reasons why it should be looked at; empty where there is none."""
    groups: dict[str, list[SummaryRow]] = {}
    for row in rows:
        row.outlier = ""
        if row.status == DONE:
            groups.setdefault(str(row.label), []).append(row)
    for group in groups.values():
        center, deviation = _center_and_deviation(present_values("volume_mm3", group))
        median = statistics.median(present_values("components", group) or [0])
        often = Counter(pattern for row in group for pattern in {_pattern_of(note) for note in _notes_of(row)})
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
            # The notes of an open surface say that it is open, which the reasons do already.
            rare = [note for note in _notes_of(row) if not is_open and often[_pattern_of(note)] <= most]
            row.outlier = "; ".join([*reasons, *rare])


def _center_and_deviation(values: Sequence[float]) -> tuple[float, float]:
    """Return the median and a robust standard deviation; 0 for few or equal values.

    The median absolute deviation, which a few outliers do not move; the mean where more than half are the same.

    Examples
    --------
    >>> center, deviation = _center_and_deviation([9.0, 10.0, 11.0, 10.0, 12.0, 8.0, 1000.0])
    >>> center, round(deviation, 4)
    (10.0, 1.4826)
    >>> _center_and_deviation([1.0, 2.0])
    (1.5, 0.0)
    """
    if not values:
        return 0.0, 0.0
    center = statistics.median(values)
    if len(values) < FEWEST:
        return center, 0.0
    distances = [abs(value - center) for value in values]
    return center, NORMAL_MAD * statistics.median(distances) or NORMAL_MEAN * statistics.fmean(distances)


def _notes_of(row: SummaryRow) -> list[str]:
    return row.notes.split(NOTES_BETWEEN) if row.notes else []


def _pattern_of(note: str) -> str:
    """Return a note without its numbers and names of files, so that those of different cases are the same.

    Examples
    --------
    >>> _pattern_of("volume-7.nii.gz has 3 gaps of 2.5 mm")
    '# has # gaps of # mm'
    """
    return re.sub(r"\S*\d\S*", "#", note)
