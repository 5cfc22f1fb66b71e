# SPDX-License-Identifier: GPL-3.0-or-later
"""Smooth a volume by a Gaussian in millimeters, slab by slab, before extraction.

Values are (slices, rows, columns); sigma is given in mm and differs along the axes in voxels. Only
products and sums in a fixed order, so every machine and any number of threads give the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...parallel import map_steps, worker_count
from ...progress import Stages, Steps

REACH = 4.0  # standard deviations after which the Gaussian is cut off
BLOCK_BYTES = 2**21  # of a buffer, so that it stays in the cache
BATCHES = 64  # a step each


def gaussian_smooth_steps(
    values: NDArray[Any], spacing: tuple[float, float, float], sigma_mm: float, threads: int | None = None
) -> Steps[NDArray[np.float32]]:
    """Smooth by a Gaussian of standard deviation `sigma_mm`, the border repeated outwards.

    Parameters
    ----------
    values : (slices, rows, columns) numbers or bool
        Finite; read once, never changed.
    spacing : (x, y, z) float, millimeters
        For an oblique or sheared affine the lengths of its columns.
    sigma_mm : float
        0 gives the values themselves as float32.
    threads : int, optional
        By default as many as there are processors, at most 8.

    Returns
    -------
    (slices, rows, columns) float32
        Needs no more memory than itself and a few MB a thread.
    """
    smoothed = np.empty(values.shape, np.float32)
    slices, rows, columns = values.shape
    along_x, along_y, along_z = (weights(sigma_mm / gap) for gap in spacing)
    workers = worker_count(threads)

    def in_plane(k: int) -> None:
        smoothed[k] = smoothed_plane(values[k], along_x, along_y)

    deep = max(1, min(rows, BLOCK_BYTES // (4 * columns * (slices + 2 * len(along_z)))))

    def through(row: int) -> None:
        block = smoothed[:, row : row + deep]
        block[...] = convolved(block, along_z, 0)

    stages = Stages({"Smoothing slices": 2} | ({"Smoothing across slices": 1} if len(along_z) > 1 else {}))
    yield from stages.run("Smoothing slices", map_steps(in_plane, range(slices), workers, batches=BATCHES))
    if len(along_z) > 1:
        across = map_steps(through, range(0, rows, deep), workers, batches=BATCHES)
        yield from stages.run("Smoothing across slices", across)
    return smoothed


def smoothed_plane(plane: NDArray[Any], along_x: list[np.float32], along_y: list[np.float32]) -> NDArray[np.float32]:
    """Return one slice (rows, columns) smoothed by the weights along x and y."""
    return convolved(convolved(plane.astype(np.float32), along_y, 0), along_x, 1)


def smoothed_middle(planes: Sequence[NDArray[np.float32]], along_z: list[np.float32]) -> NDArray[np.float32]:
    """Return the middle one of an odd number of slices smoothed by the weights along z, as `convolved` does it."""
    reach = len(along_z) - 1
    if not reach:
        return planes[0]
    total, pair = np.zeros_like(planes[0]), np.empty_like(planes[0])
    for at in range(reach, 0, -1):
        np.add(planes[reach - at], planes[reach + at], out=pair)
        pair *= along_z[at]
        total += pair
    np.multiply(planes[reach], along_z[0], out=pair)
    total += pair
    return total


def weights(sigma: float) -> list[np.float32]:
    """Return the Gaussian's weights at 0, 1, 2... voxels; with their mirror images they add up to 1.

    Rounded to multiples of 2^-24 before they are normalised, so that the last bit of a machine's
    exponential does not matter.

    Examples
    --------
    >>> [round(float(weight), 4) for weight in weights(0.5)]
    [0.7866, 0.1065, 0.0003]
    """
    reach = int(REACH * sigma + 0.5)
    raw = [round(math.exp(-0.5 * (at / sigma) ** 2) * 2**24) for at in range(reach + 1)] if reach else [2**24]
    total = raw[0] + 2 * sum(raw[1:])
    return [np.float32(weight / total) for weight in raw]


def convolved(values: NDArray[np.float32], kernel: list[np.float32], axis: int) -> NDArray[np.float32]:
    """Return the convolution along `axis` with symmetric weights, the border repeated.

    The farthest, smallest terms are added first, which keeps the rounding small.
    """
    reach = len(kernel) - 1
    if not reach:
        return values
    count = values.shape[axis]
    shape = list(values.shape)

    def window(array: NDArray[np.float32], start: int, stop: int) -> NDArray[np.float32]:
        return array[(slice(None),) * axis + (slice(start, stop),)]

    shape[axis] = count + 2 * reach
    padded = np.empty(shape, np.float32)
    window(padded, reach, reach + count)[...] = values
    window(padded, 0, reach)[...] = window(values, 0, 1)
    window(padded, reach + count, shape[axis])[...] = window(values, count - 1, count)

    total = np.zeros(values.shape, np.float32)
    pair = np.empty(values.shape, np.float32)
    for at in range(reach, 0, -1):
        np.add(window(padded, reach - at, reach - at + count), window(padded, reach + at, reach + at + count), out=pair)
        pair *= kernel[at]
        total += pair
    np.multiply(values, kernel[0], out=pair)
    total += pair
    return total
