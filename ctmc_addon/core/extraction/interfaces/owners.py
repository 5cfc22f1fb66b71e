# SPDX-License-Identifier: GPL-3.0-or-later
"""Which label owns a sample: the one with the largest field, or none.

What is no label has a field too. Beside fields that are distances it is below 0 where any other is above; beside
smoothed indicators, which add up to 1, it is what the others leave of it.

Labels are counted from 1 here, in the order of their values; 0 is no label.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...parallel import map_steps
from ...progress import Steps
from ..grid import Axis
from .label_samples import LabelSamples

SAMPLES_AT_ONCE = 1 << 20
BELOW_ZERO = np.float32(-1e-30)


@dataclass(frozen=True, eq=False)
class Owners:
    """The owners of a grid's samples.

    Parameters
    ----------
    x, y, z : Axis
        With a closed border: the outermost samples are nobody's.
    number : (z.count, y.count, x.count) unsigned
        Which label owns a sample, counted from 1; 0 is no label.
    total : same shape, float32, or None
        The sum of all fields, where these are indicators.
    """

    x: Axis
    y: Axis
    z: Axis
    number: NDArray[Any]
    total: NDArray[np.float32] | None = None


def owner_type(labels: int) -> np.dtype[Any]:
    """Return the smallest type that numbers so many labels and 0."""
    return np.min_scalar_type(labels)


def owners_bytes(samples: int, labels: int, indicators: bool) -> int:
    """Bytes that the owners of so many samples take."""
    return samples * (owner_type(labels).itemsize + 4 * indicators)


def owners_steps(
    axes: tuple[Axis, Axis, Axis], fields: Sequence[LabelSamples], indicators: bool, threads: int
) -> Steps[Owners]:
    """Return the owners of all samples of a grid.

    Parameters
    ----------
    axes : three Axis
        Along x, y and z, with a closed border.
    fields : sequence of LabelSamples
        In the order of the labels' values; of equal fields the first one's label is the owner.
    indicators : bool
        Whether fields are smoothed indicators, which add up to 1 with what is no label.
    threads : int
    """
    x, y, z = axes
    shape = (z.count, y.count, x.count)
    number = np.zeros(shape, owner_type(len(fields)))
    total = np.zeros(shape, np.float32) if indicators else None
    columns, rows = x.index[1:-1], y.index[1:-1]

    def own(layers: tuple[int, int]) -> None:
        low, high = layers
        owner = number[low:high, 1:-1, 1:-1]
        best = np.full(owner.shape, BELOW_ZERO, np.float32)
        of_all = None if total is None else total[low:high, 1:-1, 1:-1]
        for label, samples in enumerate(fields, 1):
            part = samples.part(columns, rows, z.index[low:high])
            if part is None:
                continue
            where, values = part
            nearest = best[where]
            larger = values > nearest
            np.copyto(nearest, values, where=larger)
            np.copyto(owner[where], owner.dtype.type(label), where=larger)
            if of_all is not None:
                of_all[where] += values
        if of_all is not None:
            owner[1 - of_all > best] = 0

    step = max(1, SAMPLES_AT_ONCE // (shape[1] * shape[2]))
    ranges = [(low, min(low + step, shape[0] - 1)) for low in range(1, shape[0] - 1, step)]
    yield from map_steps(own, ranges, threads)
    return Owners(x, y, z, number, total)
