# SPDX-License-Identifier: GPL-3.0-or-later
"""The field between two labels that touch: smoothed once for their wall, beyond both labels too.

Half the difference of both labels' fields is where the smoothest field between their samples is looked for
(between_labels.py); no sample of another label binds that, so the wall does not bend where it ends.

An island, a small component of a label, would lose most of its volume by that: its own field has the constant that
keeps it, the field of the label around it has not. So around an island the wall lies where the island's own field is 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...machine.budget import Budget
from ...progress import PAUSE, Steps
from ...smoothing.between_labels import between_labels_steps
from ...smoothing.constrained import reach_of
from ...smoothing.label_components import LabelComponents, label_components_steps
from ...volume.volume import Box
from .label_samples import LabelSamples, samples_of_steps

LEAST_WALL = 40  # A wall with fewer sides of voxels than this has a field only around its islands.
SMALL_ISLAND = 128  # The smoothest wall would flatten islands of fewer voxels than this.
SAMPLES_AT_ONCE = 1 << 17  # The boxes of walls that are smoothed at once have up to this many samples.
LARGEST_ISLAND = 1000  # Islands up to this many voxels count if at least half of their border is with the other label.

Positions = tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]
# A sample and its neighbors, along z, y and x.
AROUND = ((0, 0, 0), (0, 0, -1), (0, 0, 1), (0, -1, 0), (0, 1, 0), (-1, 0, 0), (1, 0, 0))


class Wall(NamedTuple):
    """The contact of two labels.

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
    sides = []
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
        sides.append(np.concatenate([ends, low, high]))
    every = np.concatenate(sides, axis=1)
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


def walls_at_once(walls: Sequence[Wall]) -> list[list[Wall]]:
    """Part walls into lists that are smoothed at once: a small wall takes as long as the calls for it."""
    parts: list[list[Wall]] = []
    room = 0
    for wall in walls:
        samples = math.prod(stop - start for start, stop in wall.box)
        if samples > room or not parts:
            parts.append([])
            room = max(SAMPLES_AT_ONCE, samples)
        parts[-1].append(wall)
        room -= samples
    return parts


class _Between(NamedTuple):
    """The start of a wall's field, (slices, rows, columns) on the refined grid, and where it lies.

    Parameters
    ----------
    wall : Wall
    between : float32
    sign : int8
        Sign of the samples: 1 in the first label, -1 in the second.
    islands : two of Positions
        Positions where the own field of each label holds.
    along : (x, y, z)
        Positions on the common grid.
    """

    wall: Wall
    between: NDArray[np.float32]
    sign: NDArray[np.int8]
    islands: tuple[Positions, Positions]
    along: tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]


def walls_samples_steps(
    walls: Sequence[Wall],
    owners: NDArray[Any],
    small: LabelComponents,
    origin: tuple[int, int, int],
    fields: Sequence[LabelSamples],
    spacing_mm: tuple[float, float, float],
    slice_steps: int,
    budget: Budget,
) -> Steps[dict[tuple[int, int], LabelSamples]]:
    """Return the fields of walls by their labels; half the difference of the labels' own holds for one left out.

    Parameters
    ----------
    owners : (slices, rows, columns)
        Owners as `find_walls` takes them.
    small : LabelComponents
        Result of `islands_steps` for the owners.
    origin : (x, y, z) int
        The volume's index of the first of them.
    fields : LabelSamples
        Fields of all labels.
    """
    starts = []
    for wall in walls:
        start = yield from _between_steps(wall, owners, small, origin, fields, spacing_mm, slice_steps)
        if start is not None:
            starts.append(start)
    smooth = [at for at, start in enumerate(starts) if start.wall.is_smooth]
    looking = [(starts[at].between, starts[at].sign) for at in smooth]
    smoothed = yield from between_labels_steps(looking, spacing_mm, slice_steps, budget)
    for at, between in zip(smooth, smoothed, strict=True):
        starts[at] = starts[at]._replace(between=between)
    samples = {}
    for start in starts:
        x, y, z = start.along
        labels = start.wall.first, start.wall.second
        for label, side, place in zip(labels, (1, -1), start.islands, strict=True):
            start.between[place] = np.float32(side) * fields[label - 1].at(x[place[2]], y[place[1]], z[place[0]])
        low = int(x[0]), int(y[0]), int(z[0])
        samples[labels] = yield from samples_of_steps(start.between, low, start.between.min())
    return samples


