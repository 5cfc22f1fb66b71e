# SPDX-License-Identifier: GPL-3.0-or-later
"""The field of least curvature within bounds: accelerated projected gradient descent.

Minimized is the sum of squares of the Laplacian over the active bricks, with second differences over squared
spacings. A step along its gradient, Laplacian of the Laplacian, is followed by pushing every value back into its
bounds, and by Nesterov's momentum (Beck and Teboulle 2009, FISTA). The Laplacian is divided by the largest factor
by which it can stretch a field, so a step of 1 never overshoots, and below 4/3 the momentum damps what does.
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Floats
from ..machine.parallel import Threads
from ..progress import Step, Steps
from .bricks import WIDTH, Bricks, Places, over_rows

STEP = 1.25


def relax_steps(
    bricks: Bricks,
    field: Floats,
    low: Floats,
    high: Floats,
    spacing_mm: tuple[float, float, float],
    rounds: int,
    pool: Threads | None,
    inertia: float = 1.0,
) -> Steps[None]:
    """Smooth `field` in place.

    Parameters
    ----------
    bricks : Bricks
    field : (len(bricks), 8) float32
        Bricks that are not active keep their values. At the grid's border the field is mirrored.
    low, high : (active bricks or more, 8) float32
        Bounds, infinite where there are none.
    spacing_mm : (x, y, z)
        Spacing of the grid of these bricks.
    rounds : int
        Steps along the gradient.
    inertia : float
        Inertia that the momentum begins with: 1 for none, more if the field is nearly smooth already.
    """
    weights = [1.0 / (side * side) for side in spacing_mm]
    total = weights[0] + weights[1] + weights[2]
    # Over the weight along x, so that sums along x, and mostly those along y, need no factor.
    along_y, along_z, middle = (np.float32(each / weights[0]) for each in (weights[1], weights[2], 2.0 * total))
    step = np.float32(STEP * (weights[0] / (4.0 * total)) * (weights[0] / (4.0 * total)))
    neighbors, ends = _neighbors(bricks, pool)
    ahead = field.copy()  # the field moved on by its momentum
    curvature = np.zeros_like(field)  # zero where bricks are not active

    def laplacian(values: Floats, part: slice, total: Floats) -> None:
        here, flat = values[part], values.reshape(-1)
        # Along x as if every brick went on in the next of the list: rows of 8 take NumPy far longer than one of all.
        samples = here.reshape(-1)
        np.add(samples[:-2], samples[2:], out=total.reshape(-1)[1:-1])
        np.add(flat.take(ends[0][part], mode="clip"), here[:, 1], out=total[:, 0])
        np.add(here[:, -2], flat.take(ends[1][part], mode="clip"), out=total[:, -1])
        pair, second = np.empty_like(here), np.empty_like(here)
        for axis, weight in ((0, along_y), (2, along_z)):
            values.take(neighbors[axis][part], axis=0, out=pair, mode="clip")
            values.take(neighbors[axis + 1][part], axis=0, out=second, mode="clip")
            pair += second
            if weight != 1:
                pair *= weight
            total += pair
        np.multiply(here, middle, out=pair)
        total -= pair

    def bend(part: slice) -> None:
        laplacian(ahead, part, curvature[part])

    def descend(part: slice) -> None:
        here, before = ahead[part], field[part]
        moved = np.empty_like(here)
        laplacian(curvature, part, moved)
        moved *= step
        np.subtract(here, moved, out=moved)
        np.maximum(moved, low[part], out=moved)
        np.minimum(moved, high[part], out=moved)
        np.subtract(moved, before, out=here)
        here *= momentum
        here += moved
        before[...] = moved

    for done in range(rounds):
        following = (1.0 + math.sqrt(1.0 + 4.0 * inertia * inertia)) / 2.0
        momentum = np.float32((inertia - 1.0) / following)
        inertia = following
        over_rows(pool, bend, bricks.active)
        over_rows(pool, descend, bricks.active)
        yield Step((done + 1) / rounds)


def _neighbors(bricks: Bricks, pool: Threads | None) -> tuple[list[Places], list[Places]]:
    """Return for active bricks their neighbors along y and z, and for samples their neighbors along x.

    At the border a brick is its own neighbor, a sample its own.
    """
    neighbors = [np.empty(bricks.active, np.intp) for _ in range(4)]
    ends = [np.empty(bricks.active, np.intp) for _ in range(2)]

    def look(part: slice) -> None:
        z, y, x = bricks.coordinates(part)
        for into, (dz, dy) in zip(neighbors, ((0, -1), (0, 1), (-1, 0), (1, 0)), strict=True):
            into[part] = bricks.at(z + dz, y + dy, x)
        ends[0][part] = bricks.at(z, y, x - 1) * WIDTH + np.where(x > 0, WIDTH - 1, 0)
        ends[1][part] = bricks.at(z, y, x + 1) * WIDTH + np.where(x < bricks.shape[2] - 1, 0, WIDTH - 1)

    over_rows(pool, look, bricks.active)
    return neighbors, ends
