# SPDX-License-Identifier: GPL-3.0-or-later
"""The samples of a volume between two values: the mask that other tools stay in."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags
from ...errors import SettingsError
from ...progress import Step, Steps
from ...volume.statistics.values import slabs_of
from ...volume.volume import Volume


def range_mask_steps(volume: Volume, low: float, high: float) -> Steps[Flags]:
    """Find the samples from `low` to `high`, both included; NaN is in no range.

    Parameters
    ----------
    volume : Volume
        Volume, or `volume.part(box)` for a region; it is read slab by slab.
    low, high : float
        HU, or gray values; infinite where there is no limit.

    Returns
    -------
    (slices, rows, columns) bool

    Raises
    ------
    SettingsError
        If `low` is above `high`, or one of them is NaN.

    Examples
    --------
    >>> from ctmc_addon.core import finish
    >>> volume = Volume(np.arange(8).reshape(2, 2, 2), np.eye(4))
    >>> finish(range_mask_steps(volume, 2, 5)).astype(int).ravel().tolist()
    [0, 0, 1, 1, 1, 1, 0, 0]
    """
    mask = np.empty(volume.shape, bool)
    first = 0
    for values in slabs_of(volume):
        mask[first : first + len(values)] = in_range(values, low, high)
        first += len(values)
        yield Step(first / volume.shape[0], "Looking for the range")
    return mask


def in_range(values: NDArray[Any], low: float, high: float) -> Flags:
    """Do what `range_mask_steps` does for values in memory."""
    if not low <= high:
        raise SettingsError(f"a range goes from a value to a higher one, not from {low:g} to {high:g}; swap them")
    inside: Flags = np.greater_equal(values, low)
    inside &= values <= high
    return inside
