# SPDX-License-Identifier: GPL-3.0-or-later
"""Grow or shrink a mask by millimeters, by exact distances between samples' centers."""

from __future__ import annotations

import math

from ...arrays import Flags
from ...errors import SettingsError
from ...progress import Steps
from ..distance import Spacing, far_inside_steps, near_steps


def margin_steps(mask: Flags, spacing_mm: Spacing, margin_mm: float, within: Flags | None = None) -> Steps[Flags]:
    """Grow a mask by a margin above zero, or shrink it by one below.

    A structure that reaches the border of the grid is taken to go on behind it: it does not shrink from there.

    Parameters
    ----------
    mask : (slices, rows, columns) bool
    spacing_mm : (x, y, z) float
        For an oblique or sheared affine the lengths of its columns.
    margin_mm : float
        A grown mask has every sample at most so far from one of its own; a shrunk mask loses every sample at most so
        far from one outside.
    within : (slices, rows, columns) bool, optional
        Samples into which it may grow, such as those in a range.

    Raises
    ------
    SettingsError
        If the margin is not a finite number.

    Examples
    --------
    >>> import numpy as np
    >>> from ctmc_addon.core import finish
    >>> row = np.array([[[False, False, True, True, True]]])
    >>> finish(margin_steps(row, (1.0, 1.0, 1.0), 1.0)).astype(int).tolist()
    [[[0, 1, 1, 1, 1]]]
    >>> finish(margin_steps(row, (1.0, 1.0, 1.0), -1.0)).astype(int).tolist()
    [[[0, 0, 0, 1, 1]]]
    """
    if not math.isfinite(margin_mm):
        raise SettingsError(f"a margin is a finite number of mm, not {margin_mm:g}; give one such as 2 or -2")
    if margin_mm < 0:
        return (yield from far_inside_steps(mask, spacing_mm, -margin_mm))
    grown = yield from near_steps(mask, spacing_mm, margin_mm)
    return grown if within is None else mask | (grown & within)
