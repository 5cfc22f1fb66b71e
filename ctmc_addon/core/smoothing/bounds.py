# SPDX-License-Identifier: GPL-3.0-or-later
"""Start values of a field before it is smoothed, and the bounds that it must not cross.

At a sample of the label the field keeps the label's sign, and stays as far from zero as the distance to the other
side less the mean of pixel and slice gap: the surface lies somewhere between the two, and without such a bound
the smoothest field is nearly zero and the body shrinks. Between two slices that agree the field keeps their sign,
so a tube does not tear and nothing is joined across a gap; where they differ it is free.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays import Floats
from ..machine.parallel import Threads
from .bricks import WIDTH, Bricks, Places, over_rows

NEAREST_ZERO = 0.02  # No value of known sign is nearer to zero than this share of a voxel's shortest side.


@dataclass(frozen=True, eq=False)
class Start:
    """A field and its bounds over the same bricks, (len(bricks), 8) float32 each."""

    field: Floats
    low: Floats
    high: Floats


@dataclass(frozen=True)
class Inside:
    """Samples of a padded grid that are the label's own: (first, stop) along x, y, z."""

    x: tuple[int, int]
    y: tuple[int, int]
    z: tuple[int, int]


def refined_start(
    label: Bricks,
    distance: Floats,
    refined: Bricks,
    spacing_mm: tuple[float, float, float],
    slice_steps: int,
    inside: Inside,
    pool: Threads | None,
    every: int = 1,
) -> Start:
    """Signed distances carried to the grid with `slice_steps` steps between slices, and the bounds there.

    Parameters
    ----------
    label, refined : Bricks
        Bricks of the label's grid and of the refined one, every `slice_steps`-th slice of which is the label's.
    distance : (len(label), 8) float32
        Distance to the nearest sample on the other side.
    inside : Inside
        Samples of the label's grid outside it have no bounds.
    every : int
        2 where bricks have every other sample along x and y; else 1, and then neighbors of active bricks have no
        bounds, and a field of 0.
    """
    count = len(refined)
    field, low, high = (np.empty((count, WIDTH), np.float32) for _ in range(3))
    centered = np.float32(min(spacing_mm) / 2)
    gap, least = np.float32(halfway_mm(spacing_mm)), np.float32(NEAREST_ZERO * min(spacing_mm))
    infinite = np.float32(np.inf)
    (x0, x1), (y0, y1), (z0, z1) = inside.x, inside.y, inside.z

    def fill(part: slice) -> None:
        z, y, x = refined.coordinates(part)
        below, step = np.divmod(z, slice_steps)
        lower = distance.take(label.at(below, y, x), axis=0)
        away = np.abs(lower)
        away -= gap
        np.maximum(away, least, out=away)
        has_label = (y * every >= y0) & (y * every < y1) & (z >= z0 * slice_steps) & (z <= (z1 - 1) * slice_steps)
        unknown = np.repeat(~has_label[:, None], WIDTH, axis=1)  # where the label says nothing of the sign
        edge = np.flatnonzero((x * (WIDTH * every) < x0) | ((x + 1) * (WIDTH * every) > x1))
        columns = (x[edge, None] * WIDTH + np.arange(WIDTH)) * every
        unknown[edge] |= (columns < x0) | (columns >= x1)
        between = np.flatnonzero(step)
        here, upper = lower[between], distance.take(label.at(below[between] + 1, y[between], x[between]), axis=0)
        away[between] = least
        unknown[between] |= (here > 0) != (upper > 0)
        positive = lower > 0
        np.copysign(away, lower, out=away)
        low[part] = np.where(positive & ~unknown, away, -infinite)
        high[part] = np.where(positive | unknown, infinite, away)
        lower -= np.copysign(centered, lower)
        upper -= np.copysign(centered, upper)
        share = (step[between] / np.float32(slice_steps)).astype(np.float32)[:, None]
        lower[between] = lower[between] * (1 - share) + upper * share
        field[part] = lower

    filled = len(refined.place) if every > 1 else refined.active
    field[filled:-2], low[filled:], high[filled:] = 0.0, -infinite, infinite
    over_rows(pool, fill, filled)
    for row, sign in ((-2, 1), (-1, -1)):
        away = abs(distance[row, 0]) - centered
        field[row] = sign * away
        low[row] = max(away - gap, least) if sign > 0 else -infinite
        high[row] = infinite if sign > 0 else -max(away - gap, least)
    return Start(field, low, high)


