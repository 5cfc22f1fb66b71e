# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the air around the body in a slice: air connected to the slice's border, not air in lung or bowel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

AIR = -800.0  # A sample of at most this many HU is air.


def outside_air(values: NDArray[Any], ends: int | None = None, air: float = AIR) -> NDArray[np.bool_]:
    """Return where the samples of a slice, (rows, columns), are at or below `air` and connected to its border.

    Parameters
    ----------
    ends : int, optional
        The axis at whose ends the body goes on, 0 or 1: lungs that are cut off at one of them are not outside.

    Examples
    --------
    >>> body = np.array([[-1000, -1000, -1000, -1000], [40, 40, 40, -1000], [40, -900, 40, -1000], [40, 40, 40, -1000]])
    >>> outside_air(body).astype(int).tolist()
    [[1, 1, 1, 1], [0, 0, 0, 1], [0, 0, 0, 1], [0, 0, 0, 1]]
    """
    is_air = ~(values > air)  # NaN too
    sides = [_seeds_at(values.shape, axis, end) for axis in (0, 1) for end in (0, -1) if axis != ends]
    outside = _joined_air(is_air, np.logical_or.reduce(sides))
    if ends is not None:  # what goes on from end to end lies beside the body, between it and the table
        first, last = (_joined_air(is_air, _seeds_at(values.shape, ends, end)) for end in (0, -1))
        outside |= first & last
    return outside


def _seeds_at(shape: tuple[int, ...], axis: int, end: int) -> NDArray[np.bool_]:
    """Return the first (0) or last (-1) samples along an axis."""
    seeds = np.zeros(shape, bool)
    seeds[(slice(None),) * axis + (end,)] = True
    return seeds


def _joined_air(is_air: NDArray[np.bool_], seeds: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the air that is joined to seeds, by whole runs along rows and columns in turn."""
    reached = is_air & seeds
    along = (_run_numbers(is_air), _run_numbers(is_air.T).T)
    before = -1
    while before != (before := np.count_nonzero(reached)):  # a body has few bays that take more than a few turns
        for numbers in along:
            is_reached = np.zeros(is_air.size + 1, bool)
            is_reached[numbers[reached]] = True
            reached = is_air & is_reached[numbers]
    return reached


def ends_of_body(corners_mm: NDArray[np.float64]) -> int | None:
    """Return the axis of a slice that runs along the body, 0 down its rows or 1 along them; None for an axial one.

    `corners_mm` are (4, 3) RAS+ mm, as `slice_corners` has them.

    Examples
    --------
    >>> ends_of_body(np.array([[0, 0, 0], [9, 0, 0], [9, 0, 5], [0, 0, 5.0]]))
    0
    """
    sides = np.stack([corners_mm[3] - corners_mm[0], corners_mm[1] - corners_mm[0]])  # (2, 3)
    along = np.abs(sides[:, 2]) / np.sqrt((sides * sides).sum(axis=1))
    return int(along.argmax()) if along.max() > 0.7 else None


def _run_numbers(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return a number for every run along the rows of a mask, from 1.

    Examples
    --------
    >>> _run_numbers(np.array([[True, True, False, True], [True, False, False, True]])).tolist()
    [[1, 1, 1, 2], [3, 3, 3, 4]]
    """
    begins = mask.copy()
    begins[:, 1:] &= ~mask[:, :-1]
    return np.cumsum(begins.ravel()).reshape(mask.shape)
