# SPDX-License-Identifier: GPL-3.0-or-later
"""The gray values of a CT inside a label or a range of values: how many samples, their mean and their deviation."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import LabelError
from ...progress import Step, Steps
from ..affine import farthest_corner_mm, product
from ..labels.extents import label_extent_steps
from ..labels.label_sources import moved_box, samples_on_grid, turned_values
from ..region import box_of
from ..volume import Box, Volume

SLAB_SLICES = 16  # Look at this many slices in one go.
SAME_PLACE = 1e-2  # The corners of two volumes may differ by this many voxels.


class InsideValues(NamedTuple):
    """The values of the samples that have a label.

    Parameters
    ----------
    samples : int
    mean : float
    deviation : float
        Standard deviation over the samples.
    """

    samples: int
    mean: float
    deviation: float


def inside_values_steps(ct: Volume, labels: Volume, label: int, box: Box | None = None) -> Steps[InsideValues | None]:
    """Return the values of a CT at the samples of a label; None where the label is empty.

    Parameters
    ----------
    ct : Volume
        Values that are not finite do not count.
    labels : Volume
        Their samples are samples of the CT, in any order and direction of the axes, of all of it or of a part.
    label : int
    box : ((x, stop), (y, stop), (z, stop)), optional
        Box in the labels; by default the whole volume.

    Raises
    ------
    VolumeError
        If the labels' samples are not samples of the CT.
    LabelError
        If the label lies outside the CT.

    Examples
    --------
    >>> from ctmc_addon.core.progress import finish
    >>> values = np.arange(8, dtype=np.int16).reshape(2, 2, 2)
    >>> labels = Volume((values > 5).astype(np.uint8), np.eye(4), kind="label")
    >>> finish(inside_values_steps(Volume(values, np.eye(4)), labels, 1))
    InsideValues(samples=2, mean=6.5, deviation=0.5)
    """
    labels = labels.as_labels
    axes, shift = samples_on_grid(labels, ct)
    extent = yield from label_extent_steps(labels, label, box or box_of(labels, None, "voxel"))
    if extent is None:
        return None
    on_ct = moved_box(extent.box, axes, shift)
    if any(low < 0 or stop > size for (low, stop), size in zip(on_ct, ct.size, strict=True)):
        raise LabelError(
            f"label {label} of {labels.name} extends beyond {ct.name}; give the CT that it was drawn "
            "on, or a region inside it"
        )

    def selected_values(slab: range, rows: range, columns: range) -> NDArray[Any]:
        part = (columns.start, columns.stop), (rows.start, rows.stop), (slab.start, slab.stop)
        of_labels = moved_box(part, axes.T, -product(shift[None], axes)[0])
        x, y, z = (range(low, stop) for low, stop in of_labels)
        mask = np.zeros((len(slab), len(rows), len(columns)), bool)
        for layer in labels.each_layer:
            mask |= turned_values(layer.samples(z, y, x) == label, axes)
        return ct.samples(slab, rows, columns)[mask]

    return (yield from _summed_steps(selected_values, on_ct, "Reading values inside the label"))


def range_values_steps(
    ct: Volume, low: float, high: float | None = None, box: Box | None = None
) -> Steps[InsideValues | None]:
    """Return the values of a CT from `low` to `high`, as a threshold and an upper limit take them; None without any.

    Parameters
    ----------
    ct : Volume
    low : float
    high : float, optional
        By default there is no upper limit.
    box : ((x, stop), (y, stop), (z, stop)), optional
        By default the whole volume.
    """

    def selected_values(slab: range, rows: range, columns: range) -> NDArray[Any]:
        values = ct.samples(slab, rows, columns)
        return values[(values >= low) & (values <= (math.inf if high is None else high))]

    return (yield from _summed_steps(selected_values, box or box_of(ct, None, "voxel"), "Reading the values inside"))


def _summed_steps(
    selected_values: Callable[[range, range, range], NDArray[Any]], box: Box, message: str
) -> Steps[InsideValues | None]:
    """Return number, mean and deviation of the values that are chosen in a box; None without any."""
    columns, rows, slices = (range(low, high) for low, high in box)
    count, mean, squares = 0, 0.0, 0.0
    for start in range(slices.start, slices.stop, SLAB_SLICES):
        slab = range(start, min(start + SLAB_SLICES, slices.stop))
        values = selected_values(slab, rows, columns).astype(np.float64)
        values = values[np.isfinite(values)]
        if len(values):
            # Means and squares of two sets are put together without a difference of large sums.
            own = float(values.sum()) / len(values)
            more = float(np.square(values - own).sum())
            squares += more + (own - mean) ** 2 * count * len(values) / (count + len(values))
            mean += (own - mean) * len(values) / (count + len(values))
            count += len(values)
        yield Step((slab.stop - slices.start) / len(slices), message)
    return InsideValues(count, mean, math.sqrt(squares / count)) if count else None


def lie_in_one_place(ct: Volume, labels: Volume) -> bool:
    """Return whether a CT and labels have the same samples."""
    most_mm = SAME_PLACE * min(ct.spacing)
    return ct.size == labels.size and farthest_corner_mm(ct.affine, labels.affine, ct.size) <= most_mm
