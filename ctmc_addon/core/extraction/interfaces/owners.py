# SPDX-License-Identifier: GPL-3.0-or-later
"""Which label owns a sample: the one with the largest field, or none.

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

from ...parallel import map_steps
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
        With a closed border: the outermost samples are nobody's.
    number : (z.count, y.count, x.count) unsigned
        Which label owns a sample, counted from 1; 0 is no label.
    largest : same shape, float32, or None
        The largest field, where labels are smoothed.
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
    """Return the smallest type that numbers so many labels and 0."""
    return np.min_scalar_type(labels)


def owners_bytes(samples: int, labels: int, indicators: bool) -> int:
    """Bytes that the owners of so many samples take."""
    return samples * (owner_type(labels).itemsize + 4 + 4 * indicators)


def owners_steps(
    axes: tuple[Axis, Axis, Axis],
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
    fields : sequence of LabelSamples
        In the order of the labels' values; of equal fields the first one's label is the owner.
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
    shape = (z.count, y.count, x.count)
    number = np.zeros(shape, owner_type(len(fields)))
    total = np.zeros(shape, np.float32) if indicators else None
    largest = np.zeros(shape, np.float32)
    columns, rows = x.index[1:-1], y.index[1:-1]

    def own(layers: tuple[int, int]) -> None:
        low, high = layers
        inner = (slice(low, high), slice(1, -1), slice(1, -1))
        owner, best, slices = number[inner], largest[inner], z.index[low:high]
        next_best = np.full(owner.shape, -np.inf, np.float32) if walls else None
        following = np.zeros_like(owner)  # whose field is the next best
        best[...] = -np.inf
        for label, samples in enumerate(fields, 1):
            part = samples.part(columns, rows, slices)
            if part is None:
                continue
            where, values = part
            is_best = values > best[where]
            if next_best is not None:
                is_next = ~is_best & (values > next_best[where])
                np.copyto(next_best[where], values, where=is_next)
                np.copyto(following[where], owner.dtype.type(label), where=is_next)
                np.copyto(next_best[where], best[where], where=is_best)
                np.copyto(following[where], owner[where], where=is_best)
            np.copyto(best[where], values, where=is_best)
            np.copyto(owner[where], owner.dtype.type(label), where=is_best)
            if total is not None:
                total[inner][where] += values
        for (first, second), samples in walls.items():
            part = samples.part(columns, rows, slices)
            if part is None:
                continue
            where, values = part
            mine, other = owner[where], following[where]
            is_between = ((mine == first) & (other == second)) | ((mine == second) & (other == first))
            np.copyto(mine, owner.dtype.type(first), where=is_between & (values > 0))
            np.copyto(mine, owner.dtype.type(second), where=is_between & (values <= 0))
        nobodys = best < 0 if total is None else 1 - total[inner] > best
        for layer, slice_ in zip(nobodys, slices.tolist(), strict=True):
            between = filled(slice_)
            if between is not None:
                layer &= ~between
        owner[nobodys] = 0

    step = max(1, SAMPLES_AT_ONCE // (shape[1] * shape[2]))
    ranges = [(low, min(low + step, shape[0] - 1)) for low in range(1, shape[0] - 1, step)]
    yield from map_steps(own, ranges, threads)
    return Owners(x, y, z, number, largest, total)
