# SPDX-License-Identifier: GPL-3.0-or-later
"""Brush and eraser: balls in space or discs in a slice, along a stroke, in millimeters.

Only the windows around the lines of the stroke are looked at, some rows at a time, so a stroke takes as long as it is
large, and two bytes for each sample of its window.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags
from ...errors import SettingsError
from ...volume.affine import to_index
from ...volume.volume import SampleGrid, Volume
from ..distance import SLACK, Window
from ..points import Point
from .range_mask import in_range

Floats3 = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
SAMPLES = 1 << 13  # Handle this many samples at once: their distances stay in the processor's cache.


def brushed_window(
    volume: SampleGrid, stroke_ras_mm: Sequence[Point], radius_mm: float, normal: Point | None = None
) -> tuple[Window, Flags]:
    """Find the samples that a brush touches which is drawn along a stroke.

    Parameters
    ----------
    volume : SampleGrid
        The grid; distances are those of its affine, oblique or sheared as it may be.
    stroke_ras_mm : sequence of (x, y, z)
        RAS+ mm, joined by straight lines; one point is one dab.
    radius_mm : float
        A sample belongs to the stroke if its center is at most so far from it.
    normal : (x, y, z), optional
        Normal of the slice that is drawn on: a disc in this plane, half a sample thick to either side, not a ball.

    Returns
    -------
    window : (z, y, x) slices
        Empty where the stroke misses the grid.
    touched : bool, the shape of the window

    Raises
    ------
    SettingsError
        If the radius is not above zero, or the stroke has no point, or one that is not three finite numbers.
    """
    stroke = np.array(stroke_ras_mm, np.float64)
    if not (0 < radius_mm < math.inf):
        raise SettingsError(f"a brush has a radius above 0 mm, not {radius_mm:g}; choose one such as 5")
    if stroke.ndim != 2 or stroke.shape[1] != 3 or not len(stroke) or not np.isfinite(stroke).all():
        raise SettingsError("a stroke is one point or more of three finite numbers x y z in RAS+ mm")
    axis = thickness = None
    lines = list(pairwise(stroke)) or [(stroke[0], stroke[0])]
    if normal is not None:
        axis = np.array(normal, np.float64)
        axis /= math.sqrt(float((axis * axis).sum()))
        thickness = _half_thickness(volume, axis)
        lines = [(start, end - float(((end - start) * axis).sum()) * axis) for start, end in lines]  # in its plane
    window = _window(volume, np.concatenate(lines), radius_mm, axis, thickness)
    touched = np.zeros(tuple(side.stop - side.start for side in window), bool)
    if not touched.size:
        return window, touched
    for start, end in lines:
        own = _window(volume, np.stack([start, end]), radius_mm, axis, thickness)
        slices, rows, columns = (side.stop - side.start for side in own)
        near = np.zeros((slices * rows, columns), bool)
        at_once = max(1, SAMPLES // max(1, columns))
        for first in range(0, len(near) if columns else 0, at_once):
            numbers = np.arange(first, min(len(near), first + at_once))
            at = _positions(volume, own[0].start + numbers // rows, own[1].start + numbers % rows, own[2])
            near[numbers[0] : numbers[-1] + 1] = _near_line(at, start, end, radius_mm, axis, thickness)
        z, y, x = (slice(a.start - b.start, a.stop - b.start) for a, b in zip(own, window, strict=True))
        touched[z, y, x] |= near.reshape(slices, rows, columns)
    return window, touched


def brush(
    mask: Flags,
    volume: Volume,
    stroke_ras_mm: Sequence[Point],
    radius_mm: float,
    normal: Point | None = None,
    limits: tuple[float, float] | None = None,
    erase: bool = False,
) -> Window:
    """Draw a stroke into a mask in place, or erase it, and return its window; parameters as of `brushed_window`.

    Parameters
    ----------
    limits : (low, high), optional
        Only samples whose value is in this range are touched.

    Examples
    --------
    >>> from ctmc_addon.core import Volume
    >>> volume = Volume(np.zeros((5, 5, 5)), np.diag([1.0, 1.0, 2.0, 1.0]))
    >>> mask = np.zeros((5, 5, 5), bool)
    >>> brush(mask, volume, [(2, 2, 4)], 1.0)
    (slice(2, 3, None), slice(1, 4, None), slice(1, 4, None))
    >>> ball = int(mask.sum())
    >>> _ = brush(mask, volume, [(2, 2, 4)], 2.0, normal=(0, 0, 1))
    >>> disc = int(mask.sum())
    >>> _ = brush(mask, volume, [(2, 2, 4)], 1.0, erase=True)
    >>> ball, disc, int(mask.sum())
    (5, 13, 8)
    """
    window, touched = brushed_window(volume, stroke_ras_mm, radius_mm, normal)
    if limits is not None:
        touched &= in_range(volume.values[window], *limits)
    if erase:
        mask[window] &= ~touched
    else:
        mask[window] |= touched
    return window


def _window(
    volume: SampleGrid,
    stroke: NDArray[np.float64],
    radius_mm: float,
    axis: NDArray[np.float64] | None,
    half_mm: float | None,
) -> Window:
    """Return the window that holds all samples which the stroke may touch; of discs, with their axis."""
    index = to_index(volume.affine, stroke)
    # The index moves by a row of the inverse for each mm, so a ball reaches the row's length, and a disc that of the
    # row's part in its plane and half its thickness along the rest.
    origin = volume.affine[:3, 3]
    inverse = to_index(volume.affine, origin + np.eye(3)).T  # (3, 3): a row for each axis of the index
    along = np.zeros(3) if axis is None else (inverse * axis).sum(axis=1)
    across = np.sqrt(np.maximum((inverse * inverse).sum(axis=1) - along * along, 0.0))
    reach = (1 + SLACK) * (radius_mm * across + (half_mm or 0.0) * np.abs(along))
    low = np.ceil(index.min(axis=0) - reach - SLACK).astype(int)
    high = np.floor(index.max(axis=0) + reach + SLACK).astype(int) + 1
    x, y, z = (
        slice(min(size, max(0, first)), max(0, min(size, last), min(size, max(0, first))))
        for first, last, size in zip(low.tolist(), high.tolist(), volume.size, strict=True)
    )
    return z, y, x


def _half_thickness(volume: SampleGrid, axis: NDArray[np.float64]) -> float:
    """Return half the distance, along a normal, from a sample to the neighbor that lies most along it."""
    along = np.abs((volume.affine[:3, :3] * axis[:, None]).sum(axis=0))  # (3,) mm for each axis of the index
    directions = along / np.sqrt((volume.affine[:3, :3] ** 2).sum(axis=0))
    return float(along[int(directions.argmax())]) / 2


def _positions(volume: SampleGrid, z: NDArray[np.int64], y: NDArray[np.int64], columns: slice) -> Floats3:
    """Return where the samples of rows at (z, y) are, RAS+ mm: x, y and z, each (rows, columns)."""
    x = np.arange(columns.start, columns.stop)
    at = [(row[0] * x)[None] + ((row[1] * y) + (row[2] * z + row[3]))[:, None] for row in volume.affine[:3]]
    return at[0], at[1], at[2]


def _near_line(
    at: Floats3,
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    radius_mm: float,
    axis: NDArray[np.float64] | None,
    half_mm: float | None,
) -> NDArray[np.bool_]:
    """Return which points are at most a radius from a line; with an axis, from its disc in the plane."""
    along = end - start
    apart = [part - first for part, first in zip(at, start.tolist(), strict=True)]
    inside: Flags | bool = True
    if axis is not None and half_mm is not None:
        above = _dot(apart, axis)
        inside = (above >= -half_mm * (1 + SLACK)) & (above < half_mm * (1 - SLACK))
        apart = [part - above * step for part, step in zip(apart, axis.tolist(), strict=True)]
    length = float((along * along).sum())
    if length > 0:
        share = np.clip(_dot(apart, along) / length, 0.0, 1.0)
        apart = [part - share * step for part, step in zip(apart, along.tolist(), strict=True)]
    near: Flags = (apart[0] ** 2 + apart[1] ** 2 + apart[2] ** 2) <= radius_mm * radius_mm * (1 + SLACK)
    return near & inside


def _dot(vectors: Sequence[NDArray[np.float64]], vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the scalar products of vectors, given as x, y and z, with another one."""
    x, y, z = vector.tolist()
    return vectors[0] * x + vectors[1] * y + vectors[2] * z
