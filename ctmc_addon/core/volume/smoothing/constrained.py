# SPDX-License-Identifier: GPL-3.0-or-later
"""From a label to the smoothest scalar field that agrees with it, in millimeters.

The label's grid is refined between slices where they are far apart; the label's own slices are every
`slice_steps`-th of the result. Inside is `value >= 0`. The same bytes for any number of threads and every NumPy:
only single operations on elements, in an order that does not depend on either.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...budget import Budget
from ...errors import LabelError, SettingsError
from ...progress import PAUSE, Stages, Steps
from .bounds import Inside, Start, doubled, halved, refined_start
from .bricks import WIDTH, Bricks, Floats, Threads, near_surface, number_bricks, packed, threads, widened
from .islands import keep_islands_steps
from .relaxation import relax_steps
from .signed_distance import signed_distance_steps
from .smooth_field import SmoothField
from .volume_constant import keep_volume_steps

BAND_PIXELS = 5  # to either side of the surface that are smoothed
BAND_GAPS = 1.6  # and so many slice gaps
NARROW_PIXELS = 2  # to either side that are smoothed at full resolution, after every other pixel
COARSE_ROUNDS = (25, 72)  # on every other pixel, where slices are refined at most twice, and where more
COARSE_INERTIA = 7.0  # as after some ten rounds: the distances that the field starts with are smooth but for steps
FINE_ROUNDS = 18
FINE_INERTIA = 8.0  # the coarse field is nearly smooth
MOST_STEPS = 8
BYTES_A_BRICK = 300
BYTES_A_VERTEX = 150  # of a surface whose volume is measured, with its triangles
STAGES = {
    "Finding the surface": 5,
    "Measuring distances": 15,
    "Smoothing": 50,
    "Keeping islands": 3,
    "Keeping the volume": 27,
}
WORKING_BYTES = 1 << 23
REMEDY = "choose a region, fewer slice_steps or smoothing none"  # where memory is too little
BITS_OF_BYTE = np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1).sum(axis=1, dtype=np.intp)


def automatic_refinement(spacing_mm: tuple[float, float, float]) -> int:
    """Steps between slices so that no side of a voxel is more than twice another.

    Examples
    --------
    >>> [automatic_refinement((0.75, 0.75, gap)) for gap in (1.0, 1.6, 5.0)]
    [1, 2, 4]
    """
    steps = math.ceil(spacing_mm[2] / (2 * min(spacing_mm[:2])) - 1e-6)
    return max(1, min(MOST_STEPS, steps))


def band_mm(spacing_mm: tuple[float, float, float]) -> float:
    """How far to either side of the surface the field is smoothed."""
    return max(BAND_PIXELS * max(spacing_mm[:2]), BAND_GAPS * spacing_mm[2])


def reach_of(spacing_mm: tuple[float, float, float]) -> tuple[int, int, int]:
    """The same in samples of the label along x, y and z; 8 at most along x."""
    x, y, z = (band_mm(spacing_mm) / side for side in spacing_mm)
    return min(WIDTH, math.ceil(x)), math.ceil(y), max(1, round(z))


def constrained_steps(
    mask: NDArray[np.bool_],
    spacing_mm: tuple[float, float, float],
    slice_steps: int = 0,
    close_border: bool = False,
    budget: Budget | None = None,
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
    finding, measuring, smoothing, islands, keeping = STAGES
    stages = Stages(STAGES)
    budget = budget or Budget()
    with threads(budget.thread_count) as pool:
        looking = _label_bricks_steps(mask, spacing_mm, steps, close_border, budget)
        code, label, inside, inside_label = yield from stages.run(finding, looking)
        reach, farthest = reach_of(spacing_mm), 1.5 * band_mm(spacing_mm)
        distance_steps = signed_distance_steps(code, label, spacing_mm, reach, farthest, pool)
        distance = yield from stages.run(measuring, distance_steps)
        smooth_steps = _smoothed_steps(code != 0, label, distance, inside_label, spacing_mm, steps, pool)
        bricks, start = yield from stages.run(smoothing, smooth_steps)
        far = float(start.field[-2, 0])
        limit = band_mm(spacing_mm)  # of a constant
        islands_steps = keep_islands_steps(mask, spacing_mm, steps, bricks, start, inside, limit, close_border, budget)
        yield from stages.run(islands, islands_steps)
        volume_steps = keep_volume_steps(
            mask, spacing_mm, steps, bricks, start, inside, far, limit, close_border, budget, pool
        )
        return (yield from stages.run(keeping, volume_steps))


def _label_bricks_steps(
    mask: NDArray[np.bool_], spacing_mm: tuple[float, float, float], steps: int, close_border: bool, budget: Budget
) -> Steps[tuple[NDArray[np.uint8], Bricks, Inside, Inside]]:
    """The packed label and the bricks within reach of its surface; the mask's place in them, and the known label's.

    Before anything large is made, whether there is the memory for all.
    """
    yield PAUSE
    code, near, inside, inside_label = outlined(mask, spacing_mm)
    slices, rows, columns = mask.shape
    what = f"smoothing a label's {columns} x {rows} x {slices} voxels in {steps} steps a slice"
    budget.require(constrained_bytes(mask, code, near, steps, close_border), what, REMEDY)
    yield PAUSE
    return code, number_bricks(near if steps == 1 else widened(near, 1, 0), code != 0), inside, inside_label


def outlined(
    mask: NDArray[np.bool_], spacing_mm: tuple[float, float, float]
) -> tuple[NDArray[np.uint8], NDArray[np.bool_], Inside, Inside]:
    """The packed label with its margins, which of its bricks are near the surface, and what `_padded` says of them."""
    reach = reach_of(spacing_mm)
    padded, inside, inside_label = _padded(mask, reach)
    code = packed(padded)
    return code, near_surface(code, reach), inside, inside_label


def _smoothed_steps(
    deep: NDArray[np.bool_],
    label: Bricks,
    distance: Floats,
    inside_label: Inside,
    spacing_mm: tuple[float, float, float],
    steps: int,
    pool: Threads | None,
) -> Steps[tuple[Bricks, Start]]:
    """The smoothest field near the surface, before the constant, and its bounds: on every other pixel, then on all."""
    yield PAUSE
    # The reach is a box: its corners are farther than the band.
    nearest = np.abs(distance[: len(label.place)]).min(axis=1)
    near = np.zeros(deep.shape, bool)
    near.ravel()[label.place] = nearest <= band_mm(spacing_mm)
    if steps > 1:
        after = np.repeat(near[1:], steps, axis=0)
        near = np.repeat(near, steps, axis=0)[: (len(near) - 1) * steps + 1]
        deep = np.repeat(deep, steps, axis=0)[: len(near)]
        for step in range(1, steps):
            near[step:-1:steps] |= after[step::steps]
    refined = number_bricks(near, deep)
    start = refined_start(label, distance, refined, spacing_mm, steps, inside_label, pool)
    yield PAUSE
    stages = Stages({"Smoothing every other pixel": 1, "Smoothing": 1})
    x, y, z = spacing_mm[0], spacing_mm[1], spacing_mm[2] / steps
    coarse = number_bricks(*_coarser(near, deep))
    first = halved(refined, start, coarse, pool)
    rounds, sides = COARSE_ROUNDS[steps > 2], (2 * x, 2 * y, z)
    relaxing = relax_steps(coarse, first.field, first.low, first.high, sides, rounds, pool, COARSE_INERTIA)
    yield from stages.run("Smoothing every other pixel", relaxing)
    doubled(coarse, first.field, refined, start, pool)
    yield from stages.run("Smoothing", _narrow_steps(refined, start, deep, (x, y, z), pool))
    return refined, start


def _narrow_steps(
    bricks: Bricks,
    start: Start,
    deep: NDArray[np.bool_],
    sides: tuple[float, float, float],
    pool: Threads | None,
) -> Steps[None]:
    """Smooth in place what is near the surface now; farther away the field of every other pixel is smooth enough."""
    near = np.zeros(bricks.shape, bool)
    distance = np.abs(start.field[: bricks.active]).min(axis=1)
    near.ravel()[bricks.place[: bricks.active]] = distance <= NARROW_PIXELS * max(sides[:2])
    narrow = number_bricks(near, deep)
    own = bricks.number.ravel().take(narrow.place)
    field = start.field.take(np.append(own, [len(bricks) - 2, len(bricks) - 1]), axis=0)
    own = own[: narrow.active]
    low, high = start.low.take(own, axis=0), start.high.take(own, axis=0)
    yield PAUSE
    yield from relax_steps(narrow, field, low, high, sides, FINE_ROUNDS, pool, FINE_INERTIA)
    start.field[own] = field[: narrow.active]


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
        low = margin if before == 0 else max(0, reach[2 - axis] + 1 - before)
        low += -(before + low) % unit
        high = margin if after == 0 else max(0, reach[2 - axis] + 1 - after)
        high += (int(axis == 1) - (low + size + high)) % unit  # whole pairs of bricks, an odd number of rows
        pads.append((low, high))
        own.append((low, low + size))
        inside_label.append((low if before == 0 else 0, low + size + (0 if after == 0 else high + WIDTH)))
    if any(any(pad) for pad in pads):
        mask = np.pad(mask, pads[::-1], mode="edge")
    return mask, Inside(*own), Inside(*inside_label)


def _coarser(near: NDArray[np.bool_], deep: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which bricks of every other sample along x and y are near the surface, and which are inside."""
    slices, rows, wide = near.shape
    ahead = np.zeros((slices, rows // 2 + 1, 2 * (-(-wide // 2))), bool)
    ahead[:, : -(-rows // 2), :wide] = near[:, ::2]
    odd = near[:, 1::2]
    ahead[:, : odd.shape[1], :wide] |= odd
    ahead[:, 1 : odd.shape[1] + 1, :wide] |= odd
    row = np.minimum(2 * np.arange(rows // 2 + 1), rows - 1)
    return ahead[:, :, ::2] | ahead[:, :, 1::2], deep[:, row, ::2]


def constrained_bytes(
    mask: NDArray[np.bool_], code: NDArray[np.uint8], near: NDArray[np.bool_], steps: int, close_border: bool = False
) -> int:
    """Memory that `constrained_steps` takes at most beside the mask, bytes, its result among them.

    Parameters
    ----------
    code, near
        As `outlined` gives them.
    steps : int
        From slice to slice.
    """
    closed = 4 * steps * mask.size if close_border and steps > 1 and (mask[0].any() or mask[-1].any()) else 0
    along_x = _bits((code ^ (code << 1)) & np.uint8(254)) + _bits((code[:, :, 1:] >> 7) ^ (code[:, :, :-1] & 1))
    along_y, along_z = _bits(code[:, 1:] ^ code[:, :-1]), _bits(code[1:] ^ code[:-1])
    surface = (steps * (along_x + along_y) + along_z) * BYTES_A_VERTEX
    samples = WIDTH * code.size
    return samples * (4 * steps + 2) + np.count_nonzero(near) * steps * BYTES_A_BRICK + WORKING_BYTES + closed + surface


def _bits(code: NDArray[Any]) -> int:
    """How many bits of all bytes are set."""
    return int(np.dot(np.bincount(code.ravel(), minlength=256), BITS_OF_BYTE))
