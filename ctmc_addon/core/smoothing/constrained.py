# SPDX-License-Identifier: GPL-3.0-or-later
"""From a label to the smoothest scalar field that agrees with it, in millimeters.

The label's grid is refined between slices where they are far apart; the label's own slices are every
`slice_steps`-th of the result. Inside is `value >= 0`. The same bytes for any number of threads and every NumPy:
only single operations on elements, in an order that does not depend on either.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Floats
from ..errors import LabelError, SettingsError
from ..machine.budget import Budget
from ..machine.parallel import Threads, parts_of, threads_of
from ..progress import PAUSE, Stages, Steps, equal_part
from ..volume.volume import Box
from .bounds import Inside, Start, carried, halfway_mm, refined_start
from .bricks import WIDTH, Bricks, near_surface, number_bricks, packed, widened
from .kept_volume.islands import keep_islands_steps
from .kept_volume.refined_label import RefinedLabel
from .kept_volume.volume_constant import keep_volume_steps
from .relaxation import relax_steps
from .signed_distance import signed_distance_steps
from .smooth_field import SmoothField

MOST_STEPS = 8
SAMPLES_AT_ONCE = 1 << 18  # Handle this many samples far from the surface at once.
BYTES_A_BRICK = 300
BYTES_A_VERTEX = 150  # A surface whose volume is measured takes this many bytes for each vertex, with its triangles.
STAGES = {"Finding the surface": 5, "Smoothing": 65, "Keeping islands": 3, "Keeping the volume": 27}
WORKING_BYTES = 1 << 23
REMEDY = "choose a region, fewer slice_steps or smoothing none"  # The remedy if memory is too small.


class _SmoothingGrid(NamedTuple):
    """A grid on which a field is smoothed.

    Parameters
    ----------
    every_xy : int
        Keeps every n-th pixel along x and y.
    between : bool
        Whether it has the steps between slices; else the slices alone.
    band : (pixels, gaps)
        The field is smoothed up to the larger of both distances from zero.
    rounds : int
    inertia : float
        Inertia of the momentum at the beginning: more if the field is nearly smooth already.
    """

    every_xy: int
    between: bool
    band: tuple[float, float]
    rounds: int
    inertia: float

    def band_mm(self, spacing_mm: tuple[float, float, float]) -> float:
        """Return the distance to either side of the surface within which the field is smoothed."""
        return max(self.band[0] * max(spacing_mm[:2]), self.band[1] * spacing_mm[2])


BEYOND = 1.5  # Distances are capped at this many bands or more.
FAR, NEAR = (5.0, 1.6), (2.5, 0.0)
# Farther than that from the surface the field of every other pixel is smooth enough. Distances are smooth but for
# steps, hence the momentum. With three or more steps a slice, folds between slices need many rounds. So such fields
# are smoothed at the slices alone first.
THIN = (_SmoothingGrid(2, True, FAR, 26, 4.5), _SmoothingGrid(1, True, NEAR, 18, 8.0))
THICK = (
    _SmoothingGrid(2, False, FAR, 41, 4.5),
    _SmoothingGrid(2, True, FAR, 12, 4.5),
    _SmoothingGrid(1, True, NEAR, 18, 8.0),
)


def grids_of(slice_steps: int) -> tuple[_SmoothingGrid, ...]:
    """Return the grids on which a field with `slice_steps` steps per slice is smoothed, the coarsest first."""
    return THICK if slice_steps > 2 else THIN


def automatic_refinement(spacing_mm: tuple[float, float, float]) -> int:
    """Steps between slices so that no side of a voxel is more than twice another.

    Examples
    --------
    >>> [automatic_refinement((0.75, 0.75, gap)) for gap in (1.0, 1.6, 5.0)]
    [1, 2, 4]
    """
    steps = math.ceil(spacing_mm[2] / (2 * min(spacing_mm[:2])) - 1e-6)
    return max(1, min(MOST_STEPS, steps))


def _band_mm(spacing_mm: tuple[float, float, float]) -> float:
    """Return the distance to either side of the surface within which the field is smoothed."""
    return THICK[0].band_mm(spacing_mm)


def reach_of(spacing_mm: tuple[float, float, float]) -> tuple[int, int, int]:
    """Return `_band_mm` in samples of the label along x, y and z; 8 at most along x."""
    x, y, z = (_band_mm(spacing_mm) / side for side in spacing_mm)
    return min(WIDTH, math.ceil(x)), math.ceil(y), max(1, round(z))


def constrained_steps(
    mask: NDArray[np.bool_],
    spacing_mm: tuple[float, float, float],
    slice_steps: int = 0,
    close_border: bool = False,
    budget: Budget | None = None,
    window: Box | None = None,
) -> Steps[SmoothField]:
    """The smoothest field whose sign is the label's at every sample, its volume kept.

    Constants are added in this order, each within the bounds that keep the sign of every sample:

    1. to each component of at most `islands.LARGEST_ISLAND` voxels the one at which it alone has its samples' volume;
       where one component has more than half of the samples, those of the others are final from here on;
    2. to what is not final, `constant_mm`, at which the whole encloses the samples' volume within 0.02 %.

    `values` has the sum of all. A constant that is added to `values` afterwards, to keep volumes where labels touch,
    comes third: it moves bodies and islands alike, and the volume of an island by a larger share. It may not turn the
    sign at a sample of the label, so what crosses zero there goes back to `bounds.NEAREST_ZERO` of the shortest side.

    Parameters
    ----------
    mask : (slices, rows, columns) bool
        The label, with at least one sample of margin where the volume goes on; at least two slices. Where the label
        reaches the border of the mask, the surface is cut there.
    spacing_mm : (x, y, z) float
        For an oblique or sheared affine the lengths of its columns.
    slice_steps : int
        Steps from slice to slice; 0 takes as many as `automatic_refinement`.
    close_border : bool
        Whether the surface is to be closed at the border. Where the label reaches the first or the last slice, slices
        are added, so that Marching Cubes with a closed border closes it half a slice gap outside.
    budget : Budget, optional
        Its bytes are those that all of it may take.
    window : Box, optional
        The part of the refined values whose surface is wanted, which was measured last; the whole surface lies in it.

    Raises
    ------
    LabelError
        If no sample, or every sample, is inside.
    MemoryLimitError
        If it would take more than the limit.
    SettingsError
        If the steps are not from 0 to 8.
    """
    if not 0 <= slice_steps <= MOST_STEPS:
        raise SettingsError(f"slice_steps must be from 0 (chosen by the slice gap) to {MOST_STEPS}, not {slice_steps}")
    if not mask.any():
        raise LabelError("the label has no sample here; choose another label or region")
    if mask.all():
        raise LabelError("every sample here is the label; choose a region that reaches beyond it")
    steps = slice_steps or automatic_refinement(spacing_mm)
    finding, smoothing, islands, keeping = STAGES
    stages = Stages(STAGES)
    budget = budget or Budget()
    with threads_of(budget.thread_count) as pool:
        looking = _label_bricks_steps(mask, spacing_mm, steps, close_border, budget)
        code, inside, inside_label = yield from stages.run(finding, looking)
        smoother = _Smoother(code, spacing_mm, steps, inside_label, pool)
        yield from stages.run(smoothing, smoother.smooth_steps())
        fine, limit = smoother.levels[-1], _band_mm(spacing_mm)
        label = RefinedLabel(mask, spacing_mm, steps, close_border, fine.bricks, fine.start, inside, limit)
        yield from stages.run(islands, keep_islands_steps(label, budget))
        whole = yield from smoother.whole_steps()
        return (yield from stages.run(keeping, keep_volume_steps(label, whole, budget, pool, window)))


def _label_bricks_steps(
    mask: NDArray[np.bool_], spacing_mm: tuple[float, float, float], steps: int, close_border: bool, budget: Budget
) -> Steps[tuple[NDArray[np.uint8], Inside, Inside]]:
    """Return the packed label with its margins and the values of `_padded`, if there is memory for all."""
    yield PAUSE
    code, near, inside, inside_label = outlined(mask, spacing_mm)
    slices, rows, columns = mask.shape
    what = f"smoothing a label's {columns} x {rows} x {slices} voxels in {steps} steps a slice"
    budget.require(constrained_bytes(mask, code, near, steps, close_border), what, REMEDY)
    return code, inside, inside_label


def outlined(
    mask: NDArray[np.bool_], spacing_mm: tuple[float, float, float]
) -> tuple[NDArray[np.uint8], NDArray[np.bool_], Inside, Inside]:
    """Return the packed label with its margins, its bricks near the surface, and the values of `_padded`."""
    reach = reach_of(spacing_mm)
    padded, inside, inside_label = _padded(mask, reach)
    code = packed(padded)
    return code, near_surface(code, reach), inside, inside_label


class _Level(NamedTuple):
    """The field and its bounds on one grid; every `slice_steps`-th slice is the label's."""

    grid: _SmoothingGrid
    slice_steps: int
    bricks: Bricks
    start: Start


