# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the grid for the labels of a segmentation or structure set, from its CT or its own frames.

Positions and directions are in DICOM's patient space (LPS+ mm), the affine leads to RAS+ mm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ....core import ReadError, mm_text
from ..header import Slice
from ..series.stack_geometry import SAME_MM, Stack, checked_normal, dot

EVEN = 0.1  # A frame may be off its slice by this share of a gap.
ON_PIXEL = 0.1  # A frame may be off the grid by this share of a pixel.
MOST_SLICES = 65536
FINEST_MM = 1e-3


@dataclass(frozen=True, eq=False)
class SliceGrid:
    """Slices of one orientation and spacing.

    Parameters
    ----------
    positions : (n, 3) float64
        First pixel of each scanned slice, LPS+ mm, along the normal.
    orientation : 6 floats
        Direction of a row, then of a column.
    spacing : (row_mm, column_mm)
        Between rows, then between columns.
    shape : (slices, rows, columns) int
        Shape of the volume.
    affine : (4, 4) float64
        Index of the volume to RAS+ mm.
    source : (slices,) int64
        For every slice of the volume the scanned slice whose labels it has; they differ where a CT was resampled.
    origins : (slices, 3) float64
        First pixel of each slice of the volume, LPS+ mm, along the normal.
    """

    positions: NDArray[np.float64]
    orientation: tuple[float, ...]
    spacing: tuple[float, ...]
    shape: tuple[int, int, int]
    affine: NDArray[np.float64]
    source: NDArray[np.int64]
    origins: NDArray[np.float64]

    @property
    def gap(self) -> float:
        """Return the usual distance between slices, mm."""
        heights = dot(self.positions, self._axes[2])
        return float(np.median(np.diff(heights)))

    @cached_property
    def _axes(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        row, column = np.array(self.orientation[:3], np.float64), np.array(self.orientation[3:], np.float64)
        return row, column, checked_normal(row, column)

    def located(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the nearest scanned slice of each point (n, 3), its column and row, and the way along the normal.

        Columns and rows are pixels and not rounded; the way is in mm.
        """
        row, column, normal = self._axes
        heights, along = dot(self.positions, normal), dot(points, normal)
        above = np.clip(np.searchsorted(heights, along), 1, len(heights) - 1)
        nearest = above - (along - heights[above - 1] <= heights[above] - along)
        offset = points - self.positions[nearest]
        x, y = dot(offset, row) / self.spacing[1], dot(offset, column) / self.spacing[0]
        return nearest, x, y, along - heights[nearest]

    @cached_property
    def heights(self) -> NDArray[np.float64]:
        """Return the place of each slice of the volume along the normal, (slices,), mm."""
        return dot(self.origins, self._axes[2])

    @cached_property
    def slice_mm(self) -> float:
        """Return the usual distance between slices of the volume, mm."""
        return float(np.median(np.diff(self.heights)))

    def scanned_numbers(self, heights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Count planes at these heights, mm, in slices that were scanned: 1.5 is halfway between the second and third.

        Outside of the slices the distance of the last two goes on.
        """
        scanned = dot(self.positions, self._axes[2])
        below = np.clip(np.searchsorted(scanned, heights, side="right") - 1, 0, len(scanned) - 2)
        numbers: NDArray[np.float64] = below + (heights - scanned[below]) / (scanned[below + 1] - scanned[below])
        return numbers

    def in_plane(self, points: NDArray[np.float64]) -> tuple[float, NDArray[np.float64], float]:
        """Return a contour (n, 3) in a plane parallel to the slices: its height, and (n, 2) column and row in pixels.

        The height is along the normal, mm. Between slices the first pixel lies between theirs, so that a body along a
        tilted stack keeps its pixels. Then how far the contour leaves its plane, mm.
        """
        row, column, normal = self._axes
        heights, along = self.heights, dot(points, normal)
        height = float(along.min() + along.max()) / 2
        above = int(np.clip(np.searchsorted(heights, height), 1, len(heights) - 1))
        below = above - 1
        nearest = above - int(height - heights[below] <= heights[above] - height)
        origin = self.origins[nearest]
        if abs(height - heights[nearest]) > EVEN * self.slice_mm:
            share = (height - heights[below]) / (heights[above] - heights[below])
            origin = self.origins[below] + share * (self.origins[above] - self.origins[below])
        offset = points - origin
        corners = np.stack([dot(offset, row) / self.spacing[1], dot(offset, column) / self.spacing[0]], axis=1)
        return height, corners, float(np.ptp(along)) / 2

    def offsets(
        self,
        positions: NDArray[np.float64],
        orientation: Sequence[float],
        spacing: Sequence[float],
        size: tuple[int, int],
    ) -> NDArray[np.int64] | None:
        """Return (n, 3) slice, first row and column of frames of `size` (rows, columns); None if they do not fit."""
        turn = max(abs(a - b) for a, b in zip(orientation, self.orientation, strict=True))
        reach = ON_PIXEL / max(size)  # by which a frame's far end may be off
        scale = max(abs(a / b - 1) for a, b in zip(spacing, self.spacing, strict=True))
        if turn > reach or scale > reach:
            return None
        nearest, x, y, way = self.located(positions)
        first = np.stack([nearest, np.rint(y), np.rint(x)], axis=1).astype(np.int64)  # (n, 3)
        largest_offset = max(float(np.abs(y - first[:, 1]).max()), float(np.abs(x - first[:, 2]).max()))
        inside = (first[:, 1:] >= 0).all() and (first[:, 1:] + size <= self.shape[1:]).all()
        fits = largest_offset <= ON_PIXEL and inside and float(np.abs(way).max()) <= EVEN * self.gap
        return first if fits else None


def grid_of_ct(slices: Sequence[Slice], stack: Stack, spacing: Sequence[float]) -> SliceGrid:
    """Return the grid of the volume that is read from slices.

    Parameters
    ----------
    slices : sequence of Slice
        Slices of one geometry.
    stack : Stack
        Their order and direction.
    spacing : (row, column) float
        Millimeters between pixels.
    """
    ordered = [slices[at] for at in stack.order]
    image = ordered[0].image
    positions = np.array([ct_slice.geometry.position for ct_slice in ordered], np.float64)
    source = stack.below + (stack.weight >= 0.5)
    next_slice = positions[np.minimum(stack.below + 1, len(positions) - 1)]
    origins = positions[stack.below] + stack.weight[:, None] * (next_slice - positions[stack.below])
    return SliceGrid(
        positions=positions,
        orientation=ordered[0].geometry.orientation or (),
        spacing=tuple(spacing),
        shape=(len(stack.below), image.rows, image.columns),
        affine=stack.affine,
        source=source.astype(np.int64),
        origins=origins,
    )


def grid_of_frames(
    positions: NDArray[np.float64],
    orientation: Sequence[float],
    spacing: Sequence[float],
    size: tuple[int, int],
    gap_hint: float,
    name: str,
) -> tuple[SliceGrid, list[str]]:
    """Return an even grid through frames at `positions` (n, 3), slices without a frame included, and notes.

    `gap_hint` is the distance between slices that the file tells, 0 where it tells none. A `ReadError` that calls the
    file `name` where the frames do not stand on an even grid.
    """
    row, column = np.array(orientation[:3], np.float64), np.array(orientation[3:], np.float64)
    normal = checked_normal(row, column)
    heights, first = np.unique(np.round(dot(positions, normal) / SAME_MM).astype(np.int64), return_index=True)
    ends = positions[first[0]], positions[first[-1]]
    height = dot(positions[first], normal)
    notes = []
    if len(heights) == 1:
        gap = gap_hint or 1.0
        step, count, start = normal * gap, 3, ends[0] - normal * gap
        notes.append(f"all frames lie in one slice; an empty slice was added on both sides, {mm_text(gap, 4)} away")
    else:
        total = float(height[-1] - height[0])
        count = next((count for count in counts(height, gap_hint) if count), 0)
        if not count:
            raise ReadError(
                f"the frames of {name} are not evenly spaced, and the series that it refers to is not near it; "
                "put the two in one folder"
            )
        step, start = (ends[1] - ends[0]) / (count - 1), ends[0]
        share = (height - height[0]) / total
        off = positions[first] - (ends[0] + share[:, None] * (ends[1] - ends[0]))
        if math.sqrt(float((off * off).sum(axis=1).max())) > 0.5 * min(spacing):
            raise ReadError(f"the frames of {name} do not form one stack; export it with frames of one size")
    slices = np.arange(count, dtype=np.int64)
    affine = np.eye(4)
    affine[:3, 0], affine[:3, 1], affine[:3, 2], affine[:3, 3] = row * spacing[1], column * spacing[0], step, start
    affine[:2] *= -1.0  # LPS to RAS
    origins = start + slices[:, None] * step
    return SliceGrid(origins, tuple(orientation), tuple(spacing), (count, *size), affine, slices, origins), notes


def counts(heights: NDArray[np.float64], gap_hint: float) -> list[int]:
    """Return the numbers of slices of even grids through all heights.

    Parameters
    ----------
    heights : (n,) float64
        Along the normal, mm.
    gap_hint : float
        Millimeters between slices that the file tells; 0 for none.

    Returns
    -------
    list of int
        For the gap that the file tells and for the narrowest one found; 0 where the grid would not be even, or
        too fine to be meant.
    """
    total = float(heights[-1] - heights[0])
    slice_counts = []
    for gap in (gap_hint, float(np.diff(heights).min())):
        steps = round(total / gap) if gap >= FINEST_MM and total / gap < MOST_SLICES else 0
        even = False
        if steps:
            index = (heights - heights[0]) * (steps / total)
            even = bool(np.abs(index - np.rint(index)).max() <= EVEN)
            even = even and len(np.unique(np.rint(index))) == len(heights)
        slice_counts.append(steps + 1 if even else 0)
    return slice_counts
