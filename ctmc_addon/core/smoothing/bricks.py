# SPDX-License-Identifier: GPL-3.0-or-later
"""The part of a grid near a label's surface, as a list of bricks: 8 samples beside one another along x.

Everything that smooths works on arrays of (bricks, 8). A neighbor along y or z is another brick, fetched 32 bytes
at a time, which costs NumPy a fourth of fetching single samples; a neighbor along x is mostly in the brick itself.
The bricks near the surface come first, in the order of the grid; then their neighbors, which only lend their
values; then two bricks that stand for all others, one deep inside the label and one far outside it.

    samples of a row   |........|........|######..|........|      # inside
    its bricks             -1        0        0       -1          distance from the surface, in bricks
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..machine.parallel import Threads, parts_of, spread

Places = NDArray[np.intp]

WIDTH = 8
# Bricks of a piece of work, whose buffers are 1 MiB each: shorter ones take longer, since every call has a start of its
# own. Threads get two pieces each, but none shorter than the second number.
ROWS_AT_ONCE, FEWEST_ROWS = 1 << 15, 1 << 13


@dataclass(frozen=True, eq=False)
class Bricks:
    """Bricks of one grid.

    Parameters
    ----------
    shape : (slices, rows, bricks)
        Shape of the whole grid.
    active : int
        Number of bricks near the surface; they have the lowest numbers.
    place : (n,) intp
        Flat place in the grid of every active brick, then of every neighbor.
    number : (slices, rows, bricks) int32
        The number of the brick at every place: below n, or n deep inside, n + 1 far outside.
    """

    shape: tuple[int, int, int]
    active: int
    place: Places
    number: NDArray[np.int32]

    def __len__(self) -> int:
        """Number of rows an array over these bricks has, the two for all others among them."""
        return len(self.place) + 2

    def at(self, z: Places, y: Places, x: Places) -> Places:
        """Numbers of the bricks at these places; beyond the border that of the brick at the border."""
        nz, ny, nx = self.shape
        z, y, x = np.clip(z, 0, nz - 1), np.clip(y, 0, ny - 1), np.clip(x, 0, nx - 1)
        return self.number.ravel().take((z * ny + y) * nx + x).astype(np.intp)

    def coordinates(self, part: slice = slice(None)) -> tuple[Places, Places, Places]:
        """Slice, row and brick along the row of the bricks in the list."""
        _, ny, nx = self.shape
        line, x = np.divmod(self.place[part], nx)
        z, y = np.divmod(line, ny)
        return z, y, x


def number_bricks(active: NDArray[np.bool_], inside: NDArray[np.bool_], neighbors: bool = True) -> Bricks:
    """List the active bricks and their neighbors.

    Parameters
    ----------
    active : (slices, rows, bricks) bool
    inside : (slices, rows, bricks) bool
        Bricks inside that are not in the list.
    neighbors : bool
        Whether neighbors are wanted.
    """
    place = np.flatnonzero(active)
    count = len(place)
    if neighbors:
        around = active.copy()
        for axis in range(3):
            around |= widened(active, 1, axis)
        around &= ~active
        place = np.concatenate([place, np.flatnonzero(around)])
    number = np.where(inside, np.int32(len(place)), np.int32(len(place) + 1))
    number.ravel()[place] = np.arange(len(place), dtype=np.int32)
    shape: tuple[int, int, int] = active.shape  # type: ignore[assignment]
    return Bricks(shape, count, place, number)


def widened(flags: NDArray[np.bool_], reach: int, axis: int) -> NDArray[np.bool_]:
    """Flags, set also up to `reach` places before and after along an axis.

    Examples
    --------
    >>> widened(np.array([0, 0, 0, 1, 0, 0], bool), 2, 0).astype(int).tolist()
    [0, 1, 1, 1, 1, 1]
    """
    wide = flags.copy()
    along, into = np.moveaxis(flags, axis, 0), np.moveaxis(wide, axis, 0)
    for step in range(1, min(reach, len(along) - 1) + 1):
        into[step:] |= along[:-step]
        into[:-step] |= along[step:]
    return wide


def packed(mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """A mask with a byte for every brick, the lowest x in the highest bit; a last, partial brick repeats its last."""
    missing = -mask.shape[2] % WIDTH
    code = np.packbits(mask, axis=2)
    if missing:
        code[:, :, -1] |= np.where(mask[:, :, -1], np.uint8(2**missing - 1), np.uint8(0))
    return code


def near_surface(code: NDArray[np.uint8], reach: tuple[int, int, int]) -> NDArray[np.bool_]:
    """Return the bricks with a sample at most `reach` (x, y, z) samples, 8 along x, from the surface.

    A sample is at the surface if the label differs between it and a neighbor.

    Parameters
    ----------
    code : (slices, rows, bricks) uint8
        As `packed` gives it.
    """
    after = np.concatenate([code[:, :, 1:], (code[:, :, -1:] & 1) << 7], axis=2)
    change = code ^ ((code << 1) | (after >> 7))  # bit i: sample i differs from i + 1
    last = np.concatenate([np.zeros_like(change[:, :, :1]), change[:, :, :-1]], axis=2)
    change |= (change >> 1) | (last << 7)  # and sample i + 1 from i
    for axis in (0, 1):
        both = [np.moveaxis(array, axis, 0) for array in (code, change)]
        turns = both[0][1:] ^ both[0][:-1]
        both[1][1:] |= turns
        both[1][:-1] |= turns
    near = change != 0
    low, high = np.uint8(2 ** reach[0] - 1), np.uint8(256 - 2 ** (WIDTH - reach[0]))
    near[:, :, 1:] |= (change[:, :, :-1] & low) != 0
    near[:, :, :-1] |= (change[:, :, 1:] & high) != 0
    return widened(widened(near, reach[1], 1), reach[2], 0)


def changes_along_x(code: NDArray[np.uint8], reach: int) -> NDArray[np.bool_]:
    """Bricks with a sample at most `reach` samples, 8 at most, from one along x at which the label differs."""
    after = np.concatenate([code[:, :, 1:], (code[:, :, -1:] & 1) << 7], axis=2)
    change = code ^ ((code << 1) | (after >> 7))  # bit i: sample i differs from i + 1
    near = change != 0
    near[:, :, 1:] |= (change[:, :, :-1] & np.uint8(2**reach - 1)) != 0
    near[:, :, :-1] |= (change[:, :, 1:] & np.uint8(256 - 2 ** (WIDTH + 1 - reach))) != 0
    return near


def over_rows(pool: Threads | None, work: Callable[[slice], None], count: int) -> None:
    """Call `work` for slices that cover all rows."""
    at_once = ROWS_AT_ONCE
    if pool is not None:
        at_once = min(at_once, max(FEWEST_ROWS, -(-count // (2 * pool.count))))
    spread(pool, work, parts_of(count, at_once))
