# SPDX-License-Identifier: GPL-3.0-or-later
"""Fields on a lattice, in mm, above 0 inside. Values are float32 and never 0, so that products of two are exact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles, Flags, Floats
from ...mesh.distance.triangle_tree import TriangleTree
from ...progress import PAUSE, Steps
from ...volume.affine import to_index
from .lattice import Lattice
from .shapes import HalfSpace, Shape

LEAST = 2.0**-8  # Values are at least this share of the shortest step, so that no vertex meets a sample.
POINTS_AT_ONCE = 1 << 18


class LatticeField(Protocol):
    """A field on a lattice."""

    @property
    def keeps_volume(self) -> bool:
        """Whether vertices are moved outward by the depth that triangles cut off."""

    def above(self, low: int, high: int) -> Flags:
        """Return whether samples of layers `low` to `high` are above 0, (high - low, rows, columns)."""

    def values_steps(self, flat: NDArray[np.intp], threads: int) -> Steps[Floats]:
        """Return the values at samples by their flat indices, (n,), with the signs of `above`."""


def signed(values: NDArray[Any], above: Flags, lattice: Lattice) -> Floats:
    """Return values as float32 with the given signs, at least `LEAST` from 0."""
    size = np.maximum(np.abs(values.astype(np.float32)), np.float32(LEAST * lattice.shortest_mm))
    return np.where(above, size, -size)


@dataclass(frozen=True, eq=False)
class ShapeField:
    """The field of a shape with an exact distance, moved inward by `shift` mm."""

    shape: Shape
    lattice: Lattice
    shift: float = 0.0

    @property
    def keeps_volume(self) -> bool:
        """False: vertices lie on the shape itself."""
        return False

    def above(self, low: int, high: int) -> Flags:
        """Return whether the samples of some layers are inside the shape."""
        lattice, shape = self.lattice, self.shape
        if isinstance(shape, HalfSpace):
            return np.asarray(self._heights(shape, lattice.x, lattice.y[:, None], lattice.z[low:high, None, None]) > 0)
        out = np.zeros((high - low, *lattice.shape[1:]), bool)
        for layer in range(low, high):
            rows, columns = self._box(layer)
            if len(rows) and len(columns):
                y, x = (each.reshape(-1) for each in np.meshgrid(rows, columns, indexing="ij"))
                inside = self._at(x, y, np.full(len(x), layer)) > 0
                out[layer - low, rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] = inside.reshape(
                    len(rows), len(columns)
                )
        return out

    def values_steps(self, flat: NDArray[np.intp], threads: int) -> Steps[Floats]:
        """Return the distances at samples, positive inside."""
        _, rows, columns = self.lattice.shape
        out = np.empty(len(flat), np.float32)
        for start in range(0, len(flat), POINTS_AT_ONCE):
            z, rest = np.divmod(flat[start : start + POINTS_AT_ONCE], rows * columns)
            y, x = np.divmod(rest, columns)
            values = self._at(x, y, z)
            out[start : start + POINTS_AT_ONCE] = signed(values, values > 0, self.lattice)
            yield PAUSE
        return out

    def _at(self, x: NDArray[np.intp], y: NDArray[np.intp], z: NDArray[np.intp]) -> Doubles:
        lattice = self.lattice
        if isinstance(self.shape, HalfSpace):
            return self._heights(self.shape, lattice.x.take(x), lattice.y.take(y), lattice.z.take(z))
        return self.shape.at(lattice.points(x, y, z)) - self.shift

    def _heights(self, plane: HalfSpace, x: Doubles, y: Doubles, z: Doubles) -> Doubles:
        """Return heights above a plane, by the same sums for any shapes of the positions."""
        affine, unit = self.lattice.affine, plane.unit
        slopes = [sum(float(unit[row] * affine[row, column]) for row in range(3)) for column in range(3)]
        start = sum(float(unit[row] * (affine[row, 3] - plane.point[row])) for row in range(3))
        return np.asarray((slopes[0] * x + slopes[1] * y) + (slopes[2] * z + (start - self.shift)))

    def _box(self, layer: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the rows and columns that the shape may reach in a layer."""
        lattice = self.lattice
        rows, columns = np.arange(len(lattice.y)), np.arange(len(lattice.x))
        box = self.shape.box
        if box is None:
            return rows, columns
        corners = np.array([[box[at >> axis & 1][axis] for axis in range(3)] for at in range(8)])
        index = to_index(lattice.affine, corners)
        low, high = index.min(axis=0), index.max(axis=0)
        if not low[2] - 1 <= lattice.z[layer] <= high[2] + 1:
            return rows[:0], columns
        return (
            rows[(lattice.y >= low[1] - 1) & (lattice.y <= high[1] + 1)],
            columns[(lattice.x >= low[0] - 1) & (lattice.x <= high[0] + 1)],
        )


@dataclass(frozen=True, eq=False)
class StructureField:
    """The field of a structure's surface, moved inward by a level.

    Parameters
    ----------
    tree : TriangleTree
        The surface's triangles.
    lattice : Lattice
    inside : (z, y, x) bool
        Samples inside the surface.
    distance : (z, y, x) float32 or None
        Signed distance, positive inside, from `distances_steps` with this level; None at level 0 of a surface that was
        extracted on this lattice.
    level : float
        Distance inside the surface at which the field is 0, mm.
    """

    tree: TriangleTree
    lattice: Lattice
    inside: Flags
    distance: Floats | None = None
    level: float = 0.0

    @property
    def keeps_volume(self) -> bool:
        """Whether the level is not the surface itself."""
        return self.level != 0

    def above(self, low: int, high: int) -> Flags:
        """Return whether samples of layers `low` to `high` are deeper than the level."""
        if self.distance is None:
            return self.inside[low:high]
        return np.asarray(self.distance[low:high] > self.level)

    def values_steps(self, flat: NDArray[np.intp], threads: int) -> Steps[Floats]:
        """Return how much deeper than the level samples are."""
        if self.distance is not None:
            yield PAUSE
            values = self.distance.reshape(-1).take(flat).astype(np.float64) - self.level
            return signed(values, values > 0, self.lattice)
        _, rows, columns = self.lattice.shape
        z, rest = np.divmod(flat, rows * columns)
        y, x = np.divmod(rest, columns)
        squared, _ = yield from self.tree.nearest_steps(self.lattice.points(x, y, z).T, threads=threads)
        return signed(np.sqrt(squared), self.inside.reshape(-1).take(flat), self.lattice)


@dataclass(frozen=True, eq=False)
class HeldField:
    """A field held in memory, moved inward by `shift` mm.

    Parameters
    ----------
    lattice : Lattice
    values : (z, y, x) float32
    shift : float
    keeps_volume : bool
    """

    lattice: Lattice
    values: Floats
    shift: float = 0.0
    keeps_volume: bool = False

    def above(self, low: int, high: int) -> Flags:
        """Return whether the samples of some layers are above 0."""
        return np.asarray(self.values[low:high] > np.float32(self.shift))

    def values_steps(self, flat: NDArray[np.intp], threads: int) -> Steps[Floats]:
        """Return the values at samples."""
        yield PAUSE
        values = self.values.reshape(-1).take(flat) - np.float32(self.shift)
        return signed(values, values > 0, self.lattice)
