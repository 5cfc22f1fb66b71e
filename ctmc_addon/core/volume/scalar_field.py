"""The part of a volume a surface is sought in: region, label, NaN and softening.

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
from ..progress import Step, Steps, within
from ..settings import ReconstructionSettings
from .region import Box, box_slices, region_box
from .smoothing import REACH, soften_steps
from .thresholding import check_threshold, used_threshold_steps
from .volume import Volume

MOST_LABELS = 20  # as many are named in a message


@dataclass(frozen=True, eq=False)
class ScalarField:
    """Values to extract from, and where they lie in the volume.

    Parameters
    ----------
    values : (slices, rows, columns)
        Grey values, or a label's 0 and 1, of a box a little larger than the window.
    origin : (x, y, z) int
        The volume's index of the first of the values.
    window : Box
        What of the volume is to be extracted.
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
        """The window counted from the first of the values."""
        return tuple(  # type: ignore[return-value]
            (start - low, stop - low) for (start, stop), low in zip(self.window, self.origin, strict=True)
        )


def scalar_field_steps(
    volume: Volume, settings: ReconstructionSettings, threads: int | None = None, memory_limit: int | None = None
) -> Steps[ScalarField]:
    """What to extract from `volume` under `settings`.

    Raises
    ------
    LabelError, ThresholdError, VolumeError, SettingsError, MemoryLimitError
    """
    window = region_box(volume, settings)
    if settings.label is not None:
        window = yield from within(_label_box(volume, settings, window), 0.0, 0.5)
    # The blur looks beyond the window, and so do normals, by one voxel.
    blur = [math.ceil(REACH * settings.soften_mm / side) for side in volume.spacing]
    box = _grown(window, [margin + 1 for margin in blur], volume.size)
    values = volume.values[box_slices(box)]
    notes: tuple[str, ...] = ()
    if settings.label is not None:
        values = values == settings.label
        if settings.soften_mm == 0:
            notes = ("On a label that is not smoothed every crossing is the midpoint, and alpha has no effect.",)
    else:
        yield Step(0.0, "Looking at the values")
        if values.dtype.kind == "f":
            reached = _within(_grown(window, blur, volume.size), box)
            values = _finite(values, values[box_slices(reached)], settings.nan_as, memory_limit)
        if settings.threshold is not None:
            check_threshold(settings.threshold, values[box_slices(_within(window, box))], volume.kind)
    threshold = yield from used_threshold_steps(volume, settings)
    if settings.label is None and settings.threshold is None:
        notes = (f"No threshold or label was given: Otsu's threshold {threshold:g} is used.",)
    if settings.soften_mm > 0:
        require(
            9 * values.size,
            f"softening {values.shape[2]} x {values.shape[1]} x {values.shape[0]} voxels",
            "choose a region or do without softening",
            memory_limit,
        )
        values = yield from within(soften_steps(values, volume.spacing, settings.soften_mm, threads), 0.5, 1.0)
    yield Step(1.0, "Values ready")
    return ScalarField(values, (box[0][0], box[1][0], box[2][0]), window, threshold, notes)


def _grown(box: Box, margins: list[int], size: tuple[int, int, int]) -> Box:
    return tuple(  # type: ignore[return-value]
        (max(0, start - margin), min(most, stop + margin))
        for (start, stop), margin, most in zip(box, margins, size, strict=True)
    )


def _within(box: Box, around: Box) -> Box:
    """`box` counted from the first voxel of the box around it."""
    return tuple(  # type: ignore[return-value]
        (start - low, stop - low) for (start, stop), (low, _) in zip(box, around, strict=True)
    )


def _finite(
    values: NDArray[Any], reached: NDArray[Any], nan_as: float | None, memory_limit: int | None
) -> NDArray[Any]:
    """Floating values, NaN and infinite ones replaced in a copy; without `nan_as` none may be among those `reached`."""
    if nan_as is None:
        bad = sum(int(layer.size - np.count_nonzero(np.isfinite(layer))) for layer in reached)
        if bad:
            raise VolumeError(
                f"{bad} voxels are NaN or infinite; say what to read them as with nan_as, such as -1024 in HU"
            )
        return values
    if all(np.isfinite(layer).all() for layer in values):
        return values
    require(values.nbytes, "replacing NaN voxels", "choose a region, or replace them in the file", memory_limit)
    whole = np.array(values)
    for layer in whole:
        layer[~np.isfinite(layer)] = nan_as
    return whole


def _label_box(volume: Volume, settings: ReconstructionSettings, window: Box) -> Steps[Box]:
    """The voxels around a label, its sides on the window's grid, so that a surface is the same as in the whole."""
    values = volume.values[box_slices(window)]
    filled: list[int] = []
    rows = np.zeros(values.shape[1], bool)
    columns = np.zeros(values.shape[2], bool)
    for number, layer in enumerate(values):
        if number % 16 == 0:
            yield Step(number / len(values), "Finding the label")
        inside = layer == settings.label
        if inside.any():
            filled.append(number)
            rows |= inside.any(axis=1)
            columns |= inside.any(axis=0)
    if not filled:
        raise LabelError(
            f"label {settings.label} is empty {'in this region' if settings.region else 'here'}; "
            f"{_labels_there(values)}"
        )
    margin = [math.ceil(REACH * settings.soften_mm / side) + 1 for side in volume.spacing]
    found = (np.flatnonzero(columns), np.flatnonzero(rows), np.array(filled))
    box = []
    for axis, (start, stop) in enumerate(window):
        stride = settings.stride[axis]
        low = max(0, int(found[axis][0]) - margin[axis]) // stride * stride
        low = min(low, (stop - start - 1 - stride) // stride * stride)  # a whole voxel before a last, partial one
        high = -(-(int(found[axis][-1]) + margin[axis]) // stride) * stride
        box.append((start + low, min(stop, start + high + 1)))
    return (box[0], box[1], box[2])


def _labels_there(values: NDArray[Any]) -> str:
    labels = sorted({label for layer in values for label in np.unique(layer).tolist()} - {0})
    if not labels:
        return "there are no labels at all: every voxel is 0"
    named = ", ".join(f"{label:g}" for label in labels[:MOST_LABELS])
    return f"the labels are {named}{' and more' if len(labels) > MOST_LABELS else ''}"
