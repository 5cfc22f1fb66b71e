# SPDX-License-Identifier: GPL-3.0-or-later
"""The field between two labels that touch: the smoothest one that lies halfway between their samples.

Where a sample of one label is beside one of the other, the wall is somewhere between them, every place as likely: the
field is expected to be half their distance along the wall's normal, with the variance of that interval. The field has
the least sum of squared second differences and of squared deviations from that, within the signs at all samples of
both. Only samples near such pairs count, and no second difference that reaches beyond them: where the wall ends,
nothing bends it. A smoothing spline, after Wahba 1990, doi:10.1137/1.9781611970128, solved on coarse nodes first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Floats, Signs
from ..machine.budget import Budget
from ..machine.parallel import Threads, parts_of, spread, threads_of
from ..progress import PAUSE, Steps
from .bounds import NEAREST_ZERO
from .bricks import Places, widened

STIFFNESS = 600.0  # The weight of second differences.
REACH = 1  # Use this many nodes around those with samples of both labels.
# For every coarse grid: the space between nodes in longest sides of the refined samples, and steps along the gradient.
GRIDS = ((4, 100), (2, 100))
# Add a grid of the longest side if it is more than this many times the shortest: the last step is too wide else.
UNEVEN = 2.0
ROUNDS = 100  # Rounds at all samples.
LEAST_DEVIATION = 0.1  # In shortest sides: pairs that the wall almost passes along are not exact.
NODES_AT_ONCE = 1 << 15


class _Pairs(NamedTuple):
    """Samples of one label with a neighbor in the other label, for both labels.

    Parameters
    ----------
    place : (3, n) intp
        On the refined grid, along z, y and x.
    normal : (3, n) float64
        Normal of the wall there, in the direction in which the field rises.
    expected : (n,) float64
        The field, mm.
    weight : (n,) float64
        One over its variance.
    """

    place: NDArray[np.intp]
    normal: NDArray[np.float64]
    expected: NDArray[np.float64]
    weight: NDArray[np.float64]


def between_labels_steps(
    walls: Sequence[tuple[Floats, Signs]], spacing_mm: tuple[float, float, float], slice_steps: int, budget: Budget
) -> Steps[list[Floats]]:
    """Smooth fields near changes of their known signs, within these signs, each by itself, all in one list.

    Parameters
    ----------
    walls : sequence of (field, sign)
        ((slices - 1) * slice_steps + 1, rows, columns) float32, millimeters, on the refined grid: about the distance
        to its surface. And (slices, rows, columns) int8: 1 or -1 where the field must be above or below 0, and 0 where
        it is free.
    spacing_mm : (x, y, z) float
        Spacing of the samples that have signs.
    slice_steps : int
        Steps from slice to slice.

    Returns
    -------
    list of arrays like the fields
    """
    yield PAUSE
    smooth = [field for field, _ in walls]
    both = [at for at, (_, sign) in enumerate(walls) if (sign > 0).any() and (sign < 0).any()]
    if not both:
        return smooth
    fields, signs = [walls[at][0] for at in both], [walls[at][1] for at in both]
    x, y, z = spacing_mm
    sides = (z / slice_steps, y, x)
    pairs = []
    for field, sign in zip(fields, signs, strict=True):
        pairs.append(_pairs(field, sign, sides, slice_steps))
        yield PAUSE
    least = np.float32(NEAREST_ZERO * min(spacing_mm))
    with threads_of(budget.thread_count) as pool:
        values, before = fields, [1, 1, 1]
        uneven = max(sides) > UNEVEN * min(sides)
        for longest, rounds in (*GRIDS, (1, ROUNDS)) if uneven else GRIDS:
            space = [max(1, round(longest * max(sides) / side)) for side in sides]
            values = [_on_nodes(own, before, space, field.shape) for own, field in zip(values, fields, strict=True)]
            before = space
            yield from _relaxed_steps(values, pairs, sides, space, slice_steps, None, rounds, pool)
        values = [_on_nodes(own, before, [1, 1, 1], field.shape) for own, field in zip(values, fields, strict=True)]
        bounds = []
        for sign in signs:
            fine = _refined_signs(sign, slice_steps)
            low = np.where(fine > 0, least, np.float32(-np.inf))
            bounds.append((low, np.where(fine < 0, -least, np.float32(np.inf))))
            yield PAUSE
        places = yield from _relaxed_steps(values, pairs, sides, [1, 1, 1], slice_steps, bounds, ROUNDS, pool)
    for at, field, ends, own, place in zip(both, fields, bounds, values, places, strict=True):
        smooth[at] = np.clip(field, *ends)
        smooth[at].reshape(-1)[place] = own.reshape(-1)[place]
    return smooth


def _pairs(field: Floats, sign: Signs, sides: tuple[float, float, float], slice_steps: int) -> _Pairs:
    """Find the samples of each label with a neighbor in the other label, along each axis."""
    parts = []
    for axis in range(3):
        first, second = (
            sign[tuple(part if each == axis else slice(None) for each in range(3))]
            for part in (slice(None, -1), slice(1, None))
        )
        at = np.array(np.unravel_index(np.flatnonzero(first * second < 0), first.shape))
        own = sign[tuple(at)].astype(np.float64)
        ends = []
        for end in (0, 1):
            place = at.copy()
            place[axis] += end
            place[0] *= slice_steps
            ends.append(place)
        rise = _rise(field, ends[0], sides) + _rise(field, ends[1], sides)
        normal = rise / np.maximum(np.sqrt((rise**2).sum(axis=0)), 1e-9)
        apart = np.abs(normal[axis]) * sides[axis] * (slice_steps if axis == 0 else 1)
        least = LEAST_DEVIATION * min(sides)
        weight = 12.0 / (apart * apart + least * least)
        parts += [(place, normal, half * apart, weight) for place, half in zip(ends, (own / 2, -own / 2), strict=True)]
    return _Pairs(*(np.concatenate(each, axis=-1) for each in zip(*parts, strict=True)))


def _rise(field: Floats, place: NDArray[np.intp], sides: tuple[float, float, float]) -> NDArray[np.float64]:
    """The gradient of a field at some samples, (3, n)."""
    out = np.empty(place.shape)
    for axis, side in enumerate(sides):
        low, high = place.copy(), place.copy()
        low[axis] = np.maximum(place[axis] - 1, 0)
        high[axis] = np.minimum(place[axis] + 1, field.shape[axis] - 1)
        apart = np.maximum(high[axis] - low[axis], 1) * side
        out[axis] = (field[tuple(high)].astype(np.float64) - field[tuple(low)]) / apart
    return out


def _refined_signs(sign: Signs, slice_steps: int) -> Signs:
    """Return the signs on the refined grid; between slices only where both agree."""
    refined = np.zeros(((len(sign) - 1) * slice_steps + 1, *sign.shape[1:]), np.int8)
    refined[::slice_steps] = sign
    for step in range(1, slice_steps):
        refined[step::slice_steps] = np.where(sign[1:] == sign[:-1], sign[1:], np.int8(0))
    return refined


class _Nodes(NamedTuple):
    """The nodes of a grid near one wall, and the values to which each is pulled.

    Parameters
    ----------
    place : (n,) intp
        On the grid.
    neighbors : (2, 3, n) intp
        The numbers of the nodes before and behind along each axis; n without one.
    start : (n,) float32
    pull, share, goal : (n,) float32
        The factor of the field's bending, that of the field itself, and what is added to it, in a step.
    ends : (2, n) float32, or None
        Bounds of the field.
    """

    place: Places
    neighbors: Places
    start: Floats
    pull: Floats
    share: Floats
    goal: Floats
    ends: Floats | None


def _nodes(
    values: Floats,
    pairs: _Pairs,
    sides: tuple[float, float, float],
    space: list[int],
    slice_steps: int,
    bounds: tuple[Floats, Floats] | None,
) -> _Nodes:
    """Find the nodes near the pairs of a wall.

    A step along an entry is divided by how stiff the whole can be there, with the weight of its pairs; so it never
    overshoots, however large that weight is.
    """
    shape = values.shape
    apart = [side * steps for side, steps in zip(sides, space, strict=True)]
    node = np.array([(place + steps // 2) // steps for place, steps in zip(pairs.place, space, strict=True)])
    moved = sum(
        (node[axis] * space[axis] - pairs.place[axis]) * side * pairs.normal[axis] for axis, side in enumerate(sides)
    )
    flat = (node[0] * shape[1] + node[1]) * shape[2] + node[2]
    near = np.zeros(shape, bool)
    near.reshape(-1)[flat] = True
    between = -(-slice_steps // (2 * space[0]))  # what lies between two slices is near one of both
    for axis in range(3):
        near = widened(near, REACH if axis else max(REACH, between), axis)
    place = np.flatnonzero(near)
    count = len(place)
    number = np.full(values.size, count, np.int32)  # that of a node beyond all, without curvature
    number[place] = np.arange(count, dtype=np.int32)
    own = number[flat]
    weight = np.bincount(own, pairs.weight, count)
    toward = np.bincount(own, pairs.weight * (pairs.expected + moved), count)
    z, y, x = _stiff(apart)
    scale = 1.0 / (16.0 * (z + y + x) + weight)
    return _Nodes(
        place,
        _neighbors(place, number, shape),
        values.reshape(-1)[place],
        scale.astype(np.float32),
        (weight * scale).astype(np.float32),
        (toward * scale).astype(np.float32),
        None if bounds is None else np.array([each.reshape(-1)[place] for each in bounds]),
    )


def _stiff(apart: Sequence[float]) -> list[float]:
    """The weights of squared second differences along each axis, of nodes so far apart."""
    stiffness = STIFFNESS * math.prod(apart) / max(apart)
    return [stiffness / (side * side * side * side) for side in apart]


def _relaxed_steps(
    values: Sequence[Floats],
    pairs: Sequence[_Pairs],
    sides: tuple[float, float, float],
    space: list[int],
    slice_steps: int,
    bounds: Sequence[tuple[Floats, Floats]] | None,
    rounds: int,
    pool: Threads | None,
) -> Steps[list[Places]]:
    """Smooth the values at the nodes near the pairs of each wall, in place, by accelerated gradient descent.

    Returns where they are. All walls are one list, in which none is beside a node of another.
    """
    yield PAUSE
    every = []
    for at, (own, near) in enumerate(zip(values, pairs, strict=True)):
        every.append(_nodes(own, near, sides, space, slice_steps, None if bounds is None else bounds[at]))
        yield PAUSE
    firsts = np.cumsum([0, *(len(each.place) for each in every)])
    count = int(firsts[-1])
    neighbors = np.concatenate(
        [
            np.where(each.neighbors < len(each.place), each.neighbors + first, count)
            for each, first in zip(every, firsts[:-1].tolist(), strict=True)
        ],
        axis=2,
    )
    pull = np.concatenate([each.pull for each in every])
    share = np.concatenate([each.share for each in every])
    goal = np.concatenate([each.goal for each in every])
    ends = None if bounds is None else np.concatenate([each.ends for each in every if each.ends is not None], axis=1)
    stiff = np.array(_stiff([side * steps for side, steps in zip(sides, space, strict=True)]), np.float32)
    # A second difference that reaches beyond the nodes does not count.
    factor = np.where((neighbors < count).all(axis=0), stiff[:, None], np.float32(0))
    field = np.append(np.concatenate([each.start for each in every]), np.float32(0))
    ahead = field.copy()
    curvature = np.zeros((3, count + 1), np.float32)

    def second(of: Floats, axis: int, part: slice) -> Floats:
        out = of.take(neighbors[0, axis, part])
        out += of.take(neighbors[1, axis, part])
        here = of[part]
        out -= here
        out -= here
        return out

    def bend(part: slice) -> None:
        for axis in range(3):
            np.multiply(second(ahead, axis, part), factor[axis, part], out=curvature[axis, part])

    def descend(part: slice) -> None:
        here, before = ahead[part], field[part]
        down = second(curvature[0], 0, part)
        for axis in (1, 2):
            down += second(curvature[axis], axis, part)
        down *= pull[part]
        now = here - down
        now -= share[part] * here
        now += goal[part]
        if ends is not None:
            np.maximum(now, ends[0, part], out=now)
            np.minimum(now, ends[1, part], out=now)
        np.subtract(now, before, out=here)
        here *= momentum
        here += now
        before[...] = now

    parts = parts_of(count, NODES_AT_ONCE)
    inertia = 1.0
    for _ in range(rounds):
        following = (1.0 + math.sqrt(1.0 + 4.0 * inertia * inertia)) / 2.0
        momentum = np.float32((inertia - 1.0) / following)
        inertia = following
        spread(pool, bend, parts)
        spread(pool, descend, parts)
        yield PAUSE
    for own, each, first in zip(values, every, firsts[:-1].tolist(), strict=True):
        own.reshape(-1)[each.place] = field[first : first + len(each.place)]
    return [each.place for each in every]


def _neighbors(place: Places, number: NDArray[np.int32], shape: tuple[int, ...]) -> Places:
    """The numbers of the nodes before and behind those at `place`, along each axis: (2, 3, n)."""
    neighbors = np.empty((2, 3, len(place)), np.intp)
    steps = (shape[1] * shape[2], shape[2], 1)
    for axis, (along, step, size) in enumerate(zip(np.unravel_index(place, shape), steps, shape, strict=True)):
        for into, way, border in zip(neighbors[:, axis], (-step, step), (0, size - 1), strict=True):
            into[...] = number.take(place + way, mode="clip")
            into[along == border] = len(place)
    return neighbors


def _on_nodes(values: Floats, before: list[int], space: list[int], shape: tuple[int, ...]) -> Floats:
    """Values at the nodes of a grid, linear between those of the grid before; always new."""
    out = values.copy()
    for axis, (old, new) in enumerate(zip(before, space, strict=True)):
        count = (shape[axis] - 1 + new // 2) // new + 1
        place = np.minimum(np.arange(count) * new, (out.shape[axis] - 1) * old)
        low = place // old
        high = np.minimum(low + 1, out.shape[axis] - 1)
        part = ((place - low * old) / np.float32(old)).astype(np.float32)
        part = part.reshape([-1 if each == axis else 1 for each in range(3)])
        first = out.take(low, axis=axis)
        out = first + (out.take(high, axis=axis) - first) * part
    return out
