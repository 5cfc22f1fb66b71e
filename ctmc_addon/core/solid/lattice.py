# SPDX-License-Identifier: GPL-3.0-or-later
"""The lattice of samples that parts are extracted from: rising positions along x, y and z of a volume's index space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Doubles
from ..volume.affine import transform_points


@dataclass(frozen=True, eq=False)
class Lattice:
    """Samples in space.

    Parameters
    ----------
    x, y, z : (n,) float64
        Rising positions in index space.
    affine : (4, 4) float64
        Index (x, y, z) to RAS+ mm.
    """

    x: Doubles
    y: Doubles
    z: Doubles
    affine: Doubles

    @property
    def shape(self) -> tuple[int, int, int]:
        """Samples along z, y and x."""
        return len(self.z), len(self.y), len(self.x)

    @property
    def sides_mm(self) -> tuple[float, float, float]:
        """Largest steps along x, y and z, mm."""
        scale = np.sqrt((self.affine[:3, :3] ** 2).sum(axis=0))
        x, y, z = (
            float(np.diff(along).max() * each) for along, each in zip((self.x, self.y, self.z), scale, strict=True)
        )
        return x, y, z

    @property
    def shortest_mm(self) -> float:
        """Shortest step along any axis, mm."""
        scale = np.sqrt((self.affine[:3, :3] ** 2).sum(axis=0))
        return min(
            float(np.diff(along).min() * each) for along, each in zip((self.x, self.y, self.z), scale, strict=True)
        )

    def points(self, x: NDArray[np.intp], y: NDArray[np.intp], z: NDArray[np.intp]) -> Doubles:
        """Return the places of samples by their numbers, three (n,), as RAS+ mm (3, n)."""
        index = np.stack([self.x.take(x), self.y.take(y), self.z.take(z)], axis=-1)
        return np.ascontiguousarray(transform_points(self.affine, index).T)
