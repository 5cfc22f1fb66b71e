# SPDX-License-Identifier: GPL-3.0-or-later
"""The constant that gives a smooth field the label's volume, beside those that islands have.

It is added wherever the bounds allow. The volume is that of the triangles Marching Cubes makes: measured, since a
formula over the samples is off by a few percent on tubes of two pixels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...arithmetic import cube_root
from ...arrays import Floats
from ...extraction.grid import Grid, make_axes, make_grid
from ...extraction.marching_cubes import ENDS, extract_steps
from ...machine.budget import Budget
from ...machine.parallel import Threads, parts_of, spread
from ...mesh.triangle_mesh import Surface
from ...progress import PAUSE, Step, Steps, equal_part
from ...volume.volume import Box
from ..bounds import NEAREST_ZERO
from ..bricks import ROWS_AT_ONCE, WIDTH, Places, over_rows
from ..smooth_field import SmoothField, with_closed_ends
from .refined_label import RefinedLabel

PLAIN = (1, 1, 1)  # The stride.
EXACT_ENOUGH = 2e-4  # The volume may be off by this share.
MOST_TRIALS = 10
FARTHER = 4.0  # Go this many times the last step.
FINEST = 2.0**-24  # Sum volumes as whole multiples of this, so that their order does not matter.
FACES_AT_ONCE = 1 << 14
PARTS_AT_ONCE = 64


def keep_volume_steps(
    label: RefinedLabel, whole: Floats, budget: Budget, pool: Threads | None, window: Box | None = None
) -> Steps[SmoothField]:
    """The whole grid's values, with the constant at which the surface encloses the label's volume.

    Parameters
    ----------
    whole : (slices, rows, columns) float32
        The field far from the surface, on the refined grid; filled in place.
    window : Box, optional
        The part of the values whose surface is wanted, with both ends of alpha; the whole surface lies in it.
    """
    mask, slice_steps, inside, bricks, start = label.mask, label.slice_steps, label.inside, label.bricks, label.start
    flat = whole.reshape(-1, WIDTH)
    (x0, x1), (y0, y1), (z0, z1) = inside.x, inside.y, inside.z
    values = whole[z0 * slice_steps : (z1 - 1) * slice_steps + 1, y0:y1, x0:x1]
    sides = label.sides
    voxel = sides[0] * sides[1] * sides[2]
    # A closed border lies half a refined slice outside the last one, unless slices are added.
    counts = [int(np.count_nonzero(layer)) for layer in mask]
    ends = label.adds_slices and counts[0] + counts[-1] > 0
    share_of_end = slice_steps if ends else (slice_steps + 1) / 2
    goal = voxel * (slice_steps * sum(counts[1:-1]) + share_of_end * (counts[0] + counts[-1]))

    def put(constant: np.float32) -> None:
        def shift(part: slice) -> None:
            moved = start.field[part] + constant
            np.maximum(moved, start.low[part], out=moved)
            np.minimum(moved, start.high[part], out=moved)
            flat[bricks.place[part]] = moved

        over_rows(pool, shift, bricks.active)
        _cross_once(flat, between, bricks.shape[1] * bricks.shape[2], nearest)

    z = bricks.coordinates(slice(bricks.active))[0] % slice_steps
    between = [bricks.place[: bricks.active][z == step] for step in range(1, slice_steps)]
    nearest = np.float32(NEAREST_ZERO * min(label.spacing_mm))
    constant = np.float32(0)
    tried: list[tuple[float, float]] = []
    for trial in range(MOST_TRIALS):
        kept_surface: Surface | None = None
        put(constant)
        closed = with_closed_ends(values, slice_steps)[0] if ends else values
        if window is None:
            grid, alphas = make_grid(closed, close_border=True), ENDS[1:]
        else:
            grid, alphas = Grid(closed, *make_axes(window, PLAIN, False)), ENDS
        extracting = extract_steps(grid, 0.0, False, budget, alphas=alphas)
        surface = yield from equal_part(extracting, trial, MOST_TRIALS)
        del closed, grid
        volume, area = yield from equal_part(_measured_steps(surface, sides, pool), trial, MOST_TRIALS)
        if window is not None:
            kept_surface = surface
        del surface  # before the next
        tried.append((float(constant), volume))
        if abs(volume - goal) <= EXACT_ENOUGH * goal or trial == MOST_TRIALS - 1:
            break
        following = np.float32(np.clip(_next(tried, goal, area), -label.limit_mm, label.limit_mm))
        if any(float(following) == earlier for earlier, _ in tried):
            break
        constant = following
    best, volume = min(tried, key=lambda pair: abs(pair[1] - goal))
    if best != float(constant):
        put(np.float32(best))
        kept_surface = None
    values, added = with_closed_ends(values, slice_steps) if ends else (values, 0)
    return SmoothField(values, slice_steps, added, best, volume, goal, kept_surface)


def _cross_once(flat: Floats, between: list[Places], layer: int, nearest: np.float32) -> None:
    """Keep the field from going below zero and back between a sample inside and the next one outside.

    Small components would stand between the slices that the label does not have. `between` has the places of the
    bricks one step above a slice of the label, two steps and so on; `layer` is the number of bricks in a slice.
    """
    steps = len(between) + 1
    for direction in (1, -1):
        for step in range(1, steps)[::direction]:
            for part in parts_of(len(between[step - 1]), ROWS_AT_ONCE):
                place = between[step - 1][part]
                here, before = flat.take(place, axis=0), flat.take(place - direction * layer, axis=0)
                below = flat.take(place - step * layer, axis=0) >= 0
                above = flat.take(place + (steps - step) * layer, axis=0) >= 0
                inward, outward = (below, above) if direction > 0 else (above, below)
                island = inward & ~outward & (before < 0) & (here >= 0)
                if island.any():
                    here[island] = -nearest
                    flat[place] = here


def area_of_ball(volumes: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Return the area of balls of some volumes.

    Examples
    --------
    >>> round(float(area_of_ball(4 / 3 * np.pi)) / np.pi, 12)
    4.0
    """
    root = cube_root(volumes)
    return cube_root(36 * np.pi) * root * root


