# SPDX-License-Identifier: GPL-3.0-or-later
"""The dose or the uptake inside a structure: mean, maximum, D95, V-dose and SUVpeak.

A volume on another grid is sampled, trilinear, at the centers of the structure's voxels; labels are never resampled.
Each voxel of a structure has the same volume, so shares of voxels are shares of volume.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags, Floats
from ...progress import PAUSE, Stages, Step, Steps
from ..affine import cofactors, determinant, transform_points
from ..labels.extents import label_extent_steps
from ..region import box_of
from ..sampling import sampled_steps
from ..value_kind import ValueKind
from ..volume import Box, Volume

SLAB_VALUES = 1 << 20  # Look at about this many voxels in one go.
COVERED = 95  # D95 is the dose that this percentage of the volume gets at least.
# SUVpeak is the mean in a ball of 1 cm3 (PERCIST 1.0, Wahl et al. 2009); its radius is the cube root of 3 / (4 pi) cm.
BALL_MM = 6.203504908994
BALL_EDGE = 1e-6  # A voxel center this share of the radius beyond the ball belongs to it.
BLOCK = 16  # Voxels along each side of a block of ball centers, which are judged by one bound.

_Part = tuple[slice, slice, slice]


@dataclass(frozen=True)
class SampledValues:
    """Dose or uptake inside a structure; None where no voxel of it lies in the volume.

    Parameters
    ----------
    kind : ValueKind
        Of the values: SUVbw or Gy.
    samples : int
        Voxels with a value.
    beyond : int
        Voxels without one, which lie beyond the volume and do not count.
    mean, deviation, maximum : float or None
    d95 : float or None
        Of a dose: the dose that 95 % of the volume get at least, Gy.
    peak : float or None
        Of a PET: the highest mean in a ball of 1 cm3 around any voxel center of the structure.
    percent_at : mapping of float to (float or None)
        For a dose: percent of the volume that get at least this many Gy.
    """

    kind: ValueKind
    samples: int = 0
    beyond: int = 0
    mean: float | None = None
    deviation: float | None = None
    maximum: float | None = None
    d95: float | None = None
    peak: float | None = None
    percent_at: Mapping[float, float | None] = field(default_factory=dict)


class _Structure(NamedTuple):
    """A structure on a grid: the box that holds it, and which voxels of some slices of that box belong to it."""

    grid: Volume
    box: Box
    mask: Callable[[range, range, range], Flags]


def sampled_inside_label_steps(
    volume: Volume, labels: Volume, label: int, box: Box | None = None, doses: Sequence[float] = ()
) -> Steps[SampledValues]:
    """Return the dose or uptake inside a label.

    Parameters
    ----------
    volume : Volume
        Dose or PET, on any grid.
    labels : Volume
    label : int
    box : ((x, stop), (y, stop), (z, stop)), optional
        Box in the labels; by default the whole volume.
    doses : sequence of float
        Gy, for `percent_at`.

    Examples
    --------
    >>> from ctmc_addon.core.progress import finish
    >>> dose = Volume(np.arange(64, dtype=np.float32).reshape(4, 4, 4), np.eye(4), kind="Gy")
    >>> labels = Volume(np.ones((2, 2, 2), np.uint8), np.diag([2.0, 2.0, 2.0, 1.0]), kind="label")
    >>> inside = finish(sampled_inside_label_steps(dose, labels, 1, doses=[32.0]))
    >>> inside.samples, inside.mean, inside.maximum, inside.percent_at
    (8, 21.0, 42.0, {32.0: 50.0})
    """
    labels = labels.as_labels
    extent = yield from label_extent_steps(labels, label, box or box_of(labels, None, "voxel"))
    if extent is None:
        return SampledValues(volume.kind, percent_at=dict.fromkeys(doses))

    def mask(slab: range, rows: range, columns: range) -> Flags:
        inside = np.zeros((len(slab), len(rows), len(columns)), bool)
        for layer in labels.each_layer:
            inside |= layer.samples(slab, rows, columns) == label
        return inside

    return (yield from _sampled_inside_steps(volume, _Structure(labels, extent.box, mask), doses))


def sampled_inside_range_steps(
    volume: Volume, low: float, high: float | None = None, box: Box | None = None, doses: Sequence[float] = ()
) -> Steps[SampledValues]:
    """Return the dose or uptake of the samples from `low` to `high`, as a threshold and an upper limit take them.

    Parameters
    ----------
    volume : Volume
        Dose or PET.
    low : float
    high : float, optional
        By default there is no upper limit.
    box : ((x, stop), (y, stop), (z, stop)), optional
        By default the whole volume.
    doses : sequence of float
        Gy, for `percent_at`.
    """
    most = math.inf if high is None else high

    def mask(slab: range, rows: range, columns: range) -> Flags:
        values = volume.samples(slab, rows, columns)
        inside: Flags = (values >= low) & (values <= most)
        return inside

    return (
        yield from _sampled_inside_steps(volume, _Structure(volume, box or box_of(volume, None, "voxel"), mask), doses)
    )


def _sampled_inside_steps(volume: Volume, structure: _Structure, doses: Sequence[float]) -> Steps[SampledValues]:
    stages = Stages({"Reading values inside the structure": 2, "Looking for the peak": 3})
    values = yield from stages.run("Reading values inside the structure", _values_steps(volume, structure))
    finite = values[np.isfinite(values)]
    beyond = len(values) - len(finite)
    if not len(finite):
        return SampledValues(volume.kind, 0, beyond, percent_at=dict.fromkeys(doses))
    mean = float(finite.sum(dtype=np.float64)) / len(finite)
    squares = sum(float(np.square(part - mean).sum()) for part in _in_doubles(finite))
    peak = None
    if volume.kind == ValueKind.SUV:
        peak = yield from stages.run("Looking for the peak", _peak_steps(volume, structure))
    is_dose = volume.kind == ValueKind.DOSE
    return SampledValues(
        kind=volume.kind,
        samples=len(finite),
        beyond=beyond,
        mean=mean,
        deviation=math.sqrt(squares / len(finite)),
        maximum=float(finite.max()),
        d95=_got_by(finite, COVERED) if is_dose else None,
        peak=peak,
        percent_at={dose: 100.0 * int((finite >= np.float32(dose)).sum()) / len(finite) for dose in doses},
    )


def _in_doubles(values: Floats) -> Iterator[NDArray[np.float64]]:
    for start in range(0, len(values), SLAB_VALUES):
        yield values[start : start + SLAB_VALUES].astype(np.float64)


def _got_by(values: Floats, percent: int) -> float:
    """Return the value that a percentage of all values reach or exceed, linear between the two around it.

    Examples
    --------
    >>> _got_by(np.arange(101, dtype=np.float32), 95)
    5.0
    """
    position = (100 - percent) * (len(values) - 1) / 100
    below = math.floor(position)
    above = min(below + 1, len(values) - 1)
    parted = np.partition(values, (below, above))
    low, high = float(parted[below]), float(parted[above])
    return low + (position - below) * (high - low)


def _slabs(structure: _Structure) -> Iterator[tuple[range, range, range]]:
    """Yield some slices, and the rows and columns, of the box of a structure."""
    columns, rows, slices = (range(low, stop) for low, stop in structure.box)
    at_once = max(1, SLAB_VALUES // (len(rows) * len(columns)))
    for start in range(slices.start, slices.stop, at_once):
        yield range(start, min(start + at_once, slices.stop)), rows, columns


def _values_steps(volume: Volume, structure: _Structure) -> Steps[Floats]:
    """Return the values at all voxel centers of a structure, NaN beyond the volume."""
    parts = []
    first, stop = structure.box[2]
    for slab, rows, columns in _slabs(structure):
        inside = structure.mask(slab, rows, columns)
        if volume is structure.grid:
            parts.append(volume.samples(slab, rows, columns)[inside].astype(np.float32))
        else:
            index = np.argwhere(inside)[:, ::-1] + (columns.start, rows.start, slab.start)
            centers = transform_points(structure.grid.affine, index)
            parts.append((yield from sampled_steps(volume, centers)))
        yield Step((slab.stop - first) / (stop - first))
    return np.concatenate(parts)


def _ball_rows(affine: NDArray[np.float64]) -> list[tuple[int, int, int, int]]:
    """Return the rows of a ball's voxels around a voxel center: (z, y, first x, last x), from the center.

    Examples
    --------
    >>> rows = _ball_rows(np.diag([4.0, 4.0, 4.0, 1.0]))
    >>> sum(last - first + 1 for _, _, first, last in rows), rows[len(rows) // 2]
    (19, (0, 0, -1, 1))
    """
    x, y, z = (affine[:3, axis] for axis in range(3))
    within = BALL_MM * BALL_MM * (1 + BALL_EDGE)
    rows = []
    reach = _reach(affine)
    for dz in range(-reach[2], reach[2] + 1):
        for dy in range(-reach[1], reach[1] + 1):
            offsets = dz * z + dy * y + np.arange(-reach[0], reach[0] + 1)[:, None] * x
            in_ball = np.flatnonzero((offsets * offsets).sum(axis=1) <= within)
            if len(in_ball):
                rows.append((dz, dy, int(in_ball[0]) - reach[0], int(in_ball[-1]) - reach[0]))
    return rows


def _reach(affine: NDArray[np.float64]) -> tuple[int, int, int]:
    """Return how many voxels a ball reaches along x, y and z from a voxel center."""
    inverse = cofactors(affine).T / determinant(affine)
    x, y, z = (math.floor(BALL_MM * math.sqrt(float((row * row).sum())) * (1 + BALL_EDGE)) for row in inverse)
    return x, y, z


def _peak_steps(volume: Volume, structure: _Structure) -> Steps[float | None]:
    """Return the highest mean in a ball around any voxel center of a structure, over samples that have a value.

    Blocks of centers are looked at from the highest value near them down, until no ball can be higher.
    """
    rows, (reach_x, reach_y, reach_z) = _ball_rows(structure.grid.affine), _reach(structure.grid.affine)
    (x0, x1), (y0, y1), (z0, z1) = structure.box
    best = -math.inf
    thick = max(BLOCK, 2 * reach_z + 1)
    for start in range(z0, z1, thick):
        slab = range(start, min(start + thick, z1))
        inside = structure.mask(slab, range(y0, y1), range(x0, x1))
        around = ((x0 - reach_x, x1 + reach_x), (y0 - reach_y, y1 + reach_y), (start - reach_z, slab.stop + reach_z))
        near = yield from _dense_steps(volume, structure.grid, around)
        finite = np.isfinite(near)
        values = np.where(finite, near, 0.0)
        blocks: list[tuple[float, int, _Part, _Part]] = []
        for z, y, x in _blocks(inside.shape):
            if inside[z, y, x].any():
                window = (_wider(z, reach_z), _wider(y, reach_y), _wider(x, reach_x))
                if finite[window].any():
                    blocks.append((float(near[window][finite[window]].max()), len(blocks), (z, y, x), window))
        for bound, _, block, window in sorted(blocks, key=lambda each: (-each[0], each[1])):
            if bound <= best:
                break
            means = _ball_means(values[window], finite[window], rows, (reach_z, reach_y, reach_x))
            means[~inside[block]] = -math.inf
            best = max(best, float(means.max()))
            yield PAUSE
        yield Step((slab.stop - z0) / (z1 - z0))
    return None if best == -math.inf else best


def _blocks(shape: tuple[int, ...]) -> Iterator[_Part]:
    for z in range(0, shape[0], BLOCK):
        for y in range(0, shape[1], BLOCK):
            for x in range(0, shape[2], BLOCK):
                starts = zip((z, y, x), shape, strict=True)
                block = [slice(start, min(start + BLOCK, size)) for start, size in starts]
                yield block[0], block[1], block[2]


def _wider(part: slice, reach: int) -> slice:
    """Return the samples around a part, in an array that begins `reach` samples earlier."""
    return slice(part.start, part.stop + 2 * reach)


def _ball_means(
    values: NDArray[np.float64], finite: Flags, rows: Sequence[tuple[int, int, int, int]], reach: tuple[int, int, int]
) -> NDArray[np.float64]:
    """Return the mean in the ball around each sample that has `reach` samples on every side; -inf without any."""
    sums, counts = _sums_before(values), _sums_before(finite.astype(np.float64))
    z, y, x = (size - 2 * each for size, each in zip(values.shape, reach, strict=True))
    total, number = np.zeros((z, y, x)), np.zeros((z, y, x))
    for dz, dy, first, last in rows:
        row = (slice(reach[0] + dz, reach[0] + dz + z), slice(reach[1] + dy, reach[1] + dy + y))
        ends = (slice(reach[2] + last + 1, reach[2] + last + 1 + x), slice(reach[2] + first, reach[2] + first + x))
        total += sums[(*row, ends[0])] - sums[(*row, ends[1])]
        number += counts[(*row, ends[0])] - counts[(*row, ends[1])]
    means = np.full(total.shape, -math.inf)
    np.divide(total, number, out=means, where=number > 0)
    return means


def _sums_before(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sums of all samples before each along x, and of all of them."""
    sums = np.zeros((*values.shape[:2], values.shape[2] + 1))
    np.cumsum(values, axis=2, out=sums[:, :, 1:])
    return sums


def _dense_steps(volume: Volume, grid: Volume, box: Box) -> Steps[NDArray[np.float64]]:
    """Return the values at all voxel centers of a box of a grid, which may reach beyond it; NaN beyond the volume."""
    (x0, x1), (y0, y1), (z0, z1) = box
    out = np.full((z1 - z0, y1 - y0, x1 - x0), np.nan)
    if volume is grid:
        inner = [range(max(low, 0), min(stop, size)) for (low, stop), size in zip(box, volume.size, strict=True)]
        x, y, z = inner
        here = [slice(part.start - low, part.stop - low) for part, (low, _) in zip(inner, box, strict=True)]
        out[here[2], here[1], here[0]] = volume.samples(z, y, x)
        yield PAUSE
        return out
    rows, columns = np.mgrid[y0:y1, x0:x1]
    index = np.stack([columns.ravel(), rows.ravel(), np.zeros(rows.size, int)], axis=1)
    for at in range(z1 - z0):
        index[:, 2] = z0 + at
        out[at].flat = yield from sampled_steps(volume, transform_points(grid.affine, index))
    return out
