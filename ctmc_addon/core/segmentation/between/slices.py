# SPDX-License-Identifier: GPL-3.0-or-later
"""The slices between those that were drawn: the smoothest body through them.

Each drawn slice becomes its signed distance in mm (Raya and Udupa 1990, doi:10.1109/42.52980). Between drawn slices the
distances are interpolated by cubics that do not overshoot (Fritsch and Butland 1984, doi:10.1137/0905021). What is near
the surface is then smoothed as `smoothing` smooths a label, towards least curvature in all three directions and
within bounds: a drawn sample keeps its side, and so does what lies between two drawn slices that agree; elsewhere the
field is free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags
from ...errors import SettingsError
from ...machine.budget import Budget
from ...machine.parallel import threads_of
from ...progress import PAUSE, Stages, Step, Steps
from ...smoothing.bounds import NEAREST_ZERO, Start
from ...smoothing.bricks import WIDTH, Bricks, near_surface, number_bricks, packed
from ...smoothing.relaxation import relax_steps
from ..distance import Floats, Spacing, squared_distances

NARROW_PIXELS = 3  # Smooth this many pixels to either side of the surface.
ROUNDS = 24  # Smooth for this many rounds.
STAGES = {"Measuring distances": 3, "Filling slices": 2, "Smoothing": 5}


def between_slices_steps(
    mask: Flags, spacing_mm: Spacing, drawn: Sequence[int] | None = None, axis: int = 0, budget: Budget | None = None
) -> Steps[Flags]:
    """Fill the slices between those that were drawn.

    Parameters
    ----------
    mask : (slices, rows, columns) bool
    spacing_mm : (x, y, z) float
    drawn : sequence of int, optional
        Numbers of the slices that count as drawn, an empty one among them as empty; by default those with a sample.
        Their distances may differ.
    axis : int
        The array's axis that slices are counted along: 0 slices, 1 rows, 2 columns.
    budget : Budget, optional
        Its threads are used.

    Returns
    -------
    (slices, rows, columns) bool
        The mask where it was drawn, what lies between two drawn slices, and nothing beyond the first and the last.
        Between an empty and a drawn slice the structure ends before halfway.

    Raises
    ------
    SettingsError
        If fewer than two slices are drawn, or a number is not that of a slice.
    """
    layers = np.moveaxis(mask, axis, 0)
    sides = [spacing_mm[2 - across] for across in range(3) if across != axis]  # of a layer's rows and columns
    if drawn is None:
        drawn = np.flatnonzero(layers.any(axis=(1, 2))).tolist()
    numbers = np.array(sorted(set(drawn)), np.intp)
    if len(numbers) < 2:
        raise SettingsError(f"filling between slices needs two or more drawn slices, not {len(numbers)}; draw another")
    if numbers[0] < 0 or numbers[-1] >= len(layers):
        raise SettingsError(
            f"slice {numbers[-1] if numbers[0] >= 0 else numbers[0]} is not one of 0 to {len(layers) - 1}"
        )
    measuring, filling, smoothing = STAGES
    stages = Stages(STAGES)
    first, columns = int(numbers[0]), layers.shape[2]
    wide = np.pad(layers[numbers], ((0, 0), (0, 0), (0, -columns % WIDTH)), mode="edge")  # to whole bricks
    distances = yield from stages.run(measuring, _distances_steps(wide, numbers - first, sides))
    body = yield from stages.run(filling, _filled_steps(distances))
    voxel_mm = (sides[1], sides[0], spacing_mm[2 - axis])
    yield from stages.run(smoothing, _smoothed_steps(body, distances, voxel_mm, budget or Budget()))
    filled = np.zeros(mask.shape, bool)
    np.moveaxis(filled, axis, 0)[first : first + len(body)] = body[:, :, :columns]
    return filled


def drawn_axis(mask: Flags) -> int:
    """Find the axis across the planes that were drawn in: along it slices are left out, and the drawn ones lie singly.

    Two parts of a structure that lie apart in a plane leave slices out along that plane too, but in longer runs.

    Parameters
    ----------
    mask : (slices, rows, columns) bool

    Raises
    ------
    SettingsError
        If slices lie apart along no axis and are more than one along each.

    Examples
    --------
    >>> mask = np.zeros((9, 5, 5), bool)
    >>> mask[[2, 6], 1:4] = True
    >>> drawn_axis(mask)
    0
    """
    drawn = [np.flatnonzero(np.moveaxis(mask, axis, 0).any(axis=(1, 2))) for axis in range(3)]
    gaps = [int((np.diff(numbers) > 1).sum()) for numbers in drawn]
    left_out = [axis for axis in range(3) if gaps[axis]]
    if left_out:
        return min(left_out, key=lambda axis: len(drawn[axis]) / (gaps[axis] + 1))
    in_one = [axis for axis in range(3) if len(drawn[axis]) < 2]
    if not in_one:
        raise SettingsError("there is no slice to fill between the drawn ones; draw on slices farther apart")
    return in_one[0]


@dataclass(frozen=True, eq=False)
class Distances:
    """Signed distances of the drawn slices, and how they change from slice to slice.

    Parameters
    ----------
    numbers : (drawn,) intp
        Numbers of the drawn slices, from 0.
    values : (drawn, rows, columns) float32
        Millimeters, positive inside.
    slopes : (drawn, rows, columns) float32
        Millimeters a slice.
    """

    numbers: NDArray[np.intp]
    values: Floats
    slopes: Floats

    def between(self, number: int) -> tuple[int, int]:
        """Return which drawn slices are the nearest below and above; the same one twice where this is drawn."""
        below = int(np.searchsorted(self.numbers, number, side="right")) - 1
        return below, below + int(self.numbers[below] != number)

    def at(self, number: int) -> Floats:
        """Return the distances of any slice, (rows, columns), by Hermite's cubic."""
        below, above = self.between(number)
        if below == above:
            return self.values[below]
        gap = int(self.numbers[above] - self.numbers[below])
        share = (number - int(self.numbers[below])) / gap
        rest = 1 - share
        layer: Floats = self.values[below] * np.float32(rest * rest * (1 + 2 * share))
        layer += self.values[above] * np.float32(share * share * (1 + 2 * rest))
        layer += self.slopes[below] * np.float32(gap * share * rest * rest)
        layer -= self.slopes[above] * np.float32(gap * share * share * rest)
        return layer


