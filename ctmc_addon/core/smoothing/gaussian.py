# SPDX-License-Identifier: GPL-3.0-or-later
"""Weights and sums of a Gaussian in millimeters, for the values that `GaussianValues` smooths slab by slab.

Values are (slices, rows, columns); sigma is given in mm and differs along the axes in voxels. Only
products and sums in a fixed order, so every machine and any number of threads give the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

REACH = 4.0  # The Gaussian is cut off after this many standard deviations.


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

    Rounded to multiples of 2^-24 before they are normalized, so that the last bit of a machine's
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
