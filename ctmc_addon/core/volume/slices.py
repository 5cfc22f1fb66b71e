"""One slice of a volume as a picture, and where it lies in the patient.

A slice follows the volume's own grid, so an oblique or sheared stack shows the samples it has: "axial" is the
plane across the axis that runs most towards the head or feet. Places are RAS+ millimetres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .affine import axis_codes, transform_points
from .volume import Volume

# Each plane with the patient's sides it lies between; a slider runs from the first to the second.
PLANES = {"axial": "IS", "coronal": "PA", "sagittal": "LR"}
# Window and level radiologists read HU with: from fat to contrast-filled vessels.
HU_WINDOW = (400.0, 40.0)
TINT = (1.0, 0.28, 0.12)
TINT_SHARE = 0.45


@dataclass(frozen=True)
class SlicePlace:
    """Which samples a slice takes: index `index` along axis `axis` (0, 1, 2 = x, y, z) of `count`."""

    axis: int
    index: int
    count: int


def slice_place(volume: Volume, plane: str, position: float) -> SlicePlace:
    """The slice of a plane nearest to `position`, 0 to 1 from left to right, back to front, or feet to head.

    Examples
    --------
    >>> ball = Volume(np.zeros((11, 4, 4)), np.diag([1.0, 1.0, -2.0, 1.0]))  # slices run towards the feet
    >>> slice_place(ball, "axial", 0.2)
    SlicePlace(axis=2, index=8, count=11)
    """
    codes = axis_codes(volume.affine)
    axis = next(at for at, code in enumerate(codes) if code in PLANES[plane])
    count = volume.size[axis]
    index = int(min(max(position, 0.0), 1.0) * (count - 1) + 0.5)
    if codes[axis] == PLANES[plane][0]:
        index = count - 1 - index
    return SlicePlace(axis, index, count)


def slice_values(volume: Volume, place: SlicePlace) -> NDArray[Any]:
    """The samples of a slice, a view (rows, columns): of the two other axes, the faster one runs along a row."""
    if place.axis == 0:
        return volume.values[:, :, place.index]
    return volume.values[:, place.index] if place.axis == 1 else volume.values[place.index]


def slice_corners(volume: Volume, place: SlicePlace) -> NDArray[np.float64]:
    """Corners of a slice, (4, 3) RAS+ mm: row and column 0; last column; last column and row; last row.

    Half a voxel outside the outermost samples, so that every pixel's middle lies on its sample.
    """
    across, down = (axis for axis in range(3) if axis != place.axis)
    corners = np.empty((4, 3))
    corners[:, place.axis] = place.index
    corners[:, across] = np.array([0, 1, 1, 0]) * volume.size[across] - 0.5
    corners[:, down] = np.array([0, 0, 1, 1]) * volume.size[down] - 0.5
    return transform_points(volume.affine, corners)


def picture(
    values: NDArray[Any],
    window: float,
    level: float,
    threshold: float | None = None,
    labels: tuple[int, ...] = (),
) -> NDArray[np.float32]:
    """Grey values as colours, (rows, columns, 4) float32 in 0..1; what will be inside the surface is tinted.

    Parameters
    ----------
    window, level : float
        Values from `level - window / 2` (black) to `level + window / 2` (white).
    threshold : float, optional
        Values at or above it are tinted.
    labels : tuple of int
        Values equal to one of them are tinted, instead of a threshold.

    Examples
    --------
    >>> picture(np.array([[0, 50, 100]]), window=100, level=50)[0, :, 0].tolist()
    [0.0, 0.5, 1.0]
    """
    grey = values.astype(np.float32)
    np.subtract(grey, np.float32(level - window / 2), out=grey)
    np.divide(grey, np.float32(max(window, 1e-6)), out=grey)
    np.nan_to_num(grey, copy=False, nan=0.0)
    np.clip(grey, 0.0, 1.0, out=grey)
    colours = np.ones((*values.shape, 4), np.float32)
    if not labels and threshold is None:
        colours[..., :3] = grey[..., None]
        return colours
    inside = np.isin(values, labels) if labels else values >= threshold
    share = inside * np.float32(TINT_SHARE)
    grey *= 1 - share
    for channel, tint in enumerate(TINT):
        colours[..., channel] = grey + share * np.float32(tint)
    return colours


def usual_window(volume: Volume, low: float, high: float) -> tuple[float, float]:
    """Window and level to begin with, for values that reach from `low` to `high`."""
    if volume.kind == "HU":
        return HU_WINDOW
    if not low <= high:
        return (1.0, 0.5)
    return (max(high - low, 1.0), (low + high) / 2)


def slice_middle(volume: Volume, place: SlicePlace) -> str:
    """The middle of a slice along the patient's axis it lies across, such as 'z = -12.5 mm'.

    Examples
    --------
    >>> stack = Volume(np.zeros((3, 4, 4)), np.diag([1.0, 1.0, 2.5, 1.0]))
    >>> slice_middle(stack, SlicePlace(2, 1, 3))
    'z = 2.5 mm'
    """
    side = next(at for at, pair in enumerate(("LR", "PA", "IS")) if axis_codes(volume.affine)[place.axis] in pair)
    return f"{'xyz'[side]} = {slice_corners(volume, place).mean(axis=0)[side]:.1f} mm"
