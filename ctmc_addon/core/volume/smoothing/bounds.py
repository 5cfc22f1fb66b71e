# SPDX-License-Identifier: GPL-3.0-or-later
"""What is known of the field before it is smoothed: where it starts, and what it must not cross.

At a sample of the label the field keeps the label's sign, and stays as far from zero as the distance to the other
side less the mean of pixel and slice gap: the surface lies somewhere between the two, and without such a bound
the smoothest field is nearly zero and the body shrinks. Between two slices that agree the field keeps their sign,
so a tube does not tear and nothing is joined across a gap; where they differ it is free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .bricks import WIDTH, Bricks, Floats, Places, Threads, pieces, spread

NEAREST_ZERO = 0.02  # of the shortest side of a voxel: no value is nearer to zero where its sign is known


@dataclass(frozen=True, eq=False)
class Start:
    """A field and its bounds over the same bricks, (len(bricks), 8) float32 each."""

    field: Floats
    low: Floats
    high: Floats


@dataclass(frozen=True)
class Inside:
    """Which samples of a padded grid are the label's own: (first, stop) along x, y, z."""

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
) -> Start:
    """Signed distances carried to the grid with `slice_steps` steps between slices, and the bounds there.

    Parameters
    ----------
    label, refined : Bricks
        Of the label's grid and of the refined one, every `slice_steps`-th slice of which is the label's.
    distance : (len(label), 8) float32
        To the nearest sample on the other side.
    inside : Inside
        Samples of the label's grid outside it have no bounds.
    """
    count = len(refined)
    field, low, high = (np.empty((count, WIDTH), np.float32) for _ in range(3))
    centered = np.float32(min(spacing_mm) / 2)
    gap = np.float32(((spacing_mm[0] + spacing_mm[1]) / 2 + spacing_mm[2]) / 2)
    least = np.float32(NEAREST_ZERO * min(spacing_mm))
    infinite = np.float32(np.inf)
    last = label.shape[0] - 1

    def fill(part: slice) -> None:
        z, y, x = refined.coordinates(part)
        below, step = np.divmod(z, slice_steps)
        share = (step / np.float32(slice_steps)).astype(np.float32)[:, None]
        lower = np.take(distance, label.at(below, y, x), axis=0)
        upper = np.take(distance, label.at(np.minimum(below + 1, last), y, x), axis=0)
        between = share > 0
        agree = (lower > 0) == (upper > 0)
        away = np.where(between, least, np.maximum(np.abs(lower) - gap, least))
        columns = x[:, None] * WIDTH + np.arange(WIDTH)
        decided = agree | ~between
        decided &= (columns >= inside.x[0]) & (columns < inside.x[1])
        decided &= ((y >= inside.y[0]) & (y < inside.y[1]))[:, None]
        decided &= ((z >= inside.z[0] * slice_steps) & (z <= (inside.z[1] - 1) * slice_steps))[:, None]
        positive = lower > 0
        low[part] = np.where(decided & positive, away, -infinite)
        high[part] = np.where(decided & ~positive, -away, infinite)
        lower -= np.copysign(centered, lower)
        upper -= np.copysign(centered, upper)
        field[part] = lower * (1 - share) + upper * share

    spread(pool, fill, pieces(len(refined.place)))
    for row, sign in ((-2, 1), (-1, -1)):
        away = abs(distance[row, 0]) - centered
        field[row] = sign * away
        low[row] = max(away - gap, least) if sign > 0 else -infinite
        high[row] = infinite if sign > 0 else -max(away - gap, least)
    return Start(field, low, high)


def halved(fine: Bricks, start: Start, coarse: Bricks, pool: Threads | None) -> Start:
    """Every other sample along x and y; of an odd number of rows and pairs of bricks, as `field` makes them."""
    taken = [np.empty((len(coarse), WIDTH), np.float32) for _ in range(3)]

    def pick(part: slice) -> None:
        z, y, x = coarse.coordinates(part)
        rows = [fine.at(z, 2 * y, 2 * x + half) for half in (0, 1)]
        for into, values in zip(taken, (start.field, start.low, start.high), strict=True):
            for half, there in enumerate(rows):
                into[part, 4 * half : 4 * half + 4] = np.take(values, there, axis=0)[:, ::2]

    spread(pool, pick, pieces(len(coarse.place)))
    for into, values in zip(taken, (start.field, start.low, start.high), strict=True):
        into[-2:] = values[-2:]
    return Start(*taken)


def doubled(coarse: Bricks, values: Floats, fine: Bricks, start: Start, pool: Threads | None) -> None:
    """Carry coarse values to the active bricks of the fine grid, linearly, and back into their bounds."""

    def carry(part: slice) -> None:
        z, y, x = fine.coordinates(part)
        right = (x % 2).astype(bool)[:, None]

        def line(row: Places) -> Floats:
            ext = np.empty((len(row), WIDTH + 1), np.float32)
            ext[:, :WIDTH] = np.take(values, coarse.at(z, row, x // 2), axis=0)
            ext[:, WIDTH] = np.take(values, coarse.at(z, row, x // 2 + 1), axis=0)[:, 0]
            part_of = np.where(right, ext[:, 4:9], ext[:, 0:5])
            wide = np.empty((len(row), WIDTH), np.float32)
            wide[:, ::2] = part_of[:, :4]
            wide[:, 1::2] = (part_of[:, :4] + part_of[:, 1:]) * np.float32(0.5)
            return wide

        mean = line(y // 2)
        mean += line((y + 1) // 2)
        mean *= np.float32(0.5)
        np.maximum(mean, start.low[part], out=mean)
        np.minimum(mean, start.high[part], out=mean)
        start.field[part] = mean

    spread(pool, carry, pieces(fine.active))