def _next(tried: list[tuple[float, float]], goal: float, area: float) -> float:
    """The constant to try next: by the area at first, then along the line through the two nearest on either side.

    A label of a few voxels answers little at first: its area is that of a ball at least, and without a constant on
    either side the next one is not much farther than the last.
    """
    below = [pair for pair in tried if pair[1] < goal]
    above = [pair for pair in tried if pair[1] >= goal]
    if below and above:
        (c0, v0), (c1, v1) = max(below, key=lambda pair: pair[1]), min(above, key=lambda pair: pair[1])
        return c0 + (goal - v0) * (c1 - c0) / (v1 - v0)
    constant, volume = tried[-1]
    if len(tried) == 1:
        return constant + (goal - volume) / max(area, float(area_of_ball(goal)))
    earlier, before = tried[-2]
    step = abs(constant - earlier)
    rise = (volume - before) / (constant - earlier)
    change = (goal - volume) / rise if rise > 0 else float(np.copysign(np.inf, goal - volume))
    return constant + float(np.clip(change, -FARTHER * step, FARTHER * step))


def _measured_steps(
    surface: Surface, sides: tuple[float, float, float], pool: Threads | None
) -> Steps[tuple[float, float]]:
    """Enclosed volume and area, mm3 and mm2, of a closed surface in index space."""
    points, faces = surface.linear, surface.faces
    middle = (points.min(axis=0).astype(np.float64) + points.max(axis=0)) / 2
    coordinates = (points - middle).T.copy()  # (3, V) float64
    volumes, areas = [], []

    def measure(part: slice) -> None:
        corners = (faces[part, corner].astype(np.intp) for corner in range(3))
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = ([along.take(of) for along in coordinates] for of in corners)
        along_z = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        along_x = (by - ay) * (cz - az) - (cy - ay) * (bz - az)
        along_y = (bz - az) * (cx - ax) - (cz - az) * (bx - ax)
        volumes.append(int(np.rint(along_z * (az + bz + cz) / FINEST).astype(np.int64).sum()))
        x, y, z = along_x * (sides[1] * sides[2]), along_y * (sides[2] * sides[0]), along_z * (sides[0] * sides[1])
        areas.append(int(np.rint(np.sqrt(x * x + y * y + z * z) / FINEST).astype(np.int64).sum()))

    yield PAUSE
    parts = parts_of(len(faces), FACES_AT_ONCE)
    for first in range(0, len(parts), PARTS_AT_ONCE):
        spread(pool, measure, parts[first : first + PARTS_AT_ONCE])
        yield Step((first + 1) / len(parts))
    return sum(volumes) * FINEST / 6 * (sides[0] * sides[1] * sides[2]), sum(areas) * FINEST / 2