def halfway_mm(spacing_mm: tuple[float, float, float]) -> float:
    """Return the mean of pixel and slice gap, about half of which the surface may be away from a sample."""
    return ((spacing_mm[0] + spacing_mm[1]) / 2 + spacing_mm[2]) / 2


def carried(
    before: Bricks, values: Floats, after: Bricks, start: Start, every: tuple[int, int], pool: Threads | None
) -> None:
    """Carry values of a grid to all bricks of a finer one, by cubics, and back into their bounds.

    Between two samples stands the cubic through their values and those of the samples beyond; linear steps would leave
    folds that take the fine grid rounds to smooth.

    Parameters
    ----------
    before, after : Bricks
    values : (len(before), 8) float32
    start : Start
        Start of the finer grid.
    every : (xy, z) int
        Samples of the finer grid for each of the coarser one along x and y, 1 or 2, and along z.
    """
    if every[0] == 2:
        values = _doubled_along_x(before, values, pool)

    def row(z: Places, y: Places, x: Places) -> Floats:
        number = before.at(z, y, x // every[0])
        return values.take(every[0] * number + x % every[0], axis=0)

    def along_y(z: Places, y: Places, x: Places) -> Floats:
        below, step = np.divmod(y, every[0])
        return _on_cubics(step, every[0], lambda own, offset: row(z[own], below[own] + offset, x[own]))

    def carry(part: slice) -> None:
        z, y, x = after.coordinates(part)
        below, step = np.divmod(z, every[1])
        moved = _on_cubics(step, every[1], lambda own, offset: along_y(below[own] + offset, y[own], x[own]))
        np.maximum(moved, start.low[part], out=moved)
        np.minimum(moved, start.high[part], out=moved)
        start.field[part] = moved

    over_rows(pool, carry, len(after.place))


def _on_cubics(step: Places, steps: int, at: Callable[[Places, int], Floats]) -> Floats:
    """Interpolate between known rows by the cubic through four of them.

    Row i lies `step[i]` of `steps` steps after a known row. `at(own, n)` returns, for each of the rows `own`, the n-th
    known row after that one.
    """
    if steps == 1:
        return at(np.arange(len(step)), 0)
    out = np.empty((len(step), WIDTH), np.float32)
    on_rows, between = np.flatnonzero(step == 0), np.flatnonzero(step)
    out[on_rows] = at(on_rows, 0)
    t = (step[between] / np.float32(steps)).astype(np.float32)[:, None]
    weights = (
        -t * (1 - t) * (2 - t) / 6,
        (1 + t) * (1 - t) * (2 - t) / 2,
        (1 + t) * t * (2 - t) / 2,
        -(1 + t) * t * (1 - t) / 6,
    )
    moved = np.zeros((len(between), WIDTH), np.float32)
    for offset, weight in zip((-1, 0, 1, 2), weights, strict=True):
        moved += weight * at(between, offset)
    out[between] = moved
    return out


def _doubled_along_x(bricks: Bricks, values: Floats, pool: Threads | None) -> Floats:
    """Values with one between every two along x: for every brick two, (2 len(bricks), 8)."""
    wide = np.empty((len(bricks), 2 * WIDTH), np.float32)
    last = bricks.shape[2] - 1

    def along_row(part: slice) -> None:
        z, y, x = bricks.coordinates(part)
        ext = np.empty((len(x), WIDTH + 3), np.float32)  # from the sample before to the second one after
        ext[:, 1:-2] = values[part]
        ext[:, 0] = np.where(x > 0, values[bricks.at(z, y, x - 1), -1], ext[:, 1])
        ext[:, -2:] = np.where((x < last)[:, None], values[bricks.at(z, y, x + 1), :2], ext[:, -3:-2])
        wide[part, ::2] = ext[:, 1:-2]
        outer, inner = ext[:, :-3] + ext[:, 3:], ext[:, 1:-2] + ext[:, 2:-1]
        wide[part, 1::2] = inner * np.float32(9 / 16) - outer * np.float32(1 / 16)

    over_rows(pool, along_row, len(bricks.place))
    wide[-2:] = values[-2:, :1]
    return wide.reshape(-1, WIDTH)
