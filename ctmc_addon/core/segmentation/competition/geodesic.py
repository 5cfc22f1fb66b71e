# SPDX-License-Identifier: GPL-3.0-or-later
"""Geodesic times from a click by sweeps over planes.

A time counts millimeters and differences of values. It is a whole number of 1/32 mm, so the bytes are the same
everywhere. A sweep hands times from plane to plane, to the sample straight ahead and the four beside it; six sweeps,
one along each direction, are a round (after Criminisi et al. 2008, doi:10.1007/978-3-540-88682-2_9).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...arrays import Ints
from ...progress import Step, Steps
from ..distance import Spacing

Times = NDArray[np.uint32]
UNIT = 32  # A millimeter is this many steps of time.
NEVER = 1 << 30
BLOCKED = 1 << 28  # A difference of heights after which no time is left, up or down.
ROUNDS = 3


def cost_of(mm: float) -> int:
    """Return a length as a difference of times.

    Examples
    --------
    >>> cost_of(0.5)
    16
    """
    return round(mm * UNIT)


def heights_of(values: NDArray[np.float32], units_per_mm: float) -> Ints:
    """Return values as integers whose differences are times; `units_per_mm` units of values are a millimeter."""
    return np.rint(values * np.float32(UNIT / units_per_mm)).astype(np.int32)


def sweep_steps(times: Times, heights: Ints, spacing_mm: Spacing, rounds: int = ROUNDS) -> Steps[Times]:
    """Lower the times of all samples to those that the neighbors' times and steps allow.

    Parameters
    ----------
    times : (slices, rows, columns) uint32
        0 where time begins, `NEVER` elsewhere.
    heights : (slices, rows, columns) int32
        As of `heights_of`; `BLOCKED` is added where no way leads through.
    spacing_mm : (x, y, z) float
    rounds : int
        Rounds at most; fewer if nothing changes any more.
    """
    sides = list(reversed(spacing_mm))
    for number in range(rounds):
        before = times
        for axis in range(3):
            order = (axis, *(across for across in range(3) if across != axis))
            turned = np.array(times.transpose(order), order="C")  # a copy: a sweep writes into it
            ground = np.ascontiguousarray(heights.transpose(order))
            costs = [sides[axis], *(math.hypot(sides[axis], sides[across]) for across in order[1:])]
            for forward in (True, False):
                _sweep(turned, ground, [np.uint32(cost_of(cost)) for cost in costs], forward)
                yield Step((number + (axis + forward / 2) / 3) / rounds)
            times = np.ascontiguousarray(turned.transpose(np.argsort(order)))
        if np.array_equal(times, before):
            break
    return times


def _sweep(times: Times, heights: Ints, costs: list[np.uint32], forward: bool) -> None:
    """Hand times on from plane to plane, in place."""
    planes = range(1, len(times)) if forward else range(len(times) - 2, -1, -1)
    every, head, tail = slice(None), slice(1, None), slice(None, -1)
    ways = [
        ((every, every), (every, every), costs[0]),
        ((head, every), (tail, every), costs[1]),
        ((tail, every), (head, every), costs[1]),
        ((every, head), (every, tail), costs[2]),
        ((every, tail), (every, head), costs[2]),
    ]
    room = np.empty(times.shape[1:], np.int32)
    for plane in planes:
        last = plane - 1 if forward else plane + 1
        for to, of, cost in ways:
            step = room[to]
            np.subtract(heights[plane][to], heights[last][of], out=step)
            np.abs(step, out=step)
            through = step.view(np.uint32)
            through += times[last][of]
            through += cost
            own = times[plane][to]
            np.minimum(own, through, out=own)
