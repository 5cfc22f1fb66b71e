# SPDX-License-Identifier: GPL-3.0-or-later
"""The field between two labels that touch, smoothed for their wall alone.

Half the difference of both labels' fields is smoothed near where it is 0, within the signs at the samples of both; no
other sample binds it, so the wall does not bend where it ends. What smoothing flattens is given back along the wall
(local_volume.py).
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from ...budget import Budget
from ...progress import PAUSE, Steps
from .bounds import NEAREST_ZERO
from .bricks import WIDTH, near_surface, number_bricks, packed
from .local_volume import keep_local_volume_steps
from .relaxation import relax_steps

REACH = (4, 4, 4)  # samples beside a wall that are smoothed
ROUNDS = 60


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
    pool = ThreadPoolExecutor(workers) if workers > 1 else None
    try:
        yield PAUSE
        slices, rows, columns = field.shape
        pads = ((0, 0), (0, 0), (0, -columns % WIDTH))
        padded = np.pad(field, pads, mode="edge")
        near = near_surface(packed(padded > 0), REACH)
        bricks = number_bricks(near, near)
        values = np.zeros((len(bricks), WIDTH), np.float32)
        values[:-2] = padded.reshape(-1, WIDTH).take(bricks.place, axis=0)
        yield PAUSE
        known = np.zeros((slices, rows, columns), np.int8)
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
        smooth = padded[..., :columns]
        yield from keep_local_volume_steps(smooth, sign, spacing_mm, slice_steps)
        return smooth
    finally:
        if pool:
            pool.shutdown(cancel_futures=True)
