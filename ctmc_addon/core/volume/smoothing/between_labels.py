# SPDX-License-Identifier: GPL-3.0-or-later
"""The field between two labels that touch, smoothed for their wall alone.

Half the difference of both labels' fields is smoothed near where it is 0, within the signs at the samples of both; no
other sample binds it, so the wall does not bend where it ends. What smoothing flattens is given back along the wall
(local_volume.py), twice: the first time on coarser pixels alone, which costs little and leaves less to flatten.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...budget import Budget
from ...progress import PAUSE, Steps
from .bounds import NEAREST_ZERO
from .bricks import WIDTH, Floats, Threads, near_surface, number_bricks, packed
from .local_volume import keep_local_volume_steps
from .relaxation import relax_steps

REACH = (2, 2, 2)  # samples beside a wall that are smoothed
# Every how many pixels are smoothed before all are, by the steps from slice to slice: 1, 2 or more.
SKIPPED: tuple[tuple[int, ...], ...] = ((2,), (4, 2), (8, 4, 2))
ROUNDS = 30


def between_labels_steps(
    field: NDArray[np.float32],
    sign: NDArray[np.int8],
    spacing_mm: tuple[float, float, float],
    slice_steps: int,
    budget: Budget,
) -> Steps[NDArray[np.float32]]:
    """Smooth a field near where it is 0, within the signs that are known.

    Parameters
    ----------
    field : ((slices - 1) * slice_steps + 1, rows, columns) float32, millimeters
        On the refined grid; about the distance to its surface.
    sign : (slices, rows, columns) int8
        1 or -1 where the field must be above or below 0, and 0 where it is free.
    spacing_mm : (x, y, z) float
        Of the samples that have signs.
    slice_steps : int
        Steps from slice to slice.

    Returns
    -------
    array like `field`
    """
    workers = budget.thread_count
    pool = Threads(workers) if workers > 1 else None
    try:
        for is_last in (False, True):
            for skip in SKIPPED[min(slice_steps, 3) - 1]:
                coarse = field[:, ::skip, ::skip]
                sides = (spacing_mm[0] * skip, spacing_mm[1] * skip, spacing_mm[2])
                smooth = yield from _relaxed_steps(coarse, sign[:, ::skip, ::skip], sides, slice_steps, pool)
                change = smooth - coarse
                for axis in (1, 2):
                    change = _between(change, skip, axis, field.shape[axis])
                field = field + change
            if is_last:
                field = yield from _relaxed_steps(field, sign, spacing_mm, slice_steps, pool)
            yield from keep_local_volume_steps(field, sign, spacing_mm, slice_steps)
        return field
    finally:
        if pool:
            pool.shutdown(cancel_futures=True)


def _relaxed_steps(
    field: Floats,
    sign: NDArray[np.int8],
    spacing_mm: tuple[float, float, float],
    slice_steps: int,
    pool: Threads | None,
) -> Steps[Floats]:
    """The field, of less curvature near where it is 0."""
    yield PAUSE
    above = field > 0
    if above.all() or not above.any():
        return field
    columns = field.shape[2]
    pads = ((0, 0), (0, 0), (0, -columns % WIDTH))
    padded = np.pad(field, pads, mode="edge")
    near = near_surface(packed(padded > 0), REACH)
    bricks = number_bricks(near, near)
    values = np.zeros((len(bricks), WIDTH), np.float32)
    values[:-2] = padded.reshape(-1, WIDTH).take(bricks.place, axis=0)
    yield PAUSE
    known = np.zeros(field.shape, np.int8)
    known[::slice_steps] = sign
    for step in range(1, slice_steps):
        known[step::slice_steps] = np.where(sign[1:] == sign[:-1], sign[1:], np.int8(0))
    known = np.pad(known, pads).reshape(-1, WIDTH).take(bricks.place[: bricks.active], axis=0)
    least = np.float32(NEAREST_ZERO * min(spacing_mm))
    low = np.where(known > 0, least, np.float32(-np.inf))
    high = np.where(known < 0, -least, np.float32(np.inf))
    yield PAUSE
    x, y, z = spacing_mm
    yield from relax_steps(bricks, values, low, high, (x, y, z / slice_steps), ROUNDS, pool)
    padded.reshape(-1, WIDTH)[bricks.place[: bricks.active]] = values[: bricks.active]
    return padded[..., :columns]


def _between(values: Floats, skip: int, axis: int, count: int) -> Floats:
    """Values at every `skip`-th of `count` samples along an axis, linear between these."""
    place = np.arange(count)
    low = place // skip
    high = np.minimum(low + 1, values.shape[axis] - 1)
    share = ((place - low * skip) / np.float32(skip)).astype(np.float32)
    share = share.reshape([-1 if each == axis else 1 for each in range(3)])
    first = values.take(low, axis=axis)
    return first + (values.take(high, axis=axis) - first) * share
