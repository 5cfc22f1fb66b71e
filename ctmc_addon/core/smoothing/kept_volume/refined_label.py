# SPDX-License-Identifier: GPL-3.0-or-later
"""A label and its smooth field, shared by the steps that keep volumes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..bounds import Inside, Start
from ..bricks import Bricks


@dataclass(frozen=True, eq=False)
class RefinedLabel:
    """A label, its smooth field near the surface on the refined grid, and the bounds of that field.

    Parameters
    ----------
    mask : (slices, rows, columns) bool
    spacing_mm : (x, y, z) float
        Spacing of the mask.
    slice_steps : int
        Steps from slice to slice of the refined grid.
    close_border : bool
        Whether slices will be added, so that the surface ends half a slice gap outside.
    bricks : Bricks
        Bricks of the refined grid.
    start : Start
        The field and its bounds over the bricks; changed in place.
    inside : Inside
        Position of the mask in the label's grid with its margins.
    limit_mm : float
        Largest constant that may be added or subtracted. The field's values are hardly farther from zero, and a label
        of one voxel needs more than a pixel.
    """

    mask: NDArray[np.bool_]
    spacing_mm: tuple[float, float, float]
    slice_steps: int
    close_border: bool
    bricks: Bricks
    start: Start
    inside: Inside
    limit_mm: float

    @property
    def sides(self) -> tuple[float, float, float]:
        """The sides of a voxel of the refined grid along x, y and z, mm."""
        x, y, z = self.spacing_mm
        return x, y, z / self.slice_steps

    @property
    def adds_slices(self) -> bool:
        """Whether slices are added at an end that the label reaches."""
        return self.close_border and self.slice_steps > 1
