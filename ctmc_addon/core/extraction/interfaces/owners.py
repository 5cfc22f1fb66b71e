# SPDX-License-Identifier: GPL-3.0-or-later
"""Which label owns a sample: the one with the largest field, or none.

Fields that keep every sample of a label on its side decide only between the slices of the volume.

Where two labels meet, a field of their own decides between them (walls.py). What is no label has a field too: beside
fields that are distances it is below 0 where any other is above; beside smoothed indicators, which add up to 1, it is
what the others leave of it.

Labels are counted from 1 here, in the order of their values; 0 is no label.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...machine.parallel import map_steps
from ...progress import Steps
from ..grid import Axis
from .label_samples import LabelSamples

SAMPLES_AT_ONCE = 1 << 20


@dataclass(frozen=True, eq=False)
class Owners:
    """The owners of a grid's samples.

    Parameters
    ----------
    x, y, z : Axis
        Axes with a closed border: the outermost samples belong to no label.
    number : (z.count, y.count, x.count) unsigned
        Label that owns a sample, counted from 1; 0 is no label.
    largest : same shape, float32, or None
        The largest field, where fields decide who owns a sample.
    total : same shape, float32, or None
        The sum of all fields, where these are indicators.
    """

    x: Axis
    y: Axis
    z: Axis
    number: NDArray[Any]
    largest: NDArray[np.float32] | None = None
    total: NDArray[np.float32] | None = None


def owner_type(labels: int) -> np.dtype[Any]:
    """Return the smallest type that can number the labels and 0."""
    return np.min_scalar_type(labels)


def owners_bytes(samples: int, voxels: int, labels: int, indicators: bool, between: bool) -> int:
    """Return the bytes for the owners of some samples, and for the labels of the voxels they come from.

    `between` if there are slices between those of the labels.
    """
    return (samples + voxels) * owner_type(labels).itemsize + samples * 4 * ((indicators or between) + indicators)


def owners_steps(
    axes: tuple[Axis, Axis, Axis],
    number: NDArray[Any],
    layers: Sequence[int],
    fields: Sequence[LabelSamples],
    walls: Mapping[tuple[int, int], LabelSamples],
    indicators: bool,
    filled: Callable[[int], NDArray[np.bool_] | None],
    threads: int,
) -> Steps[Owners]:
    """Return the owners of all samples of a grid.

    Parameters
    ----------
    axes : three Axis
        Along x, y and z, with a closed border.
    number : (z.count, y.count, x.count) unsigned
        The owners that are known, as in `Owners`; changed in place.
    layers : sequence of int
        Layers of the grid along z, rising, without the outermost: those whose owners the fields decide.
    fields : sequence of LabelSamples
        Fields in the order of the labels' values; of equal fields the first one's label is the owner.
    walls : mapping of (first, second) to LabelSamples
        The field between two labels, above 0 in the first: decides between them where theirs are the largest two.
    indicators : bool
        Whether fields are smoothed indicators, which add up to 1 with what is no label.
    filled : function
        Takes a position along z; returns which samples there, (rows, columns) without the outermost, have a label
        before and another behind, so that they cannot be nobody's; None where none have.
    threads : int
    """
    x, y, z = axes
    total = np.zeros(number.shape, np.float32) if indicators else None
    largest = np.zeros(number.shape, np.float32) if layers else None
    columns, rows = x.index[1:-1], y.index[1:-1]

    def own(part: Sequence[int]) -> None:
        inner = (np.array(part), slice(1, -1), slice(1, -1))
        slices = z.index[inner[0]]
        owner = np.zeros((len(part), len(rows), len(columns)), number.dtype)
        best = np.full(owner.shape, -np.inf, np.float32)
        next_best = best.copy() if walls else None
        following = np.zeros_like(owner)  # whose field is the next best
        added = None if total is None else np.zeros_like(best)
        for label, samples in enumerate(fields, 1):
            in_window = samples.part(columns, rows, slices)
            if in_window is None:
                continue
            where, values = in_window
            is_best = values > best[where]
            if next_best is not None:
                is_next = ~is_best & (values > next_best[where])
                np.copyto(next_best[where], values, where=is_next)
                np.copyto(following[where], owner.dtype.type(label), where=is_next)
                np.copyto(next_best[where], best[where], where=is_best)
                np.copyto(following[where], owner[where], where=is_best)
            np.copyto(best[where], values, where=is_best)
            np.copyto(owner[where], owner.dtype.type(label), where=is_best)
            if added is not None:
                added[where] += values
        for (first, second), samples in walls.items():
            in_window = samples.part(columns, rows, slices)
            if in_window is None:
                continue
            where, values = in_window
            mine, neighbor = owner[where], following[where]
            is_between = ((mine == first) & (neighbor == second)) | ((mine == second) & (neighbor == first))
            np.copyto(mine, owner.dtype.type(first), where=is_between & (values > 0))
            np.copyto(mine, owner.dtype.type(second), where=is_between & (values <= 0))
        nobodys = best < 0 if added is None else 1 - added > best
        for layer, slice_ in zip(nobodys, slices.tolist(), strict=True):
            between = filled(slice_)
            if between is not None:
                layer &= ~between
        owner[nobodys] = 0
        number[inner] = owner
        if largest is not None:
            largest[inner] = best
        if total is not None:
            total[inner] = added

    step = max(1, SAMPLES_AT_ONCE // (len(rows) * len(columns)))
    yield from map_steps(own, [layers[low : low + step] for low in range(0, len(layers), step)], threads)
    return Owners(x, y, z, number, largest, total)