class _Measured(NamedTuple):
    """Distances on the label's slices at every `every_xy`-th pixel, and the bricks that the field needs."""

    label: Bricks
    distance: Floats
    near: NDArray[np.bool_]
    deep: NDArray[np.bool_]


class _Smoother:
    """The smoothest field near a label's surface, before the constant: grid by grid, each begun from the one before.

    Attributes
    ----------
    levels : list
        The last two grids.
    """

    def __init__(
        self,
        code: NDArray[np.uint8],
        spacing_mm: tuple[float, float, float],
        steps: int,
        inside: Inside,
        pool: Threads | None,
    ) -> None:
        self.code, self.spacing_mm, self.steps = code, spacing_mm, steps
        self.inside, self.pool = inside, pool
        self.levels: list[_Level] = []

    def smooth_steps(self) -> Steps[None]:
        """Smooth the field on every grid."""
        grids = grids_of(self.steps)
        parts = 2 * len(grids)
        measured: _Measured | None = None
        for number, grid in enumerate(grids):
            if number == 0 or grid.every_xy != grids[number - 1].every_xy:
                measured = yield from equal_part(self._measured_steps(grid), 2 * number, parts)
            assert measured is not None, "the first grid is measured"
            level = self._level(grid, measured)
            self.levels = [*self.levels[-1:], level]
            if number:
                before = self.levels[0]
                every = before.grid.every_xy // grid.every_xy, level.slice_steps // before.slice_steps
                carried(before.bricks, before.start.field, level.bricks, level.start, every, self.pool)
            yield from equal_part(self._relaxed_steps(level), 2 * number + 1, parts)

    def _measured_steps(self, grid: _SmoothingGrid) -> Steps[_Measured]:
        """Measure distances up to where a sample may still enter the grid's band."""
        spacing, every = self.spacing_mm, grid.every_xy
        # A sample that is farther from the other side cannot come as near to the surface as is smoothed.
        band = grid.band_mm(spacing)
        farthest = band + halfway_mm(spacing)
        x, y, z = (max(1, math.ceil(farthest / side - 1e-6) - 1) for side in spacing)
        reach = min(WIDTH, x), y, z
        # All that come as near lie in these bricks, with the neighbors that normals read.
        near_y, near_z = (math.floor(farthest / side) - 1 for side in spacing[1:])
        near = near_surface(self.code, (reach[0], max(1, near_y), max(int(self.steps == 1), near_z)))
        deep = self.code != 0
        if every > 1:
            near, deep = _coarser(near), _coarser(deep)
        label = number_bricks(near if self.steps == 1 else widened(near, 1, 0), deep, neighbors=False)
        # Beyond the reach of thin slices distances rise on, so that the band does not end at a flat field.
        farthest = max(farthest, BEYOND * band)
        distance = yield from signed_distance_steps(self.code, label, spacing, reach, farthest, self.pool, every)
        return _Measured(label, distance, near, deep)

    def _level(self, grid: _SmoothingGrid, measured: _Measured) -> _Level:
        """The bricks of a grid, with distances and bounds."""
        steps = self.steps if grid.between else 1
        near, deep = measured.near, measured.deep
        if steps > 1:  # a step is near where one of both slices is
            after = np.repeat(near[1:], steps, axis=0)
            near = np.repeat(near, steps, axis=0)[: (len(near) - 1) * steps + 1]
            deep = np.repeat(deep, steps, axis=0)[: len(near)]
            for step in range(1, steps):
                near[step::steps] |= after[step::steps]
        bricks = number_bricks(near, deep)
        own = measured.label, measured.distance, bricks, self.spacing_mm, steps, self.inside, self.pool
        return _Level(grid, steps, bricks, refined_start(*own, grid.every_xy))

    def _relaxed_steps(self, level: _Level) -> Steps[None]:
        """Smooth the band of a grid in place."""
        yield PAUSE
        grid, _, bricks, start = level
        x, y, z = self.spacing_mm
        sides = (grid.every_xy * x, grid.every_xy * y, z / level.slice_steps)
        near = np.zeros(bricks.shape, bool)
        within = np.abs(start.field[: bricks.active]) <= np.float32(grid.band_mm(self.spacing_mm))
        near.ravel()[bricks.place[: bricks.active]] = within.view(np.uint64)[:, 0] != 0  # any of a brick's 8
        narrow = number_bricks(near, near)  # every neighbor is one of the bricks
        own = bricks.number.ravel().take(narrow.place)
        field = start.field.take(np.append(own, [len(bricks) - 2, len(bricks) - 1]), axis=0)
        own = own[: narrow.active]
        low, high = start.low.take(own, axis=0), start.high.take(own, axis=0)
        yield PAUSE
        yield from relax_steps(narrow, field, low, high, sides, grid.rounds, self.pool, grid.inertia)
        start.field[own] = field[: narrow.active]

    def whole_steps(self) -> Steps[Floats]:
        """The field at all samples, (slices, rows, columns), as the grid before the last has it.

        That holds far from the surface; of the bricks near it only those neighbors have their own field already.
        """
        coarse, fine = self.levels
        every, field = coarse.grid.every_xy, coarse.start.field
        slices, rows, wide = fine.bricks.shape
        whole = np.empty((slices, rows, wide * WIDTH), np.float32)
        for part in parts_of(slices, max(1, SAMPLES_AT_ONCE // (rows * wide * WIDTH))):
            values = field.take(coarse.bricks.number[part], axis=0)  # (slices, rows, bricks, 8)
            values = values.reshape(*values.shape[:2], -1)
            along = np.repeat(values, every, axis=2)[:, :, : wide * WIDTH]
            for row in range(every):
                into = whole[part, row::every]
                into[...] = along[:, : into.shape[1]]
            yield PAUSE
        return whole


def _padded(mask: NDArray[np.bool_], reach: tuple[int, int, int]) -> tuple[NDArray[np.bool_], Inside, Inside]:
    """The mask with margins that hold the band; where it lies in them, and where in them the label is known.

    Where the label reaches the border it is repeated outwards, unknown, so that the field runs on beyond the border
    freely. Bricks and coarse samples are counted from the label's first sample, so that the margin the mask came
    with does not change the surface.
    """
    pads, own, inside_label = [], [], []
    for axis, margin, unit in ((2, WIDTH, 2 * WIDTH), (1, 2, 2), (0, 1, 1)):
        filled = np.flatnonzero(mask.any(axis=tuple({0, 1, 2} - {axis})))
        size = mask.shape[axis]
        before, after = int(filled[0]), size - 1 - int(filled[-1])
        reached = reach[2 - axis] + 1 + 2 * WIDTH * (axis == 2)  # or a brick of the band is repeated
        low = margin if before == 0 else max(0, reached - before)
        low += -(before + low) % unit
        high = margin if after == 0 else max(0, reached - after)
        high += (int(axis == 1) - (low + size + high)) % unit  # whole pairs of bricks, an odd number of rows
        pads.append((low, high))
        own.append((low, low + size))
        inside_label.append((low if before == 0 else 0, low + size + (0 if after == 0 else high + WIDTH)))
    if any(any(pad) for pad in pads):
        mask = np.pad(mask, pads[::-1], mode="edge")
    return mask, Inside(*own), Inside(*inside_label)


def _coarser(flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the flags of bricks with every other sample along x and y, set where one of two is."""
    rows = flags[:, ::2]
    if rows.shape[2] % 2:
        rows = np.concatenate([rows, rows[:, :, -1:]], axis=2)
    return rows[:, :, ::2] | rows[:, :, 1::2]


def constrained_bytes(
    mask: NDArray[np.bool_], code: NDArray[np.uint8], near: NDArray[np.bool_], steps: int, close_border: bool = False
) -> int:
    """Estimate the most bytes that `constrained_steps` takes besides the mask, its result among them.

    Parameters
    ----------
    code, near
        As `outlined` gives them.
    steps : int
        Steps from slice to slice.
    """
    closed = 4 * steps * mask.size if close_border and steps > 1 and (mask[0].any() or mask[-1].any()) else 0
    along_x = _bits((code ^ (code << 1)) & np.uint8(254)) + _bits((code[:, :, 1:] >> 7) ^ (code[:, :, :-1] & 1))
    along_y, along_z = _bits(code[:, 1:] ^ code[:, :-1]), _bits(code[1:] ^ code[:-1])
    surface = (steps * (along_x + along_y) + along_z) * BYTES_A_VERTEX
    samples = WIDTH * code.size
    return samples * (4 * steps + 2) + np.count_nonzero(near) * steps * BYTES_A_BRICK + WORKING_BYTES + closed + surface


def _bits(code: NDArray[Any]) -> int:
    """Return the number of set bits of all bytes."""
    words = np.append(code, np.zeros(-code.size % 8, np.uint8)).view(np.uint64)
    # In each byte the sums of its neighboring bits, of pairs of those, and of both halves.
    for shift, mask in ((1, 0x55), (2, 0x33), (4, 0x0F)):
        of_each = np.uint64(mask * 0x0101010101010101)
        words = (words & of_each) + (words >> np.uint64(shift) & of_each)
    return int(words.view(np.uint8).sum(dtype=np.int64))
