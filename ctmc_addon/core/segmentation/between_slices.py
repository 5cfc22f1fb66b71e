# SPDX-License-Identifier: GPL-3.0-or-later
"""The slices between those that were drawn: shape-based interpolation.

Each drawn slice becomes its signed distance in mm, and between two drawn slices the distances are interpolated
linearly (Raya and Udupa 1990, doi:10.1109/42.52980). Drawn slices stay as they are. This keeps every drawn sample; it
is not the smoothest body through them, as the constrained field of `volume.smoothing` is on slices that are all drawn:
its outline bends at a drawn slice. A surface made of the result by `smoothing="constrained"` smooths that.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..errors import SettingsError
from ..progress import Step, Steps
from .distance import Mask, Spacing, squared_distances


def between_slices_steps(
    mask: Mask, spacing_mm: Spacing, drawn: Sequence[int] | None = None, axis: int = 0
) -> Steps[Mask]:
    """Fill the slices between those that were drawn.

    Parameters
    ----------
    mask : (slices, rows, columns) bool
    spacing_mm : (x, y, z) float
    drawn : sequence of int, optional
        Numbers of the slices that count as drawn, an empty one among them as empty; by default those with a sample.
    axis : int
        The array's axis that slices are counted along: 0 slices, 1 rows, 2 columns.

    Returns
    -------
    (slices, rows, columns) bool
        The mask where it was drawn, what lies between two drawn slices, and nothing beyond the first and the last.
        Between an empty and a drawn slice the structure ends halfway.

    Raises
    ------
    SettingsError
        If fewer than two slices are drawn, or a number is not that of a slice.
    """
    layers = np.moveaxis(mask, axis, 0)
    sides = [spacing_mm[2 - other] for other in range(3) if other != axis]  # of a layer's rows and columns
    if drawn is None:
        drawn = np.flatnonzero(layers.any(axis=(1, 2))).tolist()
    numbers = sorted(set(drawn))
    if len(numbers) < 2:
        raise SettingsError(f"{len(numbers)} slice is drawn, and between slices needs two or more; draw another")
    if numbers[0] < 0 or numbers[-1] >= len(layers):
        raise SettingsError(f"slice {numbers[-1] if numbers[0] >= 0 else numbers[0]} is none of 0 to {len(layers) - 1}")
    filled = np.zeros(mask.shape, bool)
    target = np.moveaxis(filled, axis, 0)
    before = _signed_mm(layers[numbers[0]], sides)
    target[numbers[0]] = layers[numbers[0]]
    for low, high in pairwise(numbers):
        behind = _signed_mm(layers[high], sides)
        for number in range(low + 1, high):
            share = np.float32((number - low) / (high - low))
            np.greater(before * (1 - share) + behind * share, 0, out=target[number])
        target[high] = layers[high]
        before = behind
        yield Step((high - numbers[0]) / (numbers[-1] - numbers[0]), "Filling slices")
    return filled


def _signed_mm(layer: NDArray[np.bool_], sides_mm: Sequence[float]) -> NDArray[np.float32]:
    """Return the signed distance of a slice, (rows, columns), half a sample nearer than between centers; + inside.

    Where the slice is empty, the distance is that of the farthest two samples; full, the same with a plus.
    """
    rows_mm, columns_mm = sides_mm
    spacing = (columns_mm, rows_mm, 1.0)
    farthest = np.float32(np.hypot(layer.shape[0] * rows_mm, layer.shape[1] * columns_mm))
    signed = np.empty(layer.shape, np.float32)
    half = np.float32(min(rows_mm, columns_mm) / 2)
    for side, sign in ((layer, np.float32(1)), (~layer, np.float32(-1))):
        distance = np.sqrt(squared_distances(~side[None], spacing)[0])
        np.copyto(signed, sign * (np.minimum(distance, farthest) - half), where=side)
    return signed
