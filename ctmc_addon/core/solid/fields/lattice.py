# SPDX-License-Identifier: GPL-3.0-or-later
"""The lattice of samples that parts are extracted from: rising positions along the axes of a volume's index space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles
from ...volume.affine import cofactors, determinant, to_index, transform_points
from ...volume.volume import Volume
from .shapes import Box

AROUND = 3  # Add this many samples beyond the requested range, at either end.


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
    def samples(self) -> int:
        """Number of samples."""
        return len(self.z) * len(self.y) * len(self.x)

    @property
    def shortest_sides_mm(self) -> tuple[float, float, float]:
        """Shortest steps along x, y and z, mm."""
        scale = np.sqrt((self.affine[:3, :3] ** 2).sum(axis=0))
        x, y, z = (
            float(np.diff(along).min() * each) for along, each in zip((self.x, self.y, self.z), scale, strict=True)
        )
        return x, y, z

    @property
    def shortest_mm(self) -> float:
        """Shortest step along any axis, mm."""
        return min(self.shortest_sides_mm)

    def around(self, points: NDArray[np.float32], margin_mm: float) -> Lattice:
        """Return the part of the lattice that holds points (n, 3) and a margin around them."""
        low, high = _range_of(points, self.affine, margin_mm)
        along = []
        for axis, positions in enumerate((self.x, self.y, self.z)):
            start = int(np.searchsorted(positions, low[axis])) - AROUND
            stop = int(np.searchsorted(positions, high[axis])) + AROUND
            along.append(positions[max(0, start) : stop])
        return Lattice(along[0], along[1], along[2], self.affine)

    def window_of(self, part: Lattice) -> tuple[slice, slice, slice]:
        """Return the slices along z, y and x that select a part of the lattice in arrays of the whole."""
        z, y, x = (
            slice(start, start + len(own))
            for own, start in (
                (own, int(np.searchsorted(all_, own[0])))
                for own, all_ in ((part.z, self.z), (part.y, self.y), (part.x, self.x))
            )
        )
        return z, y, x

    def refined(self, box: Box, longest_mm: float) -> Lattice:
        """Return the lattice with divided steps in a box, RAS+ mm.

        No step that reaches into the box is longer than `longest_mm`.
        """
        index = to_index(self.affine, corners_of(box))
        scale = np.sqrt((self.affine[:3, :3] ** 2).sum(axis=0))
        low, high = index.min(axis=0), index.max(axis=0)
        x, y, z = (
            _divided(positions, longest_mm / scale[axis], low[axis], high[axis])
            for axis, positions in enumerate((self.x, self.y, self.z))
        )
        return self if (len(z), len(y), len(x)) == self.shape else Lattice(x, y, z, self.affine)

    def points(self, x: NDArray[np.intp], y: NDArray[np.intp], z: NDArray[np.intp]) -> Doubles:
        """Return the positions of samples, RAS+ mm (3, n), by their indices along x, y and z, (n,) each."""
        index = np.stack([self.x.take(x), self.y.take(y), self.z.take(z)], axis=-1)
        return np.ascontiguousarray(transform_points(self.affine, index).T)


def lattice_around(
    volume: Volume,
    stride: tuple[int, int, int],
    slice_steps: int,
    region: Sequence[tuple[int, int]],
    points: NDArray[np.float32],
    margin_mm: float,
    longest_mm: float,
) -> Lattice:
    """Return the samples that a surface was extracted from, as far as its points reach, with a margin.

    Parameters
    ----------
    volume : Volume
    stride : (x, y, z) int
    slice_steps : int
        Number of steps from slice to slice.
    region : Box
        Samples of the volume that were extracted.
    points : (n, 3) float32
        Vertices, RAS+ mm.
    margin_mm : float
        Space around the points; beyond the border of the volume the samples continue with the same steps.
    longest_mm : float
        Longer steps are divided.
    """
    low, high = _range_of(points, np.asarray(volume.affine), margin_mm)
    along = []
    for axis, ((start, stop), side, spacing) in enumerate(zip(region, stride, volume.spacing, strict=True)):
        steps = slice_steps if axis == 2 else 1
        positions = _positions(start * steps, (stop - 1) * steps, side, low[axis] * steps, high[axis] * steps)
        parts = steps_in(side * spacing / steps, longest_mm)
        along.append(_parted(positions, np.full(len(positions) - 1, parts)) / steps)
    x, y, z = along
    return Lattice(x, y, z, np.array(volume.affine, np.float64))


def steps_in(side_mm: float, longest_mm: float) -> int:
    """Return the least number of equal steps in a side of which none is longer than `longest_mm`."""
    return max(1, math.ceil(side_mm / longest_mm - 1e-6))


def corners_of(box: Box) -> Doubles:
    """Return the corners of a box, (8, 3)."""
    return np.array([[box[at >> axis & 1][axis] for axis in range(3)] for at in range(8)])


def with_box(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return points (n, 3), followed by the corners of the box around them."""
    box = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
    return np.concatenate([points, corners_of(box).astype(np.float32)])


def _range_of(points: NDArray[np.float32], affine: Doubles, margin_mm: float) -> tuple[Doubles, Doubles]:
    """Return the lowest and the highest index along each axis that points (n, 3) and their margin reach."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for start in range(0, len(points), 1 << 18):
        index = to_index(affine, points[start : start + (1 << 18)].astype(np.float64))
        low, high = np.minimum(low, index.min(axis=0)), np.maximum(high, index.max(axis=0))
    inverse = cofactors(affine)[:3, :3].T / determinant(affine)
    margins = margin_mm * np.sqrt((inverse * inverse).sum(axis=1))
    return low - margins, high + margins


def _positions(first: int, last: int, side: int, low: float, high: float) -> Doubles:
    """Return positions from before `low` to beyond `high`, continuing a closed grid from `first` to `last`."""
    before, beyond = (max(0, math.ceil(each / side)) + AROUND for each in (first - low, high - last))
    positions = np.concatenate(
        [
            first - 1.0 - side * np.arange(before, -1, -1),
            np.arange(first, last, side, dtype=np.float64),
            [float(last)],
            last + 1.0 + side * np.arange(beyond + 1),
        ]
    )
    start = max(0, int(np.searchsorted(positions, low)) - AROUND)
    return positions[start : int(np.searchsorted(positions, high)) + AROUND]


def _divided(positions: Doubles, longest: float, low: float, high: float) -> Doubles:
    """Return positions with divided steps between `low` and `high`, and one more divided step at either end."""
    gaps = np.diff(positions)
    reach = float(gaps.max())
    within = (positions[1:] > low - reach) & (positions[:-1] < high + reach)
    return _parted(positions, np.where(within, np.maximum(1, np.ceil(gaps / longest - 1e-6)), 1).astype(np.intp))


def _parted(positions: Doubles, parts: NDArray[np.intp]) -> Doubles:
    """Return positions with each step divided into its number of equal parts."""
    low = np.repeat(np.arange(len(parts)), parts)
    share = np.arange(len(low)) - np.repeat(np.cumsum(parts) - parts, parts)
    gaps = np.diff(positions) / parts
    return np.append(positions.take(low) + gaps.take(low) * share, positions[-1])
