# SPDX-License-Identifier: GPL-3.0-or-later
"""Separate images at the same positions: copies, time points, cardiac phases, or interleaved scans.

Read as one volume they would give slices of one and the other in turn, or half the true gap. They are separated by, in
this order: the number of the time point, the number of the acquisition, and the order of trigger times,
acquisition times or instance numbers where it is the same at every place.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....core import ReadError
from ..header import Slice
from .stack_geometry import SAME_MM, checked_normal, dot

FEWEST = 3  # Acquisitions of fewer slices come from scanners that count every slice as one.
OVERLAP = 0.5  # Acquisitions overlap if they share more than this part of the shorter one.


def times_of(slices: Sequence[Slice]) -> list[list[Slice]]:
    """Return the slices of each of the volumes at the same positions, in the order of time; mostly one with all slices.

    Parameters
    ----------
    slices : sequence of Slice
        Slices of one geometry.

    Raises
    ------
    ReadError
        If most places have different images and nothing tells which belong together.
    """
    along = heights(slices)  # (n,) mm
    temporal = [ct_slice.geometry.moment.temporal for ct_slice in slices]
    acquisition = [ct_slice.geometry.moment.acquisition for ct_slice in slices]
    groups = grouped(range(len(slices)), temporal)
    mean = len(slices) / len(groups)
    if mean < FEWEST:  # the scanner counts slices
        groups = [list(range(len(slices)))]
    pieces = [piece for group in groups for piece in _by_acquisition(group, acquisition, along)]
    times: list[list[int]] = []
    for piece in pieces:  # those that follow each other in space are one volume
        room = next((time for time in times if not overlaps(along[time], along[piece])), None)
        if room is None:
            times.append(list(piece))
        else:
            room += piece
    if len(times) == 1:
        times = in_order(slices, along) or times
    selected = [[slices[at] for at in sorted(time)] for time in times]
    for time, numbers in zip(selected, times, strict=True):
        _check_doubled(time, along[sorted(numbers)])
    return selected


def heights(slices: Sequence[Slice]) -> NDArray[np.float64]:
    """Return the heights of slices of one orientation along their normal, (n,) mm.

    Parameters
    ----------
    slices : sequence of Slice
    """
    first = slices[0].geometry.orientation or ()
    normal = checked_normal(np.array(first[:3]), np.array(first[3:]))
    return dot(np.array([ct_slice.geometry.position for ct_slice in slices], np.float64), normal)


def grouped(numbers: Iterable[int], keys: Sequence[str]) -> list[list[int]]:
    """Group `numbers` by their `keys`, in the order of the keys."""
    groups: dict[str, list[int]] = {}
    for number in numbers:
        groups.setdefault(keys[number], []).append(number)
    return [groups[key] for key in sorted(groups, key=lambda key: (len(key), key))]


def _by_acquisition(group: list[int], keys: Sequence[str], along: NDArray[np.float64]) -> list[list[int]]:
    """Return the acquisitions among slices; all in one where they are few slices each, or nowhere overlap."""
    pieces = grouped(group, keys)
    if min(map(len, pieces)) < FEWEST:
        return [group]
    several = any(overlaps(along[first], along[second]) for at, first in enumerate(pieces) for second in pieces[:at])
    return pieces if several else [group]


def overlaps(first: NDArray[np.float64], second: NDArray[np.float64]) -> bool:
    """Return whether two sets of heights share more than half of the shorter one's extent."""
    shared = min(first.max(), second.max()) - max(first.min(), second.min())
    return bool(shared > OVERLAP * min(np.ptp(first), np.ptp(second)))


def in_order(slices: Sequence[Slice], along: NDArray[np.float64]) -> list[list[int]]:
    """Return the slices of each time if every position has equally many images, and an order separates them.

    Empty if each has one, or their number differs.
    """
    by_height: dict[int, list[int]] = {}
    images: set[tuple[int, str, int]] = set()
    for number, (ct_slice, height) in enumerate(zip(slices, along, strict=True)):
        level = round(height / SAME_MM)
        image = (level, ct_slice.image.uid, ct_slice.frame)
        if image not in images:  # else a copy of the file
            by_height.setdefault(level, []).append(number)
            images.add(image)
    count = len(next(iter(by_height.values())))
    if count < 2 or len(by_height) < 2 or {len(level) for level in by_height.values()} != {count}:
        return []
    orders: tuple[Callable[[Slice], Any], ...] = (
        lambda ct_slice: ct_slice.geometry.moment.trigger,
        lambda ct_slice: ct_slice.geometry.moment.acquired,
        lambda ct_slice: (ct_slice.image.instance, ct_slice.frame),
    )
    for order in orders:
        keys = [order(ct_slice) for ct_slice in slices]
        if None in keys:
            continue
        ranked = [sorted(level, key=keys.__getitem__) for level in by_height.values()]
        if _tells_apart([[keys[number] for number in level] for level in ranked]):
            return [list(time) for time in zip(*ranked, strict=True)]
    return []


def _tells_apart(ranked: Sequence[Sequence[Any]]) -> bool:
    """Return whether sorted keys of each position give distinct times.

    They differ at each place, and each time ends before the next begins, or each place before the next.
    """
    if any(first == second for level in ranked for first, second in itertools.pairwise(level)):
        return False
    times = list(zip(*ranked, strict=True))
    by_time = all(max(first) < min(second) for first, second in itertools.pairwise(times))
    ends = sorted((level[0], level[-1]) for level in ranked)
    by_level = all(first[1] < second[0] for first, second in itertools.pairwise(ends))
    return by_time or by_level


def _check_doubled(slices: Sequence[Slice], along: NDArray[np.float64]) -> None:
    """Refuse a series if most positions have several different images."""
    images: dict[int, set[tuple[str, int]]] = {}
    for ct_slice, height in zip(slices, along, strict=True):
        images.setdefault(round(height / SAME_MM), set()).add((ct_slice.image.uid, ct_slice.frame))
    doubled = sum(len(different) > 1 for different in images.values())
    if len(images) > 1 and 2 * doubled > len(images):
        raise ReadError(
            f"{doubled} of {len(images)} slices have more than one image, and neither AcquisitionNumber nor "
            "TemporalPositionIdentifier nor an order of times tells which images form one scan; export each scan as a "
            "series of its own"
        )
