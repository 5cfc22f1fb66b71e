# SPDX-License-Identifier: GPL-3.0-or-later
"""Points that were clicked, RAS+ millimeters, as samples of a grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..errors import SettingsError
from ..measures.units import mm_text
from ..volume.affine import to_index
from ..volume.region import volume_box
from ..volume.volume import SampleGrid
from .distance import Spacing, Window, grown_window

Point = Sequence[float]
Sample = tuple[int, int, int]
"""Slice, row, column."""


def sample_at(volume: SampleGrid, point_ras_mm: Point) -> Sample:
    """Return the sample (slice, row, column) of a volume that is nearest to a point (x, y, z), RAS+ mm.

    Raises
    ------
    SettingsError
        If the point is not three finite numbers, or lies farther than half a voxel outside.

    Examples
    --------
    >>> from ctmc_addon.core import Volume
    >>> sample_at(Volume(np.zeros((2, 3, 4)), np.diag([-1.0, 1.0, 5.0, 1.0])), (-2.2, 0.9, 5.0))
    (1, 1, 2)
    """
    point = np.array(point_ras_mm, np.float64)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise SettingsError(f"a point is three finite numbers x y z in RAS+ mm, not {point_ras_mm}")
    index = np.floor(to_index(volume.affine, point[None])[0] + 0.5).astype(np.int64)
    if (index < 0).any() or (index >= volume.size).any():
        corners: NDArray[np.float64] = volume_box(volume)
        ends = zip("xyz", corners.min(axis=0).tolist(), corners.max(axis=0).tolist(), strict=True)
        box = ", ".join(f"{axis} {low:.4g} to {mm_text(high, 4)}" for axis, low, high in ends)
        given = " ".join(f"{part:g}" for part in point.tolist())
        raise SettingsError(
            f"the point {given} lies outside the volume, which spans {box}; give it in RAS+ mm (Slicer's R A S)"
        )
    x, y, z = index.tolist()
    return z, y, x


def window_around(samples: Sequence[Sample], margin_mm: float, spacing_mm: Spacing, shape: tuple[int, ...]) -> Window:
    """Return the window (z, y, x) that holds all samples and a margin in mm around them."""
    low, high = np.min(samples, axis=0).tolist(), np.max(samples, axis=0).tolist()
    z, y, x = (slice(first, last + 1) for first, last in zip(low, high, strict=True))
    return grown_window((z, y, x), margin_mm, spacing_mm, shape)


def sample_in(sample: Sample, window: Window) -> Sample:
    """Return a sample counted from the first one of a window."""
    z, y, x = (at - side.start for at, side in zip(sample, window, strict=True))
    return z, y, x
