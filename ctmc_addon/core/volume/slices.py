# SPDX-License-Identifier: GPL-3.0-or-later
"""One slice of a volume as a picture, and its position in the patient.

A slice follows the volume's own grid, so an oblique or sheared stack shows the samples it has: "axial" is the
plane across the axis that runs most towards the head or feet. Positions are RAS+ millimeters.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..measures.units import position_text
from ..mesh.vectors import cross, dot
from .affine import axis_codes, to_index, transform_points
from .value_kind import ValueKind
from .volume import Volume

# Each plane with the sides of the patient between which its slider runs.
PLANES = {"axial": "IS", "coronal": "PA", "sagittal": "LR"}
# Window and level of the abdomen in HU, as radiologists use them: from fat to contrast-filled vessels.
HU_WINDOW = (400.0, 40.0)
TINT = (1.0, 0.28, 0.12)
TINT_SHARE = 0.45
DIM = 0.5  # Labels that no surface is made of have this share of their color.


@dataclass(frozen=True)
class SliceIndex:
    """The slice `index` of `count` along axis `axis` (0, 1, 2 = x, y, z)."""

    axis: int
    index: int
    count: int


def slice_at(volume: Volume, plane: str, position: float) -> SliceIndex:
    """Return the slice of a plane nearest to `position`, 0 to 1 from left to right, back to front, or feet to head.

    Examples
    --------
    >>> ball = Volume(np.zeros((11, 4, 4)), np.diag([1.0, 1.0, -2.0, 1.0]))  # slices run towards the feet
    >>> slice_at(ball, "axial", 0.2)
    SliceIndex(axis=2, index=8, count=11)
    """
    codes = axis_codes(volume.affine)
    axis = next(number for number, code in enumerate(codes) if code in PLANES[plane])
    count = volume.size[axis]
    index = int(min(max(position, 0.0), 1.0) * (count - 1) + 0.5)
    if codes[axis] == PLANES[plane][0]:
        index = count - 1 - index
    return SliceIndex(axis, index, count)


def slice_through(volume: Volume, plane: str, point_mm: Sequence[float]) -> SliceIndex:
    """Return the slice of a plane nearest to a point in RAS+ mm; the outermost for a point outside the volume.

    Examples
    --------
    >>> stack = Volume(np.zeros((11, 4, 4)), np.diag([1.0, 1.0, 2.0, 1.0]))
    >>> slice_through(stack, "axial", (0.0, 0.0, 7.1)).index
    4
    """
    section = slice_at(volume, plane, 0.0)
    at = to_index(volume.affine, np.array([point_mm], np.float64))[0, section.axis]
    return replace(section, index=int(min(max(round(float(at)), 0), section.count - 1)))


def position_through(volume: Volume, plane: str, point_mm: Sequence[float]) -> float:
    """Return the position, 0 to 1, of the slice that `slice_through` finds.

    Examples
    --------
    >>> stack = Volume(np.zeros((11, 4, 4)), np.diag([1.0, 1.0, -2.0, 1.0]))  # slices run towards the feet
    >>> position_through(stack, "axial", (0.0, 0.0, -4.1))
    0.8
    """
    section, lowest = slice_through(volume, plane, point_mm), slice_at(volume, plane, 0.0)
    return abs(section.index - lowest.index) / max(section.count - 1, 1)


def stepped_position(volume: Volume, plane: str, position: float, by: int) -> float:
    """Return the position, 0 to 1, that is `by` slices farther to the right, front or head, as far as there are any.

    Examples
    --------
    >>> stepped_position(Volume(np.zeros((11, 4, 4)), np.eye(4)), "axial", 0.2, by=3)
    0.5
    """
    last = slice_at(volume, plane, position).count - 1
    return min(max(int(position * last + 0.5) + by, 0), last) / last


def slice_values(volume: Volume, section: SliceIndex) -> NDArray[Any]:
    """Return the samples of a slice (rows, columns), a view of values in memory.

    Of the two other axes, the faster one runs along a row.
    """
    columns, rows, slices = (
        range(section.index, section.index + 1) if axis == section.axis else range(size)
        for axis, size in enumerate(volume.size)
    )
    return np.squeeze(volume.samples(slices, rows, columns), axis=2 - section.axis)  # not all values, which are read


def slice_corners(volume: Volume, section: SliceIndex) -> NDArray[np.float64]:
    """Return the corners of a slice, (4, 3) RAS+ mm: row and column 0; last column; last column and row; last row.

    Half a voxel outside the outermost samples, so that the center of every pixel lies on its sample.
    """
    across, down = (axis for axis in range(3) if axis != section.axis)
    corners = np.empty((4, 3))
    corners[:, section.axis] = section.index
    corners[:, across] = np.array([0, 1, 1, 0]) * volume.size[across] - 0.5
    corners[:, down] = np.array([0, 0, 1, 1]) * volume.size[down] - 0.5
    return transform_points(volume.affine, corners)


def where_ray_meets(corners: NDArray[np.float64], origin: Sequence[float], direction: Sequence[float]) -> float | None:
    """Return how many `direction`s a ray goes to a slice; None where it passes, runs along it or leads away.

    Parameters
    ----------
    corners : (4, 3) ndarray of float64
        Corners of the slice, as `slice_corners` returns them; any unit.
    origin, direction : three floats
        Origin and direction of the ray, in the same space and unit.

    Examples
    --------
    >>> square = np.array([[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [1.0, 1.0, 2.0], [0.0, 1.0, 2.0]])
    >>> where_ray_meets(square, (0.5, 0.5, 0.0), (0.0, 0.0, 0.5))
    4.0
    """
    across, down, back = corners[1] - corners[0], corners[3] - corners[0], -np.array(direction, float)
    size = float(dot(across, cross(down, back)))
    if abs(size) < 1e-12:
        return None
    apart = np.array(origin, float) - corners[0]
    right = float(dot(apart, cross(down, back))) / size  # Cramer's rule
    below = float(dot(across, cross(apart, back))) / size
    way = float(dot(across, cross(down, apart))) / size
    return way if 0 <= right <= 1 and 0 <= below <= 1 and way > 0 else None


def slice_normal(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the normal of a slice, (3,) of length 1, from its corners (4, 3) as `slice_corners` returns them.

    Examples
    --------
    >>> slice_normal(np.array([[0.0, 0.0, 2.0], [3.0, 0.0, 2.0], [3.0, 2.0, 2.0], [0.0, 2.0, 2.0]])).tolist()
    [0.0, 0.0, 1.0]
    """
    normal = cross(corners[1] - corners[0], corners[3] - corners[0])
    return np.asarray(normal / np.sqrt(dot(normal, normal)), np.float64)


def windowed(
    values: NDArray[Any],
    window: float,
    level: float,
    threshold: float | None = None,
    labels: tuple[int, ...] = (),
    upper: float | None = None,
) -> NDArray[np.float32]:
    """Return gray values as colors, (rows, columns, 4) float32 in 0..1; values inside the surface are tinted.

    Parameters
    ----------
    window, level : float
        Values from `level - window / 2` (black) to `level + window / 2` (white).
    threshold : float, optional
        Values at or above it are tinted.
    labels : tuple of int
        Values equal to one of them are tinted, instead of a threshold.
    upper : float, optional
        Values above it are not tinted.

    Examples
    --------
    >>> windowed(np.array([[0, 50, 100]]), window=100, level=50)[0, :, 0].tolist()
    [0.0, 0.5, 1.0]
    """
    gray = values.astype(np.float32)
    np.subtract(gray, np.float32(level - window / 2), out=gray)
    np.divide(gray, np.float32(max(window, 1e-6)), out=gray)
    np.nan_to_num(gray, copy=False, nan=0.0)
    np.clip(gray, 0.0, 1.0, out=gray)
    colors = np.ones((*values.shape, 4), np.float32)
    if not labels and threshold is None:
        colors[..., :3] = gray[..., None]
        return colors
    inside = np.isin(values, labels) if labels else values >= threshold
    if upper is not None:
        inside &= values <= upper
    share = inside * np.float32(TINT_SHARE)
    gray *= 1 - share
    for channel, tint in enumerate(TINT):
        colors[..., channel] = gray + share * np.float32(tint)
    return colors


def in_label_colors(
    values: NDArray[Any], colors: Mapping[int, Sequence[float]], bright: Collection[int]
) -> NDArray[np.float32]:
    """Return labels in their colors, (rows, columns, 4) float32 in 0..1: those in `bright` full, the rest dim, 0 black.

    Examples
    --------
    >>> in_label_colors(np.array([[0, 1, 2]]), {1: (1, 0, 0), 2: (0, 1, 0)}, bright=[2])[0, :, :3].tolist()
    [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 1.0, 0.0]]
    """
    distinct, numbers = np.unique(values, return_inverse=True)
    table = np.zeros((len(distinct), 4), np.float32)
    table[:, 3] = 1.0
    for row, value in zip(table, distinct.tolist(), strict=True):
        row[:3] = np.multiply(colors.get(value, (0.0, 0.0, 0.0)), 1.0 if value in bright else DIM)
    picture: NDArray[np.float32] = table[numbers.reshape(values.shape)]
    return picture


def label_slices(volume: Volume, section: SliceIndex) -> tuple[NDArray[Any], ...]:
    """Return the labels of a slice, (rows, columns) for each layer of a label volume."""
    return tuple(slice_values(layer, section) for layer in volume.each_layer)


def with_labels(
    picture: NDArray[np.float32],
    layers: Sequence[NDArray[Any]],
    colors: Mapping[int, Sequence[float]],
    bright: Collection[int],
    share: float = 1.0,
) -> NDArray[np.float32]:
    """Return a picture with labels over it in this share of their colors; where layers overlap, half of each.

    With a share below 1 only the chosen labels are laid over it, with all of it the others are dim, as by
    `in_label_colors`.

    Parameters
    ----------
    picture : (rows, columns, 4) float32, 0 to 1
    layers : sequence of (rows, columns)
        Labels, 0 outside all of them.

    Examples
    --------
    >>> black = np.zeros((1, 3, 4), np.float32)
    >>> layers = np.array([[[0, 1, 1]], [[0, 0, 2]]])
    >>> with_labels(black, layers, {1: (1, 0, 0), 2: (0, 1, 0)}, bright=[1, 2])[0, :, :2].tolist()
    [[0.0, 0.0], [1.0, 0.0], [0.5, 0.5]]
    """
    out = picture.copy()
    covered = np.zeros(picture.shape[:2], bool)
    for values in layers:
        inside = values != 0 if share == 1.0 else np.isin(values, list(bright))
        if not inside.any():
            continue
        own = in_label_colors(values[inside][None], colors, bright)[0, :, :3]
        shares = np.where(covered[inside], np.float32(share / 2), np.float32(share))[:, None]
        out[inside, :3] = out[inside, :3] * (1 - shares) + own * shares
        covered |= inside
    return out


def default_window(volume: Volume, low: float, high: float) -> tuple[float, float]:
    """Return the window and level to begin with, for values from `low` to `high`."""
    if volume.kind == ValueKind.HU:
        return HU_WINDOW
    if not low <= high:
        return (1.0, 0.5)
    return (max(high - low, 1.0), (low + high) / 2)


def slice_position_text(volume: Volume, section: SliceIndex) -> str:
    """Return the position of a slice along the patient's axis that it crosses, such as 'z = -12.5 mm'.

    Examples
    --------
    >>> stack = Volume(np.zeros((3, 4, 4)), np.diag([1.0, 1.0, 2.5, 1.0]))
    >>> slice_position_text(stack, SliceIndex(2, 1, 3))
    'z = 2.5 mm'
    """
    side = next(side for side, pair in enumerate(("LR", "PA", "IS")) if axis_codes(volume.affine)[section.axis] in pair)
    place = float(slice_corners(volume, section).mean(axis=0)[side])
    return f"{'xyz'[side]} = {position_text([place], min(volume.spacing))}"
