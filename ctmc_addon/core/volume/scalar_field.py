"""The scalar field that a surface is extracted from: region, label, NaN, threshold and smoothing.

Boxes are in voxel indices of the volume, three (start, stop) pairs in the order x, y, z.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import LabelError, VolumeError
from ..memory import require
from ..progress import Stages, Step, Steps
from ..settings import ReconstructionSettings
from .region import Box, box_slices, grown_box, region_box, relative_box
from .smoothing import REACH, gaussian_smooth_steps
from .thresholding import check_threshold, used_threshold_steps
from .volume import Volume

MOST_LABELS = 20  # listed in a message


@dataclass(frozen=True, eq=False)
class ScalarField:
    """Values to extract from, and their position in the volume.

    Parameters
    ----------
    values : (slices, rows, columns)
        Gray values, or a label's 0 and 1, of a box a little larger than the window.
    origin : (x, y, z) int
        The volume's index of the first value.
    window : Box
        The part of the volume that is extracted.
    threshold : float
    notes : tuple of str
    """

    values: NDArray[Any]
    origin: tuple[int, int, int]
    window: Box
    threshold: float
    notes: tuple[str, ...]

    @property
    def window_in_values(self) -> Box:
        """The window, counted from the first value."""
        return relative_box(self.window, self.origin)


def scalar_field_steps(
    volume: Volume, settings: ReconstructionSettings, threads: int | None = None, memory_limit: int | None = None
) -> Steps[ScalarField]:
    """Return what is extracted from `volume` with `settings`.

    Raises
    ------
    LabelError, ThresholdError, VolumeError, SettingsError, MemoryLimitError
    """
    window = region_box(volume, settings)
    looking = "Looking at the values" if settings.label is None else "Finding the label"
    stages = Stages({looking: 1} | ({"Smoothing": 1} if settings.soften_mm > 0 else {}))
    if settings.label is not None:
        window = yield from stages.run(looking, _label_box_steps(volume, settings, window))
    # Smoothing looks beyond the window, and so do normals, by one voxel.
    reach = [math.ceil(REACH * settings.soften_mm / side) for side in volume.spacing]
    box = grown_box(window, [margin + 1 for margin in reach], volume.size)
    origin = (box[0][0], box[1][0], box[2][0])
    values = volume.values[box_slices(box)]
    notes: tuple[str, ...] = ()
    if settings.label is not None:
        values = values == settings.label
        if settings.soften_mm == 0:
            notes = ("On a label that is not smoothed every crossing is the midpoint, and alpha has no effect.",)
    else:
        yield Step(0.0, looking)
        if values.dtype.kind == "f":
            smoothed = relative_box(grown_box(window, reach, volume.size), origin)
            values = _finite(values, values[box_slices(smoothed)], settings.nan_as, memory_limit)
        if settings.threshold is not None:
            check_threshold(settings.threshold, values[box_slices(relative_box(window, origin))], volume.kind)
    threshold = yield from stages.run(looking, used_threshold_steps(volume, settings))
    if settings.label is None and settings.threshold is None:
        notes = (f"No threshold or label was given: Otsu's threshold {threshold:g} is used.",)
    if settings.soften_mm > 0:
        require(
            9 * values.size,
            f"smoothing {values.shape[2]} x {values.shape[1]} x {values.shape[0]} voxels",
            "choose a region or do not smooth",
            memory_limit,
        )
        smoothing = gaussian_smooth_steps(values, volume.spacing, settings.soften_mm, threads)
        values = yield from stages.run("Smoothing", smoothing)
    return ScalarField(values, origin, window, threshold, notes)


def _finite(values: NDArray[Any], needed: NDArray[Any], nan_as: float | None, memory_limit: int | None) -> NDArray[Any]:
    """Return floating values, NaN and infinite ones replaced in a copy; without `nan_as` none may be among `needed`."""
    if nan_as is None:
        count = sum(int(layer.size - np.count_nonzero(np.isfinite(layer))) for layer in needed)
        if count:
            raise VolumeError(f"{count} voxels are NaN or infinite; replace them with nan_as, such as -1024 in HU")
        return values
    if all(np.isfinite(layer).all() for layer in values):
        return values
    require(values.nbytes, "replacing NaN voxels", "choose a region, or replace them in the file", memory_limit)
    whole = np.array(values)
    for layer in whole:
        layer[~np.isfinite(layer)] = nan_as
    return whole


def _label_box_steps(volume: Volume, settings: ReconstructionSettings, window: Box) -> Steps[Box]:
    """Return the box of a label, its sides on the stride's grid, so that the surface is that of the whole window."""
    values = volume.values[box_slices(window)]
    filled: list[int] = []
    rows = np.zeros(values.shape[1], bool)
    columns = np.zeros(values.shape[2], bool)
    for number, layer in enumerate(values):
        if number % 16 == 0:
            yield Step(number / len(values))
        inside = layer == settings.label
        if inside.any():
            filled.append(number)
            rows |= inside.any(axis=1)
            columns |= inside.any(axis=0)
    if not filled:
        raise LabelError(
            f"label {settings.label} is empty {'in this region' if settings.region else 'here'}; "
            f"{_existing_labels(values)}"
        )
    margin = [math.ceil(REACH * settings.soften_mm / side) + 1 for side in volume.spacing]
    extent = (np.flatnonzero(columns), np.flatnonzero(rows), np.array(filled))
    box = []
    for axis, (start, stop) in enumerate(window):
        stride = settings.stride[axis]
        low = max(0, int(extent[axis][0]) - margin[axis]) // stride * stride
        low = min(low, (stop - start - 1 - stride) // stride * stride)  # a whole voxel before a last, partial one
        high = -(-(int(extent[axis][-1]) + margin[axis]) // stride) * stride
        box.append((start + low, min(stop, start + high + 1)))
    return (box[0], box[1], box[2])


def _existing_labels(values: NDArray[Any]) -> str:
    labels = sorted({label for layer in values for label in np.unique(layer).tolist()} - {0})
    if not labels:
        return "every voxel is 0"
    named = ", ".join(f"{label:g}" for label in labels[:MOST_LABELS])
    return f"the labels are {named}{' and more' if len(labels) > MOST_LABELS else ''}"
