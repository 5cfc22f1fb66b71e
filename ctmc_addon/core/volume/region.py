# SPDX-License-Identifier: GPL-3.0-or-later
"""Boxes in the patient: around a whole volume, and the region that a surface is extracted from.

A region is given as lowest x, y, z and highest x, y, z, in voxel indices or RAS+ millimeters (settings.py); in
voxels its box is as oblique or sheared as the volume. Corners are numbered by bits: 1 = high x, 2 = high y, 4 = high z.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..errors import SettingsError
from ..settings import ReconstructionSettings, require_corners_in_order
from .affine import to_index, transform_points
from .volume import Box, SampleGrid

EDGES = tuple((corner, corner | bit) for bit in (1, 2, 4) for corner in range(8) if not corner & bit)
SIDES = {"R": (1, 0, 0), "L": (-1, 0, 0), "A": (0, 1, 0), "P": (0, -1, 0), "S": (0, 0, 1), "I": (0, 0, -1)}
Region = tuple[float, ...]


def box_slices(box: Box) -> tuple[slice, slice, slice]:
    """Return the slices (z, y, x) that take a box out of an array of values.

    Examples
    --------
    >>> box_slices(((0, 4), (1, 3), (2, 5)))
    (slice(2, 5, None), slice(1, 3, None), slice(0, 4, None))
    """
    x, y, z = box
    return slice(*z), slice(*y), slice(*x)


def grown_box(box: Box, margins: Sequence[int], size: tuple[int, int, int]) -> Box:
    """Return a box that is larger by a margin along x, y and z on both sides, inside a volume of this size."""
    x, y, z = (
        (max(0, start - margin), min(count, stop + margin))
        for (start, stop), margin, count in zip(box, margins, size, strict=True)
    )
    return x, y, z


def relative_box(box: Box, origin: tuple[int, int, int]) -> Box:
    """Return a box counted from another first voxel (x, y, z)."""
    x, y, z = ((start - first, stop - first) for (start, stop), first in zip(box, origin, strict=True))
    return x, y, z


def volume_box(volume: SampleGrid) -> NDArray[np.float64]:
    """Return the eight corners of a volume's outermost samples, (8, 3) RAS+ mm."""
    x, y, z = volume.size
    return region_corners(volume, (0.0, 0.0, 0.0, x - 1.0, y - 1.0, z - 1.0), "voxel")


def region_corners(volume: SampleGrid, region: Region, unit: str) -> NDArray[np.float64]:
    """Return the eight corners of a region, (8, 3) RAS+ mm."""
    ends = np.array(region, np.float64).reshape(2, 3)
    corners = np.array([[ends[corner >> axis & 1, axis] for axis in range(3)] for corner in range(8)])
    return corners if unit == "mm" else transform_points(volume.affine, corners)


def region_axes(volume: SampleGrid, unit: str) -> NDArray[np.float64]:
    """Return one unit along each of a region's axes, (3, 3) RAS+ mm, a row for each axis."""
    return np.eye(3) if unit == "mm" else volume.affine[:3, :3].T.copy()