def _between_steps(
    wall: Wall,
    owners: NDArray[Any],
    small: LabelComponents,
    origin: tuple[int, int, int],
    fields: Sequence[LabelSamples],
    spacing_mm: tuple[float, float, float],
    slice_steps: int,
) -> Steps[_Between | None]:
    """Return half the difference of both labels' fields; None if only the labels' own fields are used."""
    reach = reach_of(spacing_mm)
    x, y, z = (
        (max(0, low - more), min(size, high + more))
        for (low, high), more, size in zip(wall.box, reach, owners.shape[::-1], strict=True)
    )
    own = owners[slice(*z), slice(*y), slice(*x)]
    sign = (own == wall.first).astype(np.int8) - (own == wall.second)
    yield PAUSE
    goes_on = np.array([(low > 0, high < size) for (low, high), size in zip((z, y, x), owners.shape, strict=True)])
    islands = []
    for label, side in ((wall.first, 1), (wall.second, -1)):
        own_islands = small.select(small.label == label).moved(-z[0], -y[0], -x[0])
        islands.append(_around_islands(own_islands, sign * np.int8(side), goes_on, slice_steps))
        yield PAUSE
    if not wall.is_smooth and not any(len(at[0]) for at in islands):
        return None
    columns, rows = np.arange(*x) + origin[0], np.arange(*y) + origin[1]
    slices = np.arange((z[0] + origin[2]) * slice_steps, (z[1] - 1 + origin[2]) * slice_steps + 1)
    between = np.zeros((len(slices), *own.shape[1:]), np.float32)
    for label, half in ((wall.first, 0.5), (wall.second, -0.5)):
        field = fields[label - 1]
        inside = field.part(columns, rows, slices)
        part = np.full(between.shape, np.float32(field.outside))
        if inside is not None:
            part[inside[0]] = inside[1]
        between += np.float32(half) * part
        yield PAUSE
    return _Between(wall, between, sign, (islands[0], islands[1]), (columns, rows, slices))


def islands_steps(owners: NDArray[Any]) -> Steps[LabelComponents]:
    """Return the small components of all labels, among them the islands of walls; `owners` is as for `find_walls`."""
    components = yield from label_components_steps(owners)
    return components.select(components.voxels <= LARGEST_ISLAND)


def _around_islands(
    components: LabelComponents, sign: NDArray[np.int8], goes_on: NDArray[np.bool_], slice_steps: int
) -> Positions:
    """Return the refined positions of the samples of islands and of their neighbors, along z, y and x.

    Parameters
    ----------
    components : LabelComponents
        The small ones of a label, placed in the box of the wall.
    sign : (slices, rows, columns) int8
        1 at the samples of the label in this box, -1 at those of the other.
    goes_on : (3, 2) bool
        Whether there are samples before the first and behind the last along each axis: what ends there is not whole.
    """
    shape = (len(sign) - 1) * slice_steps + 1, *sign.shape[1:]
    small = np.ones(len(components.voxels), bool)
    if len(small):
        low, high = components.boxes()
        small &= ((low >= goes_on[:, 0]) & (high < np.array(sign.shape) - goes_on[:, 1])).all(axis=1)
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
    """Return whether at least half of each component's outer sides, (components,) bool, have samples of sign -1."""
    z, y, x, own = components.samples(selected)
    negative, outer = np.zeros(len(selected), np.intp), np.zeros(len(selected), np.intp)
    padded = np.pad(sign, 1)
    for way in AROUND[1:]:
        there = padded[z + way[0] + 1, y + way[1] + 1, x + way[2] + 1]
        negative += np.bincount(own[there < 0], minlength=len(selected))
        outer += np.bincount(own[there <= 0], minlength=len(selected))
    return 2 * negative >= outer
