# SPDX-License-Identifier: GPL-3.0-or-later
"""Several images at one place: copies of one, time points, or scans between each other's slices.

Taken together they would give slices of one and the other in turn, or half the true gap.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError
from .header import Slice
from .stack_geometry import SAME_MM, checked_normal, dot

FEWEST = 3  # slices that make an acquisition; scanners that count every slice as one have fewer
OVERLAP = 0.5  # of the shorter of two acquisitions that lies within the other


def one_acquisition(slices: Sequence[Slice]) -> tuple[list[Slice], list[str]]:
    """The slices of the largest of several acquisitions that overlap, and what was left out.

    Raises
    ------
    ReadError
        If most places have different images and nothing tells which belong together.
    """
    first = slices[0].geometry.orientation or ()
    normal = checked_normal(np.array(first[:3]), np.array(first[3:]))
    along = dot(np.array([ct_slice.geometry.position for ct_slice in slices], np.float64), normal)  # (n,) mm
    keys = [ct_slice.image.acquisition for ct_slice in slices]
    groups = {key: np.array([own == key for own in keys]) for key in dict.fromkeys(keys)}
    largest = max(groups, key=lambda key: int(groups[key].sum()))
    selected, notes = list(slices), []
    if min(int(group.sum()) for group in groups.values()) >= FEWEST:
        others = [key for key in groups if key != largest and overlaps(along[groups[key]], along[groups[largest]])]
        selected = [ct_slice for ct_slice, key in zip(slices, keys, strict=True) if key not in others]
        if others:
            notes.append(
                f"the series holds {len(others) + 1} acquisitions or time points at the same places: the one with the "
                f"most slices was read, and {len(slices) - len(selected)} slices of the others left out"
            )
            along = np.array([height for height, key in zip(along, keys, strict=True) if key not in others])
    check_doubled(selected, along)
    return selected, notes


def overlaps(first: NDArray[np.float64], second: NDArray[np.float64]) -> bool:
    """Whether two sets of heights share more than half of the shorter one's extent."""
    shared = min(first.max(), second.max()) - max(first.min(), second.min())
    return bool(shared > OVERLAP * min(np.ptp(first), np.ptp(second)))


def check_doubled(slices: Sequence[Slice], along: NDArray[np.float64]) -> None:
    """Refuse slices of which most stand where a different one stands; copies of one image are alike.

    Different InstanceNumbers put the images of one scan before those of the other, so the first of each are one scan.
    """
    images: dict[tuple[int, int], set[str]] = {}
    for ct_slice, height in zip(slices, along, strict=True):
        images.setdefault((round(height / SAME_MM), ct_slice.image.instance), set()).add(ct_slice.image.uid)
    doubled = sum(len(uids) > 1 for uids in images.values())
    if len(images) > 1 and 2 * doubled > len(images):
        raise ReadError(
            f"{doubled} of {len(images)} slices have more than one image, and neither AcquisitionNumber nor "
            "TemporalPositionIdentifier tells which belong together; export each scan as a series of its own"
        )
