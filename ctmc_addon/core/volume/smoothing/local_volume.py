# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep the volume on either side of a wall not only as a whole but everywhere along it.

The smoothest field flattens what bulges, as far as the samples allow. Over an area wide enough to hold some steps of
the samples, as much has to lie before the surface as the samples have there; so a constant that changes slowly along
the wall is added.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...progress import PAUSE, Steps
from .bounds import NEAREST_ZERO
from .bricks import Floats

# Half the width of the area where the wall stands across the slices, and where it lies along them.
NARROW_GAPS, NARROW_PIXELS = 1.0, 5.0
WIDE_GAPS = (3.0, 3.0, 2.0)  # by the steps from slice to slice, 1, 2 or more
BLOCKS = 2  # of samples in half the width, whose sums are averaged


def keep_local_volume_steps(
    field: Floats, sign: NDArray[np.int8], spacing_mm: tuple[float, float, float], slice_steps: int
) -> Steps[None]:
    """Add to a field, in place, what keeps the volume of its samples along its surface.

    Parameters
    ----------
    field : ((slices - 1) * slice_steps + 1, rows, columns) float32, millimeters
    sign : (slices, rows, columns) int8
        1 or -1 at the samples of either side, 0 at others.
    spacing_mm : (x, y, z) float
        Of the samples that have signs.
    slice_steps : int
    """
    x, y, z = spacing_mm
    sides = (z / slice_steps, y, x)
    near, far = (
        [max(1, round(max(gaps * z, NARROW_PIXELS * max(x, y)) / side)) for side in sides]
        for gaps in (NARROW_GAPS, WIDE_GAPS[min(slice_steps, 3) - 1])
    )
    samples = _refined(sign, slice_steps)
    known = samples != 0
    bound = np.zeros(field.shape, np.int8)
    bound[::slice_steps] = sign
    least = np.float32(NEAREST_ZERO * min(spacing_mm))
    half = np.float32(max(sides))
    share = np.clip(field / half, -1, 1)
    missing = np.where(known, samples - share, np.float32(0))
    area = (known & (np.abs(share) < 1)) / half
    yield PAUSE
    constant, _ = _along_wall(missing, area, near, field.shape)
    yield PAUSE
    if far != near:
        rise_z, rise_y, rise_x = (np.gradient(field, side, axis=axis) ** 2 for axis, side in enumerate(sides))
        upright = rise_z / np.maximum(rise_x + rise_y + rise_z, np.float32(1e-6)) * area
        yield PAUSE
        wide, area_means = _along_wall(missing, area, far, field.shape)
        yield PAUSE
        weight = _between_blocks(_block_means(upright, far) / area_means, _blocks(far), field.shape)
        constant += (wide - constant) * np.clip(weight, 0, 1)
    np.clip(constant, -half, half, out=constant)
    field += constant
    np.maximum(field, least, out=field, where=bound > 0)
    np.minimum(field, -least, out=field, where=bound < 0)
    yield PAUSE


def _refined(sign: NDArray[np.int8], slice_steps: int) -> Floats:
    """The signs on the refined grid, those of the nearest slice."""
    out = np.zeros(((len(sign) - 1) * slice_steps + 1, *sign.shape[1:]), np.float32)
    out[::slice_steps] = sign
    for step in range(1, slice_steps):
        share = 0.0 if 2 * step < slice_steps else 0.5 if 2 * step == slice_steps else 1.0
        between = sign[:-1] * np.float32(1 - share) + sign[1:] * np.float32(share)
        out[step::slice_steps] = np.where((sign[:-1] != 0) & (sign[1:] != 0), between, np.float32(0))
    return out


def _along_wall(
    missing: Floats, area: Floats, reach: list[int], shape: tuple[int, ...]
) -> tuple[Floats, NDArray[np.float64]]:
    """The constant that is missing within so many samples, at every sample, and the mean area of every block."""
    area_means = np.maximum(_block_means(area, reach), 1e-9)
    return _between_blocks(_block_means(missing, reach) / area_means, _blocks(reach), shape), area_means


def _blocks(reach: list[int]) -> list[int]:
    """How many samples a block has along each axis."""
    return [max(1, steps // BLOCKS) for steps in reach]


def _block_means(values: Floats, reach: list[int]) -> NDArray[np.float64]:
    """For every block the mean of the blocks within so many samples."""
    blocks = _blocks(reach)
    means = _block_sums(values, blocks)
    for axis, (steps, size) in enumerate(zip(reach, blocks, strict=True)):
        means = _averaged(means, max(1, round(steps / size)), axis)
    return means


def _block_sums(values: Floats, blocks: list[int]) -> NDArray[np.float64]:
    """The sums of blocks of so many samples along each axis; those at the end may have fewer."""
    out = values.astype(np.float64)
    for axis, size in enumerate(blocks):
        along = np.moveaxis(out, axis, 0)
        sums = along[::size].copy()
        for step in range(1, size):
            more = along[step::size]
            sums[: len(more)] += more
        out = np.moveaxis(sums, 0, axis)
    return out


def _between_blocks(values: NDArray[np.float64], blocks: list[int], shape: tuple[int, ...]) -> Floats:
    """The values of blocks at the samples, linear between the blocks' middles."""
    out = values.astype(np.float32)
    for axis, (size, count) in enumerate(zip(blocks, shape, strict=True)):
        place = (np.arange(count) + 0.5) / size - 0.5
        low = np.clip(np.floor(place).astype(np.intp), 0, out.shape[axis] - 1)
        high = np.minimum(low + 1, out.shape[axis] - 1)
        share = np.clip(place - low, 0, 1).astype(np.float32)
        share = share.reshape([-1 if each == axis else 1 for each in range(3)])
        first = out.take(low, axis=axis)
        out = first + (out.take(high, axis=axis) - first) * share
    return out


def _averaged(values: NDArray[np.float64], reach: int, axis: int) -> NDArray[np.float64]:
    """The mean of the blocks up to `reach` before and after along an axis, twice; beyond the ends there are zeros."""
    out = np.moveaxis(values, axis, 0)
    count, width = len(out), 2 * reach + 1
    for _ in range(2):
        total = np.zeros((count + width, *out.shape[1:]))  # of all blocks before one that is `reach` further on
        np.cumsum(out, axis=0, out=total[reach + 1 : reach + 1 + count])
        total[reach + 1 + count :] = total[reach + count]
        out = (total[width:] - total[:count]) / width
    return np.moveaxis(out, 0, axis)