def region_shift(volume: SampleGrid, unit: str, shift_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far a shift of (3,) RAS+ mm moves a region along each of its axes, (3,) in its unit.

    Examples
    --------
    >>> from ctmc_addon.core import Volume
    >>> region_shift(Volume(np.zeros((2, 2, 2)), np.diag([-1.0, 1.0, 5.0, 1.0])), "voxel", np.ones(3)).tolist()
    [-1.0, 1.0, 0.2]
    """
    if unit == "mm":
        return shift_mm
    ends = np.array([np.zeros(3), shift_mm]) + volume.affine[:3, 3]
    at = to_index(volume.affine, ends)
    return at[1] - at[0]


def region_limits(volume: SampleGrid, unit: str) -> Region:
    """Return the region that holds the whole volume: lowest x, y, z, then highest.

    Examples
    --------
    >>> from ctmc_addon.core import Volume
    >>> region_limits(Volume(np.zeros((2, 3, 4)), np.diag([-1.0, 1.0, 5.0, 1.0])), "mm")
    (-3.0, 0.0, 0.0, 0.0, 2.0, 5.0)
    """
    if unit == "mm":
        corners = volume_box(volume)
        ends = [*corners.min(axis=0), *corners.max(axis=0)]
    else:
        ends = [0.0, 0.0, 0.0, *(size - 1.0 for size in volume.size)]
    return tuple(float(end) for end in ends)


def converted_region(volume: SampleGrid, region: Region, unit: str, target_unit: str) -> Region:
    """Return the box in voxels or mm that holds a region given in the other unit.

    Examples
    --------
    >>> from ctmc_addon.core import Volume
    >>> box = Volume(np.zeros((2, 3, 4)), np.diag([-1.0, 1.0, 5.0, 1.0]))
    >>> converted_region(box, (0.0, 0.0, 0.0, 3.0, 2.0, 1.0), "voxel", "mm")
    (-3.0, 0.0, 0.0, 0.0, 2.0, 5.0)
    """
    if unit == target_unit:
        return tuple(float(end) for end in region)
    corners = region_corners(volume, region, unit)
    at = corners if target_unit == "mm" else to_index(volume.affine, corners)
    limits = np.array(region_limits(volume, target_unit)).reshape(2, 3)
    low, high = np.clip(at.min(axis=0), *limits), np.clip(at.max(axis=0), *limits)
    return tuple(float(end) for end in (*low, *high))


def with_moved_face(region: Region, face: int, value: float, limits: Region) -> Region:
    """Return a region with one face (0..5) moved to `value`, inside the limits and short of its opposite.

    Examples
    --------
    >>> with_moved_face((0, 0, 0, 9, 9, 9), 3, 20.0, (0, 0, 0, 15, 15, 15))
    (0, 0, 0, 15.0, 9, 9)
    >>> with_moved_face((0, 0, 0, 9, 9, 9), 0, 12.0, (0, 0, 0, 15, 15, 15))
    (8.0, 0, 0, 9, 9, 9)
    """
    axis = face % 3
    value = min(max(value, limits[axis]), limits[axis + 3])
    value = min(value, region[axis + 3] - 1.0) if face < 3 else max(value, region[axis] + 1.0)
    return (*region[:face], float(value), *region[face + 1 :])


def moved_region(region: Region, axis: int, shift: float, limits: Region) -> Region:
    """Return a region shifted along one axis, as far as the limits allow.

    Examples
    --------
    >>> moved_region((2, 0, 0, 9, 9, 9), 0, 20.0, (0, 0, 0, 15, 15, 15))
    (8.0, 0, 0, 15.0, 9, 9)
    """
    low, high = region[axis], region[axis + 3]
    shift = min(max(shift, limits[axis] - low), max(limits[axis + 3] - high, 0.0))
    moved = list(region)
    moved[axis], moved[axis + 3] = float(low + shift), float(high + shift)
    return tuple(moved)


def side_positions(corners: NDArray[np.float64], gap: float = 0.06) -> dict[str, NDArray[np.float64]]:
    """Return where to write R, L, A, P, S and I around a box: letter to (3,) RAS+ mm, outside by a share of its size.

    Examples
    --------
    >>> from ctmc_addon.core import Volume
    >>> ball = Volume(np.zeros((11, 11, 11)), np.eye(4))
    >>> side_positions(volume_box(ball), gap=0.1)["L"].tolist()
    [-1.0, 5.0, 5.0]
    """
    low, high = corners.min(axis=0), corners.max(axis=0)
    reach = (high - low) / 2 + gap * (high - low).max()
    return {letter: (low + high) / 2 + np.array(side) * reach for letter, side in SIDES.items()}


def settings_of_copy(settings: ReconstructionSettings, stride: tuple[int, int, int]) -> ReconstructionSettings:
    """Return a volume's settings for its copy that keeps one of every few samples along (x, y, z).

    Examples
    --------
    >>> coarse = settings_of_copy(ReconstructionSettings(region=(4, 4, 0, 20, 20, 7), stride=(2, 2, 1)), (4, 4, 1))
    >>> coarse.region, coarse.stride
    ((1.0, 1.0, 0.0, 5.0, 5.0, 7.0), (1, 1, 1))
    """
    if stride == (1, 1, 1):
        return settings
    region = settings.region
    if region is not None and settings.region_unit == "voxel":
        low_x, low_y, low_z, high_x, high_y, high_z = region
        x, y, z = stride
        region = (low_x / x, low_y / y, low_z / z, high_x / x, high_y / y, high_z / z)
    wide, high, deep = (-(-own // side) for own, side in zip(settings.stride, stride, strict=True))
    return replace(settings, region=region, stride=(wide, high, deep))


def region_box(volume: SampleGrid, settings: ReconstructionSettings) -> Box:
    """Return the voxels inside the region of the settings, or all voxels; errors are those of `box_of`."""
    return box_of(volume, settings.region, settings.region_unit)


def box_of(volume: SampleGrid, region: Region | None, unit: str) -> Box:
    """Return the voxels inside a region, or all voxels; a region in mm takes every voxel that it touches.

    Raises
    ------
    SettingsError
        If fewer than two samples of the volume along an axis lie in the region, or its corners are not in order.
    """
    if region is None:
        x, y, z = volume.size
        return (0, x), (0, y), (0, z)
    require_corners_in_order(region)
    low, high = np.array(region[:3]), np.array(region[3:])
    if unit == "mm":
        corners = np.array(list(product(*zip(low, high, strict=True))))  # (8, 3)
        at = to_index(volume.affine, corners)
        low, high = at.min(axis=0), at.max(axis=0)
    box = []
    for axis, size in enumerate(volume.size):
        # A millionth of a voxel is rounding, not a voxel that is touched.
        start, stop = max(0, math.floor(low[axis] + 1e-6)), min(size, math.ceil(high[axis] - 1e-6) + 1)
        if stop - start < 2:
            raise SettingsError(
                f"region {region} ({unit}) leaves fewer than 2 of the volume's {size} samples along "
                f"{'xyz'[axis]}; choose one inside the volume"
            )
        box.append((start, stop))
    return (box[0], box[1], box[2])
