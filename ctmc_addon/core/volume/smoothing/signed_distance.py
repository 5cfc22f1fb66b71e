# SPDX-License-Identifier: GPL-3.0-or-later
"""Distance from every sample near a label's surface to the nearest sample on the other side, in millimeters.

Exact within a box of `reach` samples to either side, axis by axis (Felzenszwalb and Huttenlocher 2012, by brute
force, since the reach is short). One array serves both sides: inside samples carry their squared distance with a
plus, outside samples with a minus. For a sample inside, a neighbor's plus is its distance to the outside, and a
minus means that the neighbor itself is outside: distance zero. So max(value, 0) is the distance, and with the
signs turned the same holds outside.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from ...progress import Step, Steps
from .bricks import WIDTH, Bricks, Floats, Threads, over_rows


def signed_distance_steps(
    code: NDArray[np.uint8],
    bricks: Bricks,
    spacing_mm: tuple[float, float, float],
    reach: tuple[int, int, int],
    farthest_mm: float,
    pool: Threads | None,
) -> Steps[Floats]:
    """Signed distances, positive inside.

    Parameters
    ----------
    code : (slices, rows, bricks) uint8
        The label, as `bricks.packed` gives it.
    bricks : Bricks
        Of the label's own grid.
    spacing_mm, reach : (x, y, z)
        Of the label's grid; how many samples are looked at to either side, at most 8 along x.
    farthest_mm : float
        Given where the other side is farther.

    Returns
    -------
    (len(bricks), 8) float32
    """
    farthest = np.float32(farthest_mm * farthest_mm)
    squares = np.empty((len(bricks), WIDTH), np.float32)
    squares[-2], squares[-1] = farthest, -farthest
    # Squares of samples whose other side is 1, 2, ... steps along x away, or beyond reach: outside, then inside.
    along_x = [min(np.float32((step * spacing_mm[0]) ** 2), farthest) for step in range(1, reach[0] + 1)] + [farthest]
    signed = np.array([[-square for square in along_x], along_x], np.float32).ravel()
    flat, (_, _, wide) = code.ravel(), bricks.shape

    def along_row(part: slice) -> None:
        place = bricks.place[part]
        x = place % wide
        own = flat[place]
        before = np.where(x > 0, flat[np.maximum(place - 1, 0)], (own >> 7) * np.uint8(255))
        after = np.where(x < wide - 1, flat[np.minimum(place + 1, flat.size - 1)], (own & 1) * np.uint8(255))
        # 24 samples in a number: shifted by a step, all are compared at once.
        row = before.astype(np.uint32) << 16 | own.astype(np.uint32) << 8 | after
        number = np.unpackbits(own) * np.uint8(reach[0] + 1)
        same = np.full(len(own), 255, np.uint8)  # samples with none on the other side so far
        for step in range(1, reach[0] + 1):
            same &= ~(((row ^ (row << step)) | (row ^ (row >> step))) >> 8).astype(np.uint8)
            number += np.unpackbits(same)
        squares[part] = signed.take(number).reshape(-1, WIDTH)

    over_rows(pool, along_row, len(bricks.place))
    yield Step(0.3)

    # Beyond the border the brick at the border: with a margin of them, a step is a number to add.
    _, more_y, more_z = reach
    around = np.pad(bricks.number, ((more_z, more_z), (more_y, more_y), (0, 0)), mode="edge")
    pitch = (around.shape[1] * wide, wide)
    flat_around = around.ravel()

    def across(axis: int, nearer: Floats, part: slice) -> None:
        z, y, x = bricks.coordinates(part)
        place = (z + more_z) * pitch[0] + (y + more_y) * pitch[1] + x
        side = np.copysign(np.float32(1), squares[part])
        best = np.abs(squares[part])
        before, after = np.empty_like(best), np.empty_like(best)
        for step in range(1, reach[2 - axis] + 1):
            extra = np.float32((step * spacing_mm[2 - axis]) ** 2)
            if extra >= farthest:
                break
            for through, moved in ((before, -step), (after, step)):
                squares.take(flat_around.take(place + moved * pitch[axis]), axis=0, out=through, mode="clip")
                through *= side
            np.minimum(before, after, out=before)
            np.maximum(before, np.float32(0), out=before)
            before += extra
            np.minimum(best, before, out=best)
        np.multiply(best, side, out=nearer[part])

    for axis, share in ((1, 0.6), (0, 1.0)):
        nearer = squares.copy()
        over_rows(pool, partial(across, axis, nearer), len(bricks.place))
        squares = nearer
        yield Step(share)
    return np.copysign(np.sqrt(np.abs(squares)), squares)
