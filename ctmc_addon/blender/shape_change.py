# SPDX-License-Identifier: GPL-3.0-or-later
"""Tell whether an object was mirrored or scaled after it was made from the patient."""

from __future__ import annotations

from typing import Any, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.volume import determinant
from .surface import placement_of, read_provenance

SAME = 1e-4  # A factor that differs less from 1 is rounding.


class ShapeChange(NamedTuple):
    """Effect of an object's transform on its shape.

    Parameters
    ----------
    mirrored : bool
        Whether left and right are exchanged.
    factors : (x, y, z) float
        Scale of the object along the patient's axes.
    """

    mirrored: bool
    factors: tuple[float, float, float]

    @property
    def scaled(self) -> bool:
        """Return whether the object is larger or smaller than the patient."""
        return max(abs(factor - 1.0) for factor in self.factors) > SAME

    @property
    def factors_text(self) -> str:
        """Return the factor, or those along x, y and z.

        Examples
        --------
        >>> ShapeChange(False, (2.0, 2.0, 2.0)).factors_text, ShapeChange(True, (1.0, 1.0, 1.5)).factors_text
        ('2', '1 x 1 x 1.5')
        """
        if max(self.factors) - min(self.factors) < SAME * max(self.factors):
            return f"{self.factors[0]:.4g}"
        return " x ".join(f"{factor:.4g}" for factor in self.factors)


def shape_change(obj: bpy.types.Object) -> ShapeChange:
    """Return how the transform of a surface or slice changes its shape, Apply included."""
    matrix: Any = obj.matrix_world
    if read_provenance(obj) is not None:
        matrix = placement_of(obj).transform_mm(matrix)
    return change_of(np.array([list(row)[:3] for row in matrix][:3], float))


def change_of(linear: NDArray[np.float64]) -> ShapeChange:
    """Return how a (3, 3) matrix changes a shape.

    Examples
    --------
    >>> change_of(np.diag([-2.0, 2.0, 2.0]))
    ShapeChange(mirrored=True, factors=(2.0, 2.0, 2.0))
    """
    x, y, z = (float(length) for length in np.sqrt((linear**2).sum(axis=0)))
    return ShapeChange(determinant(linear) < 0, (x, y, z))
