# SPDX-License-Identifier: GPL-3.0-or-later
"""Sample a volume at points anywhere in the patient, trilinear between the eight samples around each, or along lines.

Positions are RAS+ mm; the volume may be oblique, mirrored and anisotropic. Beyond its outermost samples there is no
value. A volume in memory is sampled in place; of one in a file, some slices are in memory at a time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Doubles, Flags, Floats
from ..machine.budget import Budget
from ..machine.parallel import map_steps, parts_of
from ..progress import Step, Steps, finish
from .affine import cofactors, determinant, transform_points
from .volume import SampleGrid, Volume

POINTS = 1 << 14  # Sample this many points at once; their arrays stay in the processor's cache.
STEP_SAMPLES = 1 << 18  # Samples between two steps.
SLAB_SHARE = 0.25  # Share of the working memory that slices of a file take.
ROUNDING = 2.0**-22  # Positions in float32 may be off by this share of their largest coordinate.
SAME = 1e-6  # A point this share of a voxel before a sample takes its value, as if it was at its position.
KEPT = ("mean", "max", "min")


class Line(NamedTuple):
    """A line from each point, along which a volume is sampled in even steps, both ends included.

    Parameters
    ----------
    directions : (n, 3) float32
        Unit length; the line runs against them.
    length_mm : float
    steps : int
        At least 1.
    keeps : {"mean", "max", "min"}
        What is kept of the samples that lie in the volume.
    """

    directions: Floats
    length_mm: float
    steps: int
    keeps: str


def sampled(volume: Volume, points_ras_mm: NDArray[Any]) -> Floats:
    """Return the values of a volume at points, (n,) float32; NaN beyond its outermost samples.

    Parameters
    ----------
    volume : Volume
    points_ras_mm : (n, 3) float32 or float64

    Examples
    --------
    >>> ramp = Volume(np.arange(8.0).reshape(2, 2, 2), np.diag([1.0, 1.0, 3.0, 1.0]))
    >>> sampled(ramp, np.array([[0.5, 0.0, 0.0], [0.0, 0.0, 1.5], [0.0, 0.0, 3.1]])).tolist()
    [0.5, 2.0, nan]
    """
    return finish(sampled_steps(volume, points_ras_mm))


def sampled_steps(
    volume: Volume, points_ras_mm: NDArray[Any], line: Line | None = None, budget: Budget | None = None
) -> Steps[Floats]:
    """Return the values of a volume at points, or what is kept of those along a line from each, (n,) float32.

    A value is NaN where a sample that it needs is NaN; along a line such values do not count.

    Parameters
    ----------
    volume : Volume
    points_ras_mm : (n, 3) float32 or float64
    line : Line, optional
    budget : Budget, optional
        Its threads, which change no result, and the memory for slices of a file; by default one thread.
    """
    budget = budget or Budget(threads=1)
    sampler = _Sampler(volume, points_ras_mm, line)
    parts = parts_of(len(points_ras_mm), POINTS)
    if not parts:
        return sampler.result()
    values = _in_place(volume)
    if values is not None:
        yield from _take_steps(sampler, _Slab(values), parts, budget, 0.0, 1.0)
        return sampler.result()
    boxes = yield from map_steps(sampler.box_of, parts, budget.thread_count, batches=_batches(parts, 1))
    columns, rows, slices = _covered(np.array(boxes))
    layer_bytes = max(1, len(rows) * len(columns) * volume.dtype.itemsize)
    layers = max(2, int(SLAB_SHARE * budget.work_bytes) // layer_bytes)
    last: NDArray[Any] | None = None  # The last layer of the slab before, as a packed file cannot go back.
    for first in range(slices.start, slices.stop - 1, layers - 1):
        slab = range(first, min(first + layers, slices.stop))
        done, then = ((each - slices.start) / len(slices) for each in (slab.start, slab.stop))
        read = yield from _read_steps(volume, slab, rows, columns, last, done)
        window = _Slab(read, (columns.start, rows.start, slab.start), last=slab.stop == slices.stop)
        last = read[-1:].copy()
        crossing = [
            part for part, box in zip(parts, boxes, strict=True) if box[0][2] < slab.stop and box[1][2] >= first
        ]
        yield from _take_steps(sampler, window, crossing, budget, done, then)
    return sampler.result()


def _batches(parts: Sequence[slice], steps: int) -> int:
    """Return the number of batches in which parts are sampled, each along `steps` steps of a line."""
    return min(len(parts), max(1, len(parts) * POINTS * steps // STEP_SAMPLES))


def _take_steps(
    sampler: _Sampler, slab: _Slab, parts: Sequence[slice], budget: Budget, low: float, high: float
) -> Steps[None]:
    taking = map_steps(
        lambda part: sampler.take(slab, part), parts, budget.thread_count, batches=_batches(parts, sampler.count)
    )
    for step in taking:
        yield Step(low + (high - low) * step.fraction, "Sampling values")


def _in_place(volume: Volume) -> NDArray[Any] | None:
    """Return all values if they are in memory one after the other, so that none needs to be copied."""
    if volume.reader.own_bytes:
        return None
    values = volume.values
    is_view = values.base is not None and np.shares_memory(values, volume.slab(0, 1))
    return values if is_view and values.flags.c_contiguous else None


def _read_steps(
    volume: Volume, slab: range, rows: range, columns: range, last: NDArray[Any] | None, done: float
) -> Steps[NDArray[Any]]:
    """Return the values of some slices, of which the first may be there from the slab before."""
    out = np.empty((len(slab), len(rows), len(columns)), volume.dtype)
    start = 0
    if last is not None:
        out[:1], start = last, 1
    at_once = volume.reader.at_once
    for at in range(start, len(slab), at_once):
        yield Step(done, "Reading slices")
        part = slice(at, min(at + at_once, len(slab)))
        out[part] = volume.samples(slab[part], rows, columns)
    return out


def _covered(boxes: NDArray[np.int64]) -> tuple[range, range, range]:
    """Return the columns, rows and slices that boxes (n, 2, 3) touch together; none if all are empty."""
    there = (boxes[:, 0] <= boxes[:, 1]).all(axis=1)
    if not there.any():
        return range(0), range(0), range(0)
    low, high = boxes[there, 0].min(axis=0).tolist(), boxes[there, 1].max(axis=0).tolist()
    x, y, z = (range(first, last + 1) for first, last in zip(low, high, strict=True))
    return x, y, z


class _Slab:
    """Values (slices, rows, columns) in C order, and the index (x, y, z) of the first.

    `last` says whether cells of its last layer belong to it, and not to the next slab.
    """

    def __init__(self, values: NDArray[Any], first: tuple[int, int, int] = (0, 0, 0), last: bool = True) -> None:
        self.first = first
        slices, self.rows, self.columns = values.shape
        self.low, self.high = first[2], first[2] + slices - 1
        self.whole = last and first == (0, 0, 0)
        flat = values.reshape(-1)
        row, layer = self.columns, self.columns * self.rows
        offsets = [x + y + z for z in (0, layer) for y in (0, row) for x in (0, 1)]
        self.corners = [flat[offset:] for offset in offsets]  # each begins at another corner of the first cell

    def at(self, low: Sequence[Doubles], share: Sequence[Floats]) -> Floats:
        """Return the values in cells whose lowest corner is at index `low`, at a share of each side."""
        x, y, z = (each - start for each, start in zip(low, self.first, strict=True))
        cell = ((z * self.rows + y) * self.columns + x).astype(np.intp)
        corners = [values.take(cell).astype(np.float32, copy=False) for values in self.corners]
        with np.errstate(invalid="ignore", over="ignore"):
            result = _mixed(corners, share)
        unknown = np.flatnonzero(~np.isfinite(result))
        if len(unknown):  # A corner whose share is 0 does not count, even if it is NaN.
            few = [corner[unknown] for corner in corners]
            with np.errstate(invalid="ignore", over="ignore"):
                result[unknown] = _mixed(few, [each[unknown] for each in share], counts_all=False)
        return result


def _mixed(corners: Sequence[Floats], share: Sequence[Floats], counts_all: bool = True) -> Floats:
    """Return the trilinear mean of eight corners, x fastest, as `a + share * (b - a)` along each axis in turn."""
    mixed = list(corners)
    for part in share:
        is_high = part == 1
        ends = is_high if is_high.any() else None
        pairs = zip(mixed[::2], mixed[1::2], strict=True)
        mixed = [_between(low, high, part, ends, counts_all) for low, high in pairs]
    return mixed[0]


def _between(low: Floats, high: Floats, share: Floats, is_high: Flags | None, counts_all: bool) -> Floats:
    """Return the mean of two corners, which at a corner is its own value, bit for bit."""
    if not counts_all:
        mean = low + share * (high - low)
        return np.where(share == 0, low, np.where(share == 1, high, mean))
    mean = high - low
    mean *= share
    mean += low
    if is_high is not None:
        np.copyto(mean, high, where=is_high)
    return mean


class _Sampler:
    """Samples points, or lines from them, part by part and slab by slab; parts may be taken side by side."""

    def __init__(self, grid: SampleGrid, points: NDArray[Any], line: Line | None) -> None:
        self.points, self.line = points, line
        self.count = 1 if line is None else line.steps + 1
        self.inverse = cofactors(grid.affine).T / determinant(grid.affine)
        self.origin = grid.affine[:3, 3]
        self.last = [size - 1 for size in grid.size]
        corners = np.array([[x, y, z] for z in (0, self.last[2]) for y in (0, self.last[1]) for x in (0, self.last[0])])
        reach = np.abs(transform_points(grid.affine, corners)).max(axis=0)
        # A point on the outermost samples counts, although float32 may have put it beyond them.
        self.edge = [ROUNDING * float((np.abs(row) * reach).sum()) for row in self.inverse]
        self.kept = np.full(len(points), np.nan, np.float32)
        mean = line is not None and line.keeps == "mean"
        self.sums = np.zeros(len(points) if mean else 0)
        self.numbers = np.zeros(len(points) if mean else 0, np.int32)

    def _ends(self, part: slice) -> tuple[list[Doubles], list[Doubles]]:
        """Return the index (x, y, z) of points, and by how much it grows along their lines, if they have them."""
        starts = self._turned([self.points[part, axis].astype(np.float64) - self.origin[axis] for axis in range(3)])
        if self.line is None:
            return starts, []
        length = -self.line.length_mm
        directions = [self.line.directions[part, axis].astype(np.float64) * length for axis in range(3)]
        return starts, self._turned(directions)

    def _turned(self, along: Sequence[Doubles]) -> list[Doubles]:
        x, y, z = along
        with np.errstate(invalid="ignore"):  # of vertices at infinity
            return [(x * row[0] + y * row[1]) + z * row[2] for row in self.inverse]

    def box_of(self, part: slice) -> tuple[list[int], list[int]]:
        """Return the first and last index (x, y, z) of samples that a part needs; the last is lower if none."""
        starts, along = self._ends(part)
        low, high = [], []
        for axis, start in enumerate(starts):
            ends = [start, start + along[axis]] if along else [start]
            finite = [end[np.isfinite(end)] for end in ends]
            first = min((float(end.min()) for end in finite if len(end)), default=np.inf)
            final = max((float(end.max()) for end in finite if len(end)), default=-np.inf)
            if first > self.last[axis] + self.edge[axis] or final < -self.edge[axis]:
                return [0, 0, 0], [-1, -1, -1]
            cell = self.last[axis] - 1
            low.append(int(min(max(np.floor(first - self.edge[axis]), 0), cell)))
            high.append(int(min(max(np.floor(final + self.edge[axis]), 0), cell)) + 1)
        return low, high

    def take(self, slab: _Slab, part: slice) -> None:
        """Sample the points of a part, or along their lines, as far as they lie in the slab."""
        starts, along = self._ends(part)
        kept = self.kept[part]
        for here in self._along(starts, along):
            in_slab, low, share = self._cells(slab, here)
            if in_slab is not None and not len(in_slab):
                continue
            values = slab.at(low, share)
            if not along:
                kept[slice(None) if in_slab is None else in_slab] = values
            else:
                self._keep(part, slice(None) if in_slab is None else in_slab, values)

    def _along(self, starts: list[Doubles], along: list[Doubles]) -> Iterator[list[Doubles]]:
        if not along:
            yield starts
            return
        for number in range(self.count):
            share = number / (self.count - 1)
            with np.errstate(invalid="ignore"):
                here = [start + step * share for start, step in zip(starts, along, strict=True)]
            yield here

    def _cells(
        self, slab: _Slab, here: Sequence[Doubles]
    ) -> tuple[NDArray[np.intp] | None, list[Doubles], list[Floats]]:
        """Return which points lie in the slab (None for all), the low corners of their cells, shares of sides."""
        inside: Flags | None = None
        lows = []
        for axis, at in enumerate(here):
            within = (at >= -self.edge[axis]) & (at <= self.last[axis] + self.edge[axis])  # nor NaN
            low = np.clip(np.floor(at + SAME), 0.0, self.last[axis] - 1.0)
            if axis == 2 and not slab.whole:
                within &= (low >= slab.low) & (low < slab.high)
            inside = within if inside is None else inside & within
            lows.append(low)
        assert inside is not None, "there are three axes"
        in_slab = None
        if not inside.all():
            in_slab = np.flatnonzero(inside)
            lows, here = [low[in_slab] for low in lows], [at[in_slab] for at in here]
        shares = [np.clip(at - low, 0.0, 1.0).astype(np.float32) for at, low in zip(here, lows, strict=True)]
        return in_slab, lows, shares

    def _keep(self, part: slice, selected: slice | NDArray[np.intp], values: Floats) -> None:
        assert self.line is not None, "points alone are kept as they are"
        if self.line.keeps == "mean":
            finite = ~np.isnan(values)
            self.sums[part][selected] += np.where(finite, values, 0.0)
            self.numbers[part][selected] += finite
        else:
            choose = np.fmax if self.line.keeps == "max" else np.fmin
            kept = self.kept[part]
            kept[selected] = choose(kept[selected], values)

    def result(self) -> Floats:
        """Return the value of every point, (n,) float32."""
        if len(self.numbers):
            has_values = self.numbers > 0
            self.kept[has_values] = (self.sums[has_values] / self.numbers[has_values]).astype(np.float32)
        return self.kept
