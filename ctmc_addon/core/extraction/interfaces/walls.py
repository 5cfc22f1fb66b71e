# SPDX-License-Identifier: GPL-3.0-or-later
"""The field between two labels that touch: smoothed once for their wall, beyond both labels too.

Half the difference of both labels' fields is where the smoothest field between their samples is looked for
(between_labels.py); no sample of another label binds that, so the wall does not bend where it ends.

An island, a small component of a label, would lose most of its volume by that: its own field has the constant that
keeps it, the field of the label around it has not. So around an island the wall lies where the island's own field is 0.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...budget import Budget
from ...progress import PAUSE, Steps
from ...volume.smoothing import LabelComponents, between_labels_steps, label_components_steps, reach_of
from ...volume.volume import Box
from .label_samples import LabelSamples, samples_of_steps

LEAST_WALL = 40  # sides of voxels between two labels; of a smaller wall only what lies around islands has a field
SMALL_ISLAND = 128  # voxels; the smoothest wall would flatten these
LARGEST_ISLAND = 1000  # and these where at least half of their border is with the other label; larger components hardly

Positions = tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]
# A sample and its neighbors, along z, y and x.
AROUND = ((0, 0, 0), (0, 0, -1), (0, 0, 1), (0, -1, 0), (0, 1, 0), (-1, 0, 0), (1, 0, 0))


class Wall(NamedTuple):
    """Where two labels touch.

    Parameters
    ----------
    first, second : int
        The labels, counted from 1; the first is the smaller.
    box : Box
        The samples beside the wall.
    is_smooth : bool
        Whether the wall is large enough to be smoothed.
    """

    first: int
    second: int
    box: Box
    is_smooth: bool


def find_walls(owners: NDArray[Any]) -> list[Wall]:
    """Return the walls between labels, by label.

    Parameters
    ----------
    owners : (slices, rows, columns) unsigned
        The label of every sample, counted from 1; 0 is no label.
    """
    found = []
    for axis in range(3):
        before, behind = (
            owners[tuple(part if each == axis else slice(None) for each in range(3))]
            for part in (slice(None, -1), slice(1, None))
        )
        at = np.array(np.unravel_index(np.flatnonzero(before != behind), before.shape))
        ends = np.sort([before[tuple(at)], behind[tuple(at)]], axis=0).astype(np.int64)
        meets = ends[0] > 0
        low, ends = at[:, meets], ends[:, meets]
        high = low.copy()
        high[axis] += 1
        found.append(np.concatenate([ends, low, high]))
    every = np.concatenate(found, axis=1)
    if not every.shape[1]:
        return []
    every = every[:, np.lexsort(every[1::-1])]
    first = np.flatnonzero(np.concatenate([[True], (np.diff(every[:2], axis=1) != 0).any(axis=0)]))
    count = np.diff(first, append=every.shape[1])
    lows, highs = np.minimum.reduceat(every[2:5], first, axis=1), np.maximum.reduceat(every[5:], first, axis=1) + 1
    walls = []
    for wall, number in enumerate(first.tolist()):
        (z0, y0, x0), (z1, y1, x1) = lows[:, wall].tolist(), highs[:, wall].tolist()
        labels = int(every[0, number]), int(every[1, number])
        walls.append(Wall(*labels, ((x0, x1), (y0, y1), (z0, z1)), bool(count[wall] >= LEAST_WALL)))
    return walls


def wall_samples_steps(
    wall: Wall,
    owners: NDArray[Any],
    origin: tuple[int, int, int],
    fields: tuple[LabelSamples, LabelSamples],
    spacing_mm: tuple[float, float, float],
    slice_steps: int,
    budget: Budget,
) -> Steps[LabelSamples | None]:
    """Return the field between two labels, above 0 in the first; None for half the difference of their own.

    Parameters
    ----------
    owners : (slices, rows, columns)
        As `find_walls` takes them.
    origin : (x, y, z) int
        The volume's index of the first of them.
    fields : LabelSamples
        Of both labels.
    """
    reach = reach_of(spacing_mm)
    x, y, z = (
        (max(0, low - more), min(size, high + more))
        for (low, high), more, size in zip(wall.box, reach, owners.shape[::-1], strict=True)
    )
    own = owners[slice(*z), slice(*y), slice(*x)]
    sign = (own == wall.first).astype(np.int8) - (own == wall.second)
    yield PAUSE
    # A component at the end of the box may go on behind it, but for the end of all labels.
    goes_on = np.array([(low > 0, high < size) for (low, high), size in zip((z, y, x), owners.shape, strict=True)])
    islands = []
    for side in (1, -1):
        islands.append((yield from _around_islands_steps(sign * np.int8(side), goes_on, slice_steps)))
    if not wall.is_smooth and not any(len(at[0]) for at in islands):
        return None
    columns, rows = np.arange(*x) + origin[0], np.arange(*y) + origin[1]
    slices = np.arange((z[0] + origin[2]) * slice_steps, (z[1] - 1 + origin[2]) * slice_steps + 1)
    between = np.zeros((len(slices), *own.shape[1:]), np.float32)
    for field, half in zip(fields, (0.5, -0.5), strict=True):
        inside = field.part(columns, rows, slices)
        part = np.full(between.shape, np.float32(field.outside))
        if inside is not None:
            part[inside[0]] = inside[1]
        between += np.float32(half) * part
        yield PAUSE
    if wall.is_smooth:
        between = yield from between_labels_steps(between, sign, spacing_mm, slice_steps, budget)
    for field, side, at in zip(fields, (1, -1), islands, strict=True):
        between[at] = np.float32(side) * field.at(columns[at[2]], rows[at[1]], slices[at[0]])
    low = int(columns[0]), int(rows[0]), int(slices[0])
    return (yield from samples_of_steps(between, low, between.min()))


def _around_islands_steps(sign: NDArray[np.int8], goes_on: NDArray[np.bool_], slice_steps: int) -> Steps[Positions]:
    """Where on the refined grid the samples of small components and those beside them lie, along z, y and x.

    Parameters
    ----------
    sign : (slices, rows, columns) int8
        1 at the samples of the label, -1 at those of the other.
    goes_on : (3, 2) bool
        Whether components may go on before the first and behind the last sample along each axis.
    """
    components = yield from label_components_steps(sign > 0)
    shape = (len(sign) - 1) * slice_steps + 1, *sign.shape[1:]
    small = components.voxels <= LARGEST_ISLAND
    if small.any():
        low, high = components.boxes()
        small &= ((low > 0) | ~goes_on[:, 0]).all(axis=1)
        small &= ((high < np.array(sign.shape) - 1) | ~goes_on[:, 1]).all(axis=1)
    middling = small & (components.voxels > SMALL_ISLAND)
    small[middling] = _mostly_inside(components, middling, sign)[middling]
    z, y, x, _ = components.samples(small)
    between = np.arange(1 - slice_steps, slice_steps)  # steps as far as the next slices
    z, y, x = (z * slice_steps + between[:, None]).ravel(), np.tile(y, len(between)), np.tile(x, len(between))
    at = [np.concatenate([along + way[axis] for way in AROUND]) for axis, along in enumerate((z, y, x))]
    inside = np.logical_and.reduce([(along >= 0) & (along < size) for along, size in zip(at, shape, strict=True)])
    z, y, x = (along[inside] for along in at)
    return z, y, x


def _mostly_inside(
    components: LabelComponents, selected: NDArray[np.bool_], sign: NDArray[np.int8]
) -> NDArray[np.bool_]:
    """Whether at least half of the outer sides of components, (components,) bool, are with samples of sign -1."""
    z, y, x, own = components.samples(selected)
    beside, outer = np.zeros(len(selected), np.intp), np.zeros(len(selected), np.intp)
    padded = np.pad(sign, 1)
    for way in AROUND[1:]:
        there = padded[z + way[0] + 1, y + way[1] + 1, x + way[2] + 1]
        beside += np.bincount(own[there < 0], minlength=len(selected))
        outer += np.bincount(own[there <= 0], minlength=len(selected))
    return 2 * beside >= outer
