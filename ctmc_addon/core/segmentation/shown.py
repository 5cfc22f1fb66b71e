# SPDX-License-Identifier: GPL-3.0-or-later
"""Masks in a slice as a translucent picture: a veil of each structure's color, and its outline."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

VEIL, OUTLINE = 0.22, 0.9  # Opacities.
ACTIVE_VEIL = 0.38
Mask2D = NDArray[np.bool_]
"""Of a slice: (rows, columns)."""


def veiled(mask: Mask2D, color: Sequence[float], active: bool = False) -> NDArray[np.float32]:
    """Return a mask of a slice as colors, (rows, columns, 4) float32.

    Parameters
    ----------
    mask : (rows, columns) bool
    color : (red, green, blue)
        0 to 1, as it is to appear.
    active : bool
        Whether it is drawn on; its veil is denser.

    Examples
    --------
    >>> picture = veiled(np.ones((3, 3), bool), (1.0, 0.0, 0.0))
    >>> [round(float(share), 2) for share in (picture[0, 0, 3], picture[1, 1, 3])]
    [0.9, 0.22]
    """
    inner = np.zeros_like(mask)
    inner[1:-1, 1:-1] = mask[1:-1, 1:-1] & mask[:-2, 1:-1] & mask[2:, 1:-1] & mask[1:-1, :-2] & mask[1:-1, 2:]
    picture = np.empty((*mask.shape, 4), np.float32)
    picture[..., :3] = color
    picture[..., 3] = np.where(inner, np.float32(ACTIVE_VEIL if active else VEIL), mask * np.float32(OUTLINE))
    return picture


def cropped(mask: Mask2D, corners: NDArray[np.float64]) -> tuple[Mask2D, NDArray[np.float64]]:
    """Return the part of a slice that has something, with an empty sample around it, and the corners of that part.

    Parameters
    ----------
    mask : (rows, columns) bool
    corners : (4, 3) float64
        Corners of the slice: row and column 0; last column; last column and row; last row. Any unit.

    Examples
    --------
    >>> mask = np.zeros((4, 8), bool)
    >>> mask[1, 3:5] = True
    >>> part, corners = cropped(mask, np.array([[0, 0, 0], [8, 0, 0], [8, 4, 0], [0, 4, 0.0]]))
    >>> part.shape, corners[0].tolist(), corners[2].tolist()
    ((3, 4), [2.0, 0.0, 0.0], [6.0, 3.0, 0.0])
    """
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    if not rows.size:
        return mask[:0, :0], corners
    top, bottom = max(0, int(rows[0]) - 1), min(mask.shape[0], int(rows[-1]) + 2)
    left, right = max(0, int(columns[0]) - 1), min(mask.shape[1], int(columns[-1]) + 2)
    across, down = (corners[1] - corners[0]) / mask.shape[1], (corners[3] - corners[0]) / mask.shape[0]
    ends = ((left, top), (right, top), (right, bottom), (left, bottom))
    return mask[top:bottom, left:right], np.stack([corners[0] + x * across + y * down for x, y in ends])
