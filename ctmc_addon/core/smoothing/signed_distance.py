# SPDX-License-Identifier: GPL-3.0-or-later
"""Distance from samples near a label's surface to the nearest sample on the other side, in millimeters.

Exact within a box of `reach` samples to either side, axis by axis (Felzenszwalb and Huttenlocher 2012, by brute
force, since the reach is short). One array serves both sides: inside samples carry their squared distance with a
plus, outside samples with a minus. For a sample inside, a neighbor's plus is its distance to the outside, and a
minus means that the neighbor itself is outside: distance zero. So max(value, 0) is the distance, and with the
signs turned the same holds outside.

Rows without a change near a brick are all alike there, so only bricks beside a change are looked at along their row.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Floats
from ..machine.parallel import Threads
from ..progress import Step, Steps
from .bricks import WIDTH, Bricks, Places, changes_along_x, over_rows


def signed_distance_steps(
    code: NDArray[np.uint8],
    bricks: Bricks,
    spacing_mm: tuple[float, float, float],
    reach: tuple[int, int, int],
    farthest_mm: float,
    pool: Threads | None,
    every: int = 1,
) -> Steps[Floats]:
    """Signed distances, positive inside.

    Parameters
    ----------
    code : (slices, rows, bricks) uint8
        The label, as `bricks.packed` gives it.
    bricks : Bricks
        Bricks of the label's own grid, or of every other sample along x and y.
    spacing_mm, reach : (x, y, z)
        Spacing of the label's grid, and samples looked at to either side, at most 8 along x.
    farthest_mm : float
        Given where the other side is farther.
    every : int
        2 where bricks have every other sample along x and y, the first among them; else 1.

    Returns
    -------
    (len(bricks), 8) float32
    """
    farthest = np.float32(farthest_mm * farthest_mm)
    number, squares = _along_x(code, spacing_mm[0], reach[0], farthest, pool, every)
    yield Step(0.3)
    for axis, numbers, scale, share in ((1, number, every, 0.6), (0, bricks.number, 1, 1.0)):
        steps = _squared_steps(spacing_mm[2 - axis], reach[2 - axis])
        nearer = np.empty((len(bricks), WIDTH), np.float32)
        nearer[-2], nearer[-1] = farthest, -farthest
        across = _across(bricks, axis, numbers, scale, [step for step in steps if step < farthest], squares, nearer)
        over_rows(pool, across, len(bricks.place))
        squares = nearer
        yield Step(share)
    return np.copysign(np.sqrt(np.abs(squares)), squares)


def _squared_steps(side_mm: float, count: int) -> list[np.float32]:
    """Return the squares of 1, 2, ... steps."""
    return [np.float32(step * side_mm * (step * side_mm)) for step in range(1, count + 1)]


def _along_x(
    code: NDArray[np.uint8], side_mm: float, reach: int, farthest: np.float32, pool: Threads | None, every: int
) -> tuple[NDArray[np.int32], Floats]:
    """Return signed squares of the distance along x only, and the number of the brick that has them."""
    near = changes_along_x(code, reach)
    if every > 1 and code.shape[2] % 2:
        code = np.concatenate([code, (code[:, :, -1:] & 1) * np.uint8(255)], axis=2)
        near = np.concatenate([near, near[:, :, -1:]], axis=2)
    if every > 1:
        near = near[:, :, ::2] | near[:, :, 1::2]
    place = np.flatnonzero(near)
    number = np.where(code[:, :, ::every] != 0, np.int32(len(place)), np.int32(len(place) + 1))
    number.ravel()[place] = np.arange(len(place), dtype=np.int32)
    squares = np.empty((len(place) + 2, WIDTH), np.float32)
    squares[-2], squares[-1] = farthest, -farthest
    # Squares of samples whose other side is 1, 2, ... steps along x away, or beyond reach: outside, then inside.
    ways = [min(square, farthest) for square in _squared_steps(side_mm, reach)] + [farthest]
    signed = np.array([[-square for square in ways], ways], np.float32).ravel()
    flat, wide = code.ravel(), code.shape[2]
    low = np.uint32(2 ** (8 * every) - 1)

    def along_row(part: slice) -> None:
        first = place[part] * every
        x = first % wide
        own: NDArray[Any] = flat[first].astype(np.uint32)
        if every > 1:
            own = own << 8 | flat[first + 1]
        ends = ((own >> 8 * every - 1) * np.uint32(255), (own & 1) * np.uint32(255))
        before = np.where(x > 0, flat[np.maximum(first - 1, 0)], ends[0])
        after = np.where(x + every < wide, flat[np.minimum(first + every, flat.size - 1)], ends[1])
        # The brick's samples and 8 to either side in a number: shifted by a step, all are compared at once.
        row = before << np.uint32(8 + 8 * every) | own << 8 | after
        index = np.unpackbits(_sampled(own, every)) * np.uint8(reach + 1)
        same = np.full(len(own), low, np.uint32)  # samples with none on the other side so far
        for step in range(1, reach + 1):
            same &= ~((row ^ (row << step)) | (row ^ (row >> step))) >> 8
            index += np.unpackbits(_sampled(same, every))
        squares[part] = signed.take(index).reshape(-1, WIDTH)

    over_rows(pool, along_row, len(place))
    return number, squares


def _sampled(bits: NDArray[Any], every: int) -> NDArray[np.uint8]:
    """The bits of a brick's samples: of 16 every other one, beginning with the highest."""
    if every > 1:
        bits = bits >> 1 & np.uint32(0x5555)
        for step, kept in ((1, 0x3333), (2, 0x0F0F), (4, 0x00FF)):
            bits = (bits | bits >> step) & np.uint32(kept)
    return bits.astype(np.uint8)


def _across(
    bricks: Bricks,
    axis: int,
    number: NDArray[np.int32],
    scale: int,
    steps: list[np.float32],
    squares: Floats,
    nearer: Floats,
) -> Callable[[slice], None]:
    """Return the function that lowers `nearer` to the squares of bricks along an axis, 1 for y and 0 for z.

    `number` has the rows of `squares`, `scale` times as dense along y; `steps` are the squares of its steps.
    """
    # Beyond the border the brick at the border: with a margin of them, a step is a number to add.
    more = [len(steps) * (axis == each) for each in (0, 1)]
    around = np.pad(number, ((more[0], more[0]), (more[1], more[1]), (0, 0)), mode="edge")
    pitch = (around.shape[1] * around.shape[2], around.shape[2])
    flat = around.ravel()

    def across(part: slice) -> None:
        z, y, x = bricks.coordinates(part)
        place: Places = (z + more[0]) * pitch[0] + (y * scale + more[1]) * pitch[1] + x
        best = squares.take(flat.take(place), axis=0)
        side = np.copysign(np.float32(1), best)
        np.abs(best, out=best)
        before, after = np.empty_like(best), np.empty_like(best)
        for step, extra in enumerate(steps, 1):
            for through, moved in ((before, -step), (after, step)):
                squares.take(flat.take(place + moved * pitch[axis]), axis=0, out=through, mode="clip")
                through *= side
            np.minimum(before, after, out=before)
            np.maximum(before, np.float32(0), out=before)
            before += extra
            np.minimum(best, before, out=best)
        np.multiply(best, side, out=nearer[part])

    return across
