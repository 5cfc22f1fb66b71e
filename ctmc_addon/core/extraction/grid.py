"""Which samples of a volume are the corners of voxels, and which of them are inside.

Voxels have sides of `stride` pixels; the last one along an axis is cut short at the border, so a
coarse surface is never cut off (Su and Ma, 3.1, figures 3 to 5). With a closed border one more
sample, always outside, stands a pixel outside at either end: no copy of the volume is padded.

Inside is `value >= threshold`, one bit a sample, 64 samples a word.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SettingsError

WORD = 64
ROWS_READ_IN_VAIN = 4
CHUNK_SAMPLES = 1 << 20  # compared at once: the answers stay in the processor's cache


@dataclass(frozen=True)
class Axis:
    """The samples along one axis.

    Parameters
    ----------
    position : (n,) float32
        Where the samples lie, in voxel indices of the volume.
    index : (n,) intp
        Which values of the volume they take; a closed border's outside samples repeat the outermost.
    start, stop, stride : int
        The volume's indices that are sampled: range(start, stop, stride), then `stop - 1`.
    closed : bool
        Whether there is an outside sample at either end.
    """

    position: NDArray[np.float32]
    index: NDArray[np.intp]
    start: int
    stop: int
    stride: int
    closed: bool

    @property
    def count(self) -> int:
        """Number of samples, the outside ones among them."""
        return len(self.index)

    @property
    def voxels(self) -> int:
        """Number of voxels between the samples that are values of the volume."""
        return self.count - 1 - 2 * self.closed


def sample_axis(start: int, stop: int, stride: int, closed: bool) -> Axis:
    """Samples at start, start + stride, ..., and at stop - 1 in any case.

    Examples
    --------
    >>> sample_axis(0, 6, 2, closed=False).index.tolist()
    [0, 2, 4, 5]
    >>> sample_axis(0, 6, 2, closed=True).position.tolist()
    [-1.0, 0.0, 2.0, 4.0, 5.0, 6.0]
    """
    index = [*range(start, stop - 1, stride), stop - 1]
    position = [start - 1, *index, stop] if closed else index
    index = [start, *index, stop - 1] if closed else index
    return Axis(np.array(position, np.float32), np.array(index, np.intp), start, stop, stride, closed)


@dataclass(frozen=True, eq=False)
class Grid:
    """A volume's values and the samples taken of them along x, y and z."""

    values: NDArray[Any]
    x: Axis
    y: Axis
    z: Axis

    @property
    def voxels(self) -> int:
        """Number of voxels (cells between samples of the volume), whether skipped or not."""
        return self.x.voxels * self.y.voxels * self.z.voxels

    @property
    def words(self) -> int:
        """Number of 64 bit words a row of samples takes."""
        return -(-self.x.count // WORD)


def make_grid(
    values: NDArray[Any],
    stride: int | tuple[int, int, int] = (1, 1, 1),
    close_border: bool = False,
    window: tuple[tuple[int, int], tuple[int, int], tuple[int, int]] | None = None,
) -> Grid:
    """The samples of `values` (slices, rows, columns) inside `window` ((x, stop), (y, stop), (z, stop)).

    Raises
    ------
    SettingsError
        If a stride is below 1 or larger than the window, or there are not three.
    """
    steps = (stride,) * 3 if isinstance(stride, int | np.integer) else tuple(stride)
    if len(steps) != 3:
        raise SettingsError(f"stride takes 3 numbers, x, y and z, not {len(steps)}: {steps}")
    sides = window or tuple((0, size) for size in values.shape[::-1])
    axes = []
    for name, (start, stop), step in zip("xyz", sides, steps, strict=True):
        if step != int(step) or not 1 <= step < stop - start:
            raise SettingsError(
                f"stride {step} along {name} must be a whole number from 1 to {stop - start - 1}, "
                f"since there are {stop - start} samples along {name}"
            )
        axes.append(sample_axis(start, stop, int(step), close_border))
    return Grid(values.view(np.uint8) if values.dtype == bool else values, *axes)


def in_values_type(threshold: float, dtype: np.dtype[Any]) -> Any:
    """The lowest value of `dtype` that is at or above the threshold; None where there is none.

    Comparing in the volume's own type is exact and moves the fewest bytes.

    Examples
    --------
    >>> int(in_values_type(127.5, np.dtype(np.uint8)))
    128
    >>> in_values_type(256, np.dtype(np.uint8)) is None
    True
    """
    if dtype.kind == "f":
        native = dtype.newbyteorder("=").type
        with np.errstate(over="ignore"):  # infinite where no value of the type is so high
            value = native(threshold)
        return value if float(value) >= threshold else np.nextafter(value, native(np.inf))
    limits = np.iinfo(dtype)
    lowest = max(math.ceil(threshold), int(limits.min))
    return None if lowest > limits.max else dtype.newbyteorder("=").type(lowest)


def inside_bits(grid: Grid, threshold: float, low: int, high: int, out: NDArray[np.uint64]) -> None:
    """Write which samples of the sample layers `low` to `high` are inside, the only pass over the volume.

    Parameters
    ----------
    out : (z.count + 1, y.count + 1, words) uint64, zero
        Bit i of word w is sample 64 w + i of the row. The last row and layer repeat the ones before
        them: a surface then has no edge between them, and the half voxels there need no special case.
    """
    lowest = in_values_type(threshold, grid.values.dtype)
    x, y, z = grid.x, grid.y, grid.z
    first_layer, end_layer = max(low, z.closed), min(high, z.count - z.closed)
    columns, (first_row, end_row) = slice(x.closed, x.count - x.closed), (y.closed, y.count - y.closed)
    pitch = grid.words * WORD
    chunk = CHUNK_SAMPLES // (pitch * x.stride * y.stride)  # rows
    rows = min(end_row - first_row, max(1, chunk))
    layers = max(1, chunk // rows) if z.stride == 1 else 1
    buffer = np.zeros((min(layers, high - low), rows, pitch), bool)
    for layer in range(first_layer, end_layer, layers):
        end = min(layer + layers, end_layer)
        block = grid.values[z.index[layer] : z.index[end - 1] + 1]
        for row in range(first_row, end_row if lowest is not None else first_row, rows):
            part = buffer[: end - layer, : min(rows, end_row - row)]
            _compare(block, x, y, y.index[row : row + part.shape[1]], lowest, part[..., columns])
            packed = np.packbits(part.reshape(-1), bitorder="little").view(np.uint64)
            out[layer:end, row : row + part.shape[1]] = packed.reshape(*part.shape[:2], -1)
        out[layer:end, -1] = out[layer:end, -2]
    if high == z.count:
        out[-1] = out[-2]


def _compare(
    layers: NDArray[Any], x: Axis, y: Axis, rows: NDArray[np.intp], lowest: Any, out: NDArray[np.bool_]
) -> None:
    """Fill `out` (layers, rows, columns) with `value >= lowest` of the samples, short last voxels and all."""
    if x.stride == y.stride == 1:
        np.greater_equal(layers[:, rows[0] : rows[-1] + 1, x.start : x.stop], lowest, out=out)
        return
    # Memory is read fastest in one run: a few rows too many cost less than leaving them out.
    skip = y.stride > ROWS_READ_IN_VAIN
    near = layers[:, rows, x.start : x.stop] if skip else layers[:, rows[0] : rows[-1] + 1, x.start : x.stop]
    inside = near >= lowest
    step = 1 if skip else y.stride
    regular = _every(x.stride, inside[:, ::step])
    count = regular.shape[1:]
    out[:, : count[0], : count[1]] = regular
    out[:, : count[0], count[1] :] = inside[:, ::step, -1:]
    out[:, count[0] :, : count[1]] = inside[:, -1:, :: x.stride]
    out[:, count[0] :, count[1] :] = inside[:, -1:, -1:]


def _every(stride: int, inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Every so many of the samples along the rows."""
    if stride not in (2, 4, 8) or inside.shape[2] % stride or inside.strides[2] != 1:
        return inside[..., ::stride]
    # The lowest byte of every 2, 4 or 8: several times faster than stepping from byte to byte.
    return inside.view(f"<u{stride}").astype(np.uint8).view(bool)
