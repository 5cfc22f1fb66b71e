# SPDX-License-Identifier: GPL-3.0-or-later
"""The result of the smoothing: a field on a grid with slices between the label's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Floats
from ..mesh.triangle_mesh import Surface


@dataclass(frozen=True, eq=False)
class SmoothField:
    """A field that agrees with a label at every sample.

    Parameters
    ----------
    values : (slices, rows, columns) float32, millimeters
        Positive inside, negative outside, never 0 at a sample of the label; about the distance to the surface near it.
    slice_steps, first_slice : int
        Step between the label's slices, and the first of them.
    constant_mm : float
        Added to keep the volume; small components of the label have constants of their own before, see
        `constrained_steps`.
    volume_mm3, label_mm3 : float
        Volume of the Marching Cubes surface with a closed border, and of the label's samples in the same space.
    surface : Surface or None
        Surface in index space, if it was asked for and is the one of `values`.
    """

    values: Floats
    slice_steps: int
    first_slice: int
    constant_mm: float
    volume_mm3: float
    label_mm3: float
    surface: Surface | None = None


def refined_affine(affine: NDArray[np.float64], slice_steps: int, first_slice: int = 0) -> NDArray[np.float64]:
    """The affine of the refined grid: slices `slice_steps` times as dense, `first_slice` of them before the first."""
    refined = affine.copy()
    refined[:3, 2] /= slice_steps
    refined[:3, 3] -= first_slice * refined[:3, 2]
    return refined


def with_closed_ends(values: Floats, slice_steps: int) -> tuple[Floats, int]:
    """The field with slices before the first and after the last, so that its ends are half a slice gap outside.

    For a surface with a closed border: Marching Cubes alone would close it half a refined slice outside, and the
    label's end slices would count for less than the others.

    Parameters
    ----------
    values : (slices, rows, columns) float32
        `SmoothField.values`.

    Returns
    -------
    (slices + 2 n, rows, columns) float32, and n
        The added slices at either end. Nothing is added where slices are not refined.
    """
    copies, crossing = divmod(slice_steps - 1, 2)
    if not copies and not crossing:
        return values, 0
    ends = []
    for end in (values[:1], values[-1:]):
        added = [end] * (copies + crossing)
        if crossing:  # a crossing just behind the last copy, half a gap outside
            added.append(np.full_like(end, -1000 * float(np.abs(end).max())))
        ends.append(added)
    return np.concatenate([*ends[0][::-1], values, *ends[1]]), len(ends[0])
