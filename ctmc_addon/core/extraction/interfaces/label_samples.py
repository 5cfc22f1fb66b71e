# SPDX-License-Identifier: GPL-3.0-or-later
"""The field of one label on the grid that all labels share, held where it is not constant.

Positions on that grid are indices of the volume along x and y; along z they count refined slices from the volume's
first one. A field is constant except near its label's surface, so bricks of 8 samples along x that are all lowest or
all highest are not kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...progress import PAUSE, Steps
from ...volume.field import ScalarField, held_steps
from ...volume.volume import Box

BRICK = 8
BRICKS_AT_ONCE = 1 << 16


@dataclass(frozen=True, eq=False)
class LabelSamples:
    """A label's field in its window.

    Parameters
    ----------
    box : Box
        The window on the common grid: (start, stop) along x, y and z.
    number : (slices, rows, bricks) int32
        Number in `bricks` of the brick that has the values.
    bricks : (n, 8) float32
        The last two are the value outside and the highest value alone.
    outside : float
        The field outside the window.
    """

    box: Box
    number: NDArray[np.int32]
    bricks: NDArray[np.float32]
    outside: float

    def part(
        self, x: NDArray[np.intp], y: NDArray[np.intp], z: NDArray[np.intp]
    ) -> tuple[tuple[slice, slice, slice], NDArray[np.float32]] | None:
        """Return the field at the samples of a grid that lie in the window.

        Parameters
        ----------
        x, y, z : (n,) intp
            Rising positions of the grid's samples.

        Returns
        -------
        slices (z, y, x) of the grid, and the field there; None where no sample lies in the window
        """
        low_high = [np.searchsorted(at, limits).tolist() for at, limits in zip((x, y, z), self.box, strict=True)]
        if any(low == high for low, high in low_high):
            return None
        along = [
            at[low:high] - start for at, (low, high), (start, _) in zip((x, y, z), low_high, self.box, strict=True)
        ]
        rows = self.bricks.take(self.number[along[2][:, None], along[1]], axis=0)  # (z, y, bricks, 8)
        values = rows.reshape(*rows.shape[:2], -1)
        every = len(along[0]) == along[0][-1] - along[0][0] + 1
        values = values[..., along[0][0] : along[0][-1] + 1] if every else values[..., along[0]]
        slice_x, slice_y, slice_z = (slice(*both) for both in low_high)
        return (slice_z, slice_y, slice_x), values

    def at(self, x: NDArray[np.intp], y: NDArray[np.intp], z: NDArray[np.intp]) -> NDArray[np.float32]:
        """Return the field at positions, float32 of the shape that these broadcast to."""
        inside: NDArray[np.bool_] | bool = True
        relative = []
        for at, (start, stop) in zip((x, y, z), self.box, strict=True):
            inside = inside & (at >= start) & (at < stop)
            relative.append(np.clip(at, start, stop - 1) - start)
        x, y, z = relative
        _, rows, bricks = self.number.shape
        brick = self.number.reshape(-1).take((z * rows + y) * bricks + (x >> 3))
        values = self.bricks.reshape(-1).take(brick.astype(np.intp) * BRICK + (x & 7))
        return np.where(inside, values, np.float32(self.outside))

    @property
    def nbytes(self) -> int:
        """Bytes that are held."""
        return self.number.nbytes + self.bricks.nbytes


def _refined_slice(field: ScalarField, slice_: int) -> int:
    """Return where a slice of a field's values lies on the common grid."""
    return field.origin[2] * field.slice_steps + slice_ - field.first_slice


def label_samples_steps(field: ScalarField) -> Steps[LabelSamples]:
    """Return the field of a label without its constant parts."""
    field = yield from held_steps(field)
    (x0, x1), (y0, y1), (z0, z1) = field.window_in_values
    values = yield from field.values.slices_steps(range(field.values.shape[0]))
    origin_x, origin_y, _ = field.origin
    low = (origin_x + x0, origin_y + y0, _refined_slice(field, z0))
    # Slices that close the border are far below 0: what lies outside the window is not.
    added = field.first_slice
    lowest = values[max(z0, added) : min(z1, len(values) - added), y0:y1, x0:x1].min()
    yield PAUSE
    return (yield from samples_of_steps(values[z0:z1, y0:y1, x0:x1], low, lowest))


def samples_of_steps(values: NDArray[Any], low: tuple[int, int, int], outside: float) -> Steps[LabelSamples]:
    """Return values (slices, rows, columns) without their constant parts.

    Parameters
    ----------
    low : (x, y, z) int
        First sample on the grid.
    outside : float
        The value outside the window.
    """
    highest = values.max()
    yield PAUSE
    slices, rows, columns = values.shape
    wide = -(-columns // BRICK)
    number = np.empty((slices, rows, wide), np.int32)
    kept: list[NDArray[np.float32]] = []
    count = 0
    layers = max(1, BRICKS_AT_ONCE // (rows * wide))
    for start in range(0, slices, layers):
        part = values[start : start + layers]
        if wide * BRICK > columns:
            part = np.pad(part, ((0, 0), (0, 0), (0, wide * BRICK - columns)), mode="edge")
        bricks = np.ascontiguousarray(part).reshape(-1, BRICK)
        is_low, is_high = (bricks == outside).all(axis=1), (bricks >= highest).all(axis=1)
        own = np.flatnonzero(~(is_low | is_high))
        part_number = np.where(is_low, np.int32(-2), np.int32(-1))
        part_number[own] = np.arange(count, count + len(own), dtype=np.int32)
        number[start : start + layers] = part_number.reshape(-1, rows, wide)
        kept.append(bricks[own].astype(np.float32))
        count += len(own)
        yield PAUSE
    ends = np.array([outside, highest], np.float32)
    kept.append(np.repeat(ends[:, None], BRICK, axis=1))
    number[number < 0] += np.int32(count + 2)
    x, y, z = ((start, start + size) for start, size in zip(low, values.shape[::-1], strict=True))
    return LabelSamples((x, y, z), number, np.concatenate(kept), float(ends[0]))