def _distances_steps(drawn: Flags, numbers: NDArray[np.intp], sides_mm: Sequence[float]) -> Steps[Distances]:
    """Measure the drawn slices; a slope is the harmonic mean of those to either side, 0 where they differ in sign."""
    values = np.empty(drawn.shape, np.float32)
    for at, layer in enumerate(drawn):
        values[at] = _signed_mm(layer, sides_mm)
        yield Step((at + 1) / len(drawn))
    slopes = np.zeros(drawn.shape, np.float32)
    before = None
    for at, gap in enumerate(np.diff(numbers)):
        behind = (values[at + 1] - values[at]) / np.float32(gap)
        if before is None:
            slopes[at] = behind
        else:
            product, total = before * behind, before + behind
            np.divide(2 * product, total, out=slopes[at], where=product > 0)
        before = slopes[-1] = behind
    return Distances(numbers, values, slopes)


def _filled_steps(distances: Distances) -> Steps[Flags]:
    """Return the interpolated body, (slices, rows, columns) from the first drawn slice to the last."""
    count = int(distances.numbers[-1]) + 1
    body = np.empty((count, *distances.values.shape[1:]), bool)
    for number in range(count):
        np.greater(distances.at(number), 0, out=body[number])
        yield Step((number + 1) / count)
    return body


def _smoothed_steps(body: Flags, distances: Distances, voxel_mm: Spacing, budget: Budget) -> Steps[None]:
    """Smooth the interpolated body in place; `voxel_mm` is along columns, rows and slices."""
    code = packed(body)
    bricks = number_bricks(near_surface(code, (NARROW_PIXELS,) * 3), code != 0)
    start = yield from _start_steps(bricks, distances, voxel_mm)
    with threads_of(budget.thread_count) as pool:
        yield from relax_steps(bricks, start.field, start.low, start.high, voxel_mm, ROUNDS, pool)
    body.reshape(-1, WIDTH)[bricks.place[: bricks.active]] = start.field[: bricks.active] > 0


def _start_steps(bricks: Bricks, distances: Distances, voxel_mm: Spacing) -> Steps[Start]:
    """Return the interpolated distances over the bricks, and the bounds that drawn slices set."""
    field, low, high = (np.zeros((len(bricks), WIDTH), np.float32) for _ in range(3))
    least, infinite = np.float32(NEAREST_ZERO * min(voxel_mm)), np.float32(np.inf)
    count, layer = bricks.shape[0], bricks.shape[1] * bricks.shape[2]
    for number in range(count):
        values = distances.at(number).reshape(-1, WIDTH)
        below, above = (distances.values[at].reshape(-1, WIDTH) for at in distances.between(number))
        for first, stop in ((0, bricks.active), (bricks.active, len(bricks.place))):  # each in the grid's order
            bounds = np.searchsorted(bricks.place[first:stop], (number * layer, (number + 1) * layer))
            part = slice(first + int(bounds[0]), first + int(bounds[1]))
            place = bricks.place[part] - number * layer
            under, over = below.take(place, axis=0), above.take(place, axis=0)
            field[part] = values.take(place, axis=0)
            low[part] = np.where((under > 0) & (over > 0), least, -infinite)
            high[part] = np.where((under < 0) & (over < 0), -least, infinite)
        yield PAUSE
    return Start(field, low, high)


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
