# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of a volume anywhere in the patient: of the sample at a point, and on a plane that lies as it likes.

Positions are RAS+ millimeters. A sample reaches half a voxel to every side.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .affine import to_index
from .volume import Volume


def value_at(volume: Volume, point_mm: Sequence[float]) -> float | None:
    """Return the value of the sample nearest to a point; None outside the volume.

    Examples
    --------
    >>> stack = Volume(np.arange(8).reshape(2, 2, 2), np.diag([1.0, 1.0, 3.0, 1.0]))
    >>> value_at(stack, (0.9, 0.2, 3.0)), value_at(stack, (0.0, 0.0, 4.6))
    (5.0, None)
    """
    x, y, z = np.floor(to_index(volume.affine, np.array([point_mm], np.float64))[0] + 0.5).astype(int).tolist()
    if not all(0 <= at < size for at, size in zip((x, y, z), volume.size, strict=True)):
        return None
    return float(volume.values[z, y, x])


def resliced(
    volume: Volume, corners_mm: NDArray[np.float64], shape: tuple[int, int], outside: float
) -> NDArray[np.float32]:
    """Return the values on a plane, trilinear between samples, (rows, columns) float32.

    Parameters
    ----------
    corners_mm : (4, 3) float64
        Corners of the plane, as of `slice_corners`: row and column 0; last column; last column and row; last row.
    outside : float
        Value of samples outside the volume.
    """
    rows, columns = shape
    across, down = corners_mm[1] - corners_mm[0], corners_mm[3] - corners_mm[0]
    right, below = (np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows
    points = corners_mm[0] + below[:, None, None] * down + right[None, :, None] * across  # (rows, columns, 3)
    at = to_index(volume.affine, points.reshape(-1, 3))  # (n, 3)
    last = np.array(volume.size) - 1
    is_inside = ((at >= -0.5 - 1e-6) & (at <= last + 0.5 + 1e-6)).all(axis=1)
    at = np.clip(at, 0, last)
    low = np.minimum(np.floor(at).astype(np.intp), np.maximum(last - 1, 0))
    share = (at - low).astype(np.float32)
    high = np.minimum(low + 1, last)
    values = np.zeros(len(at), np.float32)
    for corner in np.ndindex(2, 2, 2):
        x, y, z = (np.where(side, high[:, axis], low[:, axis]) for axis, side in enumerate(corner))
        weights = np.prod([share[:, axis] if side else 1 - share[:, axis] for axis, side in enumerate(corner)], axis=0)
        values += weights * volume.values[z, y, x]
    values[~is_inside] = outside
    return values.reshape(shape)
