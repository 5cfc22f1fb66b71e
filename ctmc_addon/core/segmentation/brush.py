# SPDX-License-Identifier: GPL-3.0-or-later
"""Brush and eraser: balls in space or discs in a slice, along a stroke, in millimeters.

Only the window around the stroke is touched, so a stroke takes as long as it is large.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..errors import SettingsError
from ..volume.affine import to_index, transform_points
from ..volume.volume import Placed
from .distance import SLACK, Mask, Window
from .points import Point


def brushed_window(
    volume: Placed, stroke_ras_mm: Sequence[Point], radius_mm: float, normal: Point | None = None
) -> tuple[Window, Mask]:
    """Find the samples that a brush touches which is drawn along a stroke.

    Parameters
    ----------
    volume : Placed
        The grid; distances are those of its affine, oblique or sheared as it may be.
    stroke_ras_mm : sequence of (x, y, z)
        RAS+ mm, joined by straight lines; one point is one dab.
    radius_mm : float
        A sample belongs to the stroke if its center is at most so far from it.
    normal : (x, y, z), optional
        Of the slice that is drawn on: a disc in this plane, half a sample thick to either side, in place of a ball.

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
    z, y, x = np.meshgrid(*(np.arange(side.start, side.stop) for side in window), indexing="ij")
    at = transform_points(volume.affine, np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1))  # (n, 3)
    flat = touched.ravel()
    for start, end in lines:
        flat |= _near_line(at, start, end, radius_mm, axis, thickness)
    return window, flat.reshape(touched.shape)


def brush(
    mask: Mask,
    volume: Placed,
    stroke_ras_mm: Sequence[Point],
    radius_mm: float,
    normal: Point | None = None,
    within: Mask | None = None,
    erase: bool = False,
) -> Mask:
    """Return a mask with a stroke drawn, or erased; parameters as of `brushed_window`, `within` such as a range.

    Examples
    --------
    >>> from ctmc_addon.core import Volume
    >>> volume = Volume(np.zeros((5, 5, 5)), np.diag([1.0, 1.0, 2.0, 1.0]))
    >>> ball = brush(np.zeros((5, 5, 5), bool), volume, [(2, 2, 4)], 1.0)
    >>> disc = brush(ball, volume, [(2, 2, 4)], 2.0, normal=(0, 0, 1))
    >>> int(ball.sum()), int(disc.sum()), int(brush(disc, volume, [(2, 2, 4)], 1.0, erase=True).sum())
    (5, 13, 8)
    """
    window, touched = brushed_window(volume, stroke_ras_mm, radius_mm, normal)
    if within is not None:
        touched = touched & within[window]
    drawn = mask.copy()
    if erase:
        drawn[window] &= ~touched
    else:
        drawn[window] |= touched
    return drawn


def _window(
    volume: Placed,
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


def _half_thickness(volume: Placed, axis: NDArray[np.float64]) -> float:
    """Return half the distance, along a normal, from a sample to the neighbor that lies most along it."""
    along = np.abs((volume.affine[:3, :3] * axis[:, None]).sum(axis=0))  # (3,) mm for each axis of the index
    directions = along / np.sqrt((volume.affine[:3, :3] ** 2).sum(axis=0))
    return float(along[int(directions.argmax())]) / 2


def _near_line(
    at: NDArray[np.float64],
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    radius_mm: float,
    axis: NDArray[np.float64] | None,
    half_mm: float | None,
) -> NDArray[np.bool_]:
    """Return which points (n, 3) are at most a radius from a line; with an axis, from its disc in the plane."""
    along, apart = end - start, at - start
    inside = np.ones(len(at), bool)
    if axis is not None and half_mm is not None:
        above = apart[:, 0] * axis[0] + apart[:, 1] * axis[1] + apart[:, 2] * axis[2]
        inside = (above >= -half_mm * (1 + SLACK)) & (above < half_mm * (1 - SLACK))
        apart = apart - above[:, None] * axis
    length = float((along * along).sum())
    if length > 0:
        share = (apart[:, 0] * along[0] + apart[:, 1] * along[1] + apart[:, 2] * along[2]) / length
        apart = apart - np.clip(share, 0.0, 1.0)[:, None] * along
    square = apart[:, 0] ** 2 + apart[:, 1] ** 2 + apart[:, 2] ** 2
    return inside & (square <= radius_mm * radius_mm * (1 + SLACK))
