# SPDX-License-Identifier: GPL-3.0-or-later
"""Connected components of a mask: keep them by size or by a click, fill holes.

Neighbors are those along the axes, as for the surface made from the mask.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags
from ...errors import SettingsError
from ...measures.units import volume_text
from ...progress import PAUSE, Steps
from ...smoothing.label_components import LabelComponents, label_components_steps
from ..points import Sample

SLICES_PER_STEP = 32


def painted_steps(
    components: LabelComponents, selected: NDArray[np.bool_], shape: tuple[int, int, int]
) -> Steps[Flags]:
    """Return the mask of the selected components, (components,) bool."""
    slices, rows, columns = shape
    mask = np.zeros(shape, bool)
    runs = np.flatnonzero(selected[components.component])
    ends = np.searchsorted(components.z[runs], np.arange(slices + 1))
    start, stop = (components.y * columns + along for along in (components.start, components.stop))
    for number in range(slices):
        own = runs[ends[number] : ends[number + 1]]
        if own.size:
            turns = np.zeros(rows * columns + 1, np.int8)
            turns[start[own]] += 1  # no two runs of a slice begin or end at one sample
            turns[stop[own]] -= 1
            mask[number] = np.cumsum(turns[:-1], dtype=np.int8).reshape(rows, columns) > 0
        if number % SLICES_PER_STEP == 0:
            yield PAUSE
    return mask


def touching_steps(mask: Flags, samples: Sequence[Sample]) -> Steps[Flags]:
    """Return the components of a mask that have one of these samples (slice, row, column)."""
    components = yield from label_components_steps(mask)
    selected = np.zeros(len(components.voxels), bool)
    for z, y, x in samples:
        if mask[z, y, x]:
            here = (components.z == z) & (components.y == y) & (components.start <= x) & (x < components.stop)
            selected[components.component[here]] = True
    return (yield from painted_steps(components, selected, _shape(mask)))


def islands_steps(
    mask: Flags, voxel_mm3: float, at_least_mm3: float = 0.0, largest: int | None = None, drop: bool = False
) -> Steps[Flags]:
    """Keep the components of a mask that are large enough, or the largest ones; or drop just these.

    Parameters
    ----------
    mask : (slices, rows, columns) bool
    voxel_mm3 : float
        Volume of a voxel.
    at_least_mm3 : float
        Smallest volume of a component.
    largest : int, optional
        Most components to keep, the largest first; of equal ones those later in the grid.
    drop : bool
        Return what would not be kept.

    Raises
    ------
    SettingsError
        If a volume or number is below zero.

    Examples
    --------
    >>> from ctmc_addon.core import finish
    >>> row = np.array([[[True, True, False, True]]])
    >>> finish(islands_steps(row, 1.0, at_least_mm3=2.0)).astype(int).tolist()
    [[[1, 1, 0, 0]]]
    >>> finish(islands_steps(row, 1.0, largest=1, drop=True)).astype(int).tolist()
    [[[0, 0, 0, 1]]]
    """
    if not at_least_mm3 >= 0 or (largest is not None and largest < 0):
        raise SettingsError(
            f"islands to keep have a volume and a number of 0 or more, not {volume_text(at_least_mm3)} and {largest}"
        )
    components = yield from label_components_steps(mask)
    selected = components.voxels * voxel_mm3 >= at_least_mm3 * (1 - 1e-9)
    if largest is not None:
        selected[: max(0, len(selected) - largest)] = False
    return (yield from painted_steps(components, selected ^ drop, _shape(mask)))


def holes_filled_steps(mask: Flags, voxel_mm3: float, at_most_mm3: float = float("inf")) -> Steps[Flags]:
    """Fill the holes of a mask: components of its outside that do not reach the border of the grid.

    Parameters
    ----------
    mask : (slices, rows, columns) bool
    voxel_mm3 : float
        Volume of a voxel.
    at_most_mm3 : float
        Larger holes stay.

    Examples
    --------
    >>> from ctmc_addon.core import finish
    >>> shell = np.ones((3, 3, 3), bool)
    >>> shell[1, 1, 1] = False
    >>> int(finish(holes_filled_steps(shell, 1.0)).sum())
    27
    """
    components = yield from label_components_steps(~mask)
    low, high = components.boxes() if len(components.voxels) else (np.empty((0, 3)), np.empty((0, 3)))
    enclosed = (low > 0).all(axis=1) & (high < np.array(mask.shape) - 1).all(axis=1)
    enclosed &= components.voxels * voxel_mm3 <= at_most_mm3
    filled = yield from painted_steps(components, enclosed, _shape(mask))
    filled |= mask
    return filled


def _shape(mask: Flags) -> tuple[int, int, int]:
    slices, rows, columns = mask.shape
    return slices, rows, columns
