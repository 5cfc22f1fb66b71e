# SPDX-License-Identifier: GPL-3.0-or-later
"""The largest diameter of a surface: the distance of the two vertices that lie farthest apart.

Vertices lie in boxes, and these in larger ones (an octree). Pairs of boxes are split as long as vertices in them may
be farther apart than two that are known; of the smallest ones all vertices are compared. Two bounds say how far apart
they may be. The far corners of the boxes bound them in floating point too, as rounding keeps the order of differences,
squares and sums. On a ball, where every vertex has one opposite that is as far, boxes opposite each other are bounded
by the law of cosines about the middle, from the distances to it and the angle between them. So the result is that of
comparing all pairs.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Doubles, Indices
from ..progress import Step, Steps, finish

MESSAGE = "Measuring the largest diameter"
IN_BOX = 16  # One of the smallest boxes has about this many vertices.
DEEPEST = 10  # The boxes have at most this many levels, of 3 bits each.
AT_ONCE = 1 << 13  # Split this many pairs of boxes in one go.
MOST_COMPARED = 1 << 20  # Compare this many pairs of vertices in one go.
ROUNDING = 1e-9  # The bounds by angles are off by less than this share.
SWEEPS = 4  # Go this many times from a vertex to the farthest one.


def largest_diameter(vertices: NDArray[np.float32]) -> float:
    """Return the distance of the two positions (V, 3) that lie farthest apart, in their unit; 0 for fewer than two.

    Examples
    --------
    >>> largest_diameter(np.array([[0, 0, 0], [1, 1, 0], [3, 4, 0]], np.float32))
    5.0
    """
    return finish(largest_diameter_steps(vertices))


def largest_diameter_steps(vertices: NDArray[np.float32]) -> Steps[float]:
    """Do what `largest_diameter` does, in steps."""
    yield Step(0.0, MESSAGE)
    if len(vertices) < 2:
        return 0.0
    points = vertices.astype(np.float64)
    best, middle = _swept(points)
    reach = _squares(points, middle)
    # The other end is no farther from the middle than the farthest vertex.
    points = points[np.sqrt(reach) + math.sqrt(reach.max()) >= math.sqrt(best) * (1 - ROUNDING)]
    yield Step(0.2, MESSAGE)
    levels, points = _levels(points, middle)
    yield Step(0.4, MESSAGE)
    waiting = [(0, np.zeros(1, np.int64), np.zeros(1, np.int64))]
    while waiting:
        depth, first, second = waiting.pop()
        here = levels[depth]
        open_pairs = _bounds(here, first, second) > best  # which may be more now than when they were put here
        first, second = first[open_pairs], second[open_pairs]
        if depth + 1 == len(levels):
            best = max(best, _compared(points, here, first, second))
            yield Step(0.7, MESSAGE)
            continue
        first, second = _products(here.first_child, first, second)
        once = first <= second
        first, second = first[once], second[once]
        here = levels[depth + 1]
        best = max(
            best, float(_squares(points[here.first_vertex[first]], points[here.first_vertex[second]]).max(initial=0))
        )
        far = _bounds(here, first, second)
        order = np.argsort(far, kind="stable")  # the farthest come last and are taken first
        order = order[far[order] > best]
        for start in range(0, len(order), AT_ONCE):
            block = order[start : start + AT_ONCE]
            waiting.append((depth + 1, first[block], second[block]))
        yield Step(0.6, MESSAGE)
    return math.sqrt(best)


class _BoxLevel(NamedTuple):
    """Boxes of one size: the tight bounds of the vertices in each, and where their vertices and children begin.

    Seen from the middle, the vertices of a box are at most `distance` away, and at most the angle `spread` from `axis`.
    The last entry of `first_vertex` and `first_child` is the end of the last box.
    """

    low: Doubles
    high: Doubles
    axis: Doubles
    spread: Doubles
    distance: Doubles
    first_vertex: Indices
    first_child: Indices


def _levels(points: Doubles, middle: Doubles) -> tuple[list[_BoxLevel], Doubles]:
    """Return the levels of boxes from one around all vertices to the smallest, and the vertices in their order."""
    depth = min(DEEPEST, max(0, math.ceil(math.log(max(1.0, len(points) / IN_BOX), 4))))  # 4 children on a surface
    low, side = points.min(axis=0), float(np.ptp(points, axis=0).max()) or 1.0
    cell = np.minimum(((points - low) * (2**depth / side)).astype(np.int64), 2**depth - 1)
    code = np.zeros(len(points), np.int64)
    for bit in range(depth):
        for axis in range(3):
            code |= (cell[:, axis] >> bit & 1) << 3 * bit + axis
    order = np.argsort(code, kind="stable")
    points, code = points[order], code[order]
    distance = np.sqrt(_squares(points, middle))
    direction = (points - middle) / np.maximum(distance, np.finfo(np.float64).tiny)[:, None]
    starts = []
    for level in range(depth + 1):
        boxes = code >> 3 * (depth - level)
        starts.append(np.flatnonzero(np.concatenate([[True], boxes[1:] != boxes[:-1]])))
    levels = []
    for level, start in enumerate(starts):
        children = np.searchsorted(starts[level + 1], start) if level < depth else start
        child_count = len(starts[level + 1]) if level < depth else len(points)
        sums = np.add.reduceat(direction, start)
        axis = sums / np.maximum(np.sqrt(_lengths(sums)), np.finfo(np.float64).tiny)[:, None]
        chord = np.sqrt(_squares(direction, np.repeat(axis, np.diff(start, append=len(points)), axis=0)))
        levels.append(
            _BoxLevel(
                np.minimum.reduceat(points, start),
                np.maximum.reduceat(points, start),
                axis,
                _angle(np.maximum.reduceat(chord, start)),
                np.maximum.reduceat(distance, start),
                np.append(start, len(points)),
                np.append(children, child_count),
            )
        )
    return levels, points


def _products(starts: Indices, first: Indices, second: Indices) -> tuple[Indices, Indices]:
    """Return for pairs of boxes all pairs of an item of the one and an item of the other."""
    wide = starts[second + 1] - starts[second]
    count = (starts[first + 1] - starts[first]) * wide
    of_pair = np.repeat(np.arange(len(first)), count)
    within = np.arange(len(of_pair)) - np.repeat(np.cumsum(count) - count, count)
    row, column = np.divmod(within, wide[of_pair])
    return starts[first][of_pair] + row, starts[second][of_pair] + column


def _bounds(level: _BoxLevel, first: Indices, second: Indices) -> Doubles:
    """Return for pairs of boxes a square that no squared distance between their vertices exceeds."""
    far = np.maximum(level.high[first] - level.low[second], level.high[second] - level.low[first])
    from_middle, away = level.distance[first], level.distance[second]
    # By how much the vertices at least miss lying opposite each other.
    missed = _angle(np.sqrt(_lengths(level.axis[first] + level.axis[second])))
    missed = np.maximum(missed - level.spread[first] - level.spread[second] - ROUNDING, 0.0)
    opposite = (from_middle * from_middle + away * away + 2 * from_middle * away * np.cos(missed)) * (1 + ROUNDING)
    return np.where(missed < math.pi / 2, np.minimum(_lengths(far), opposite), _lengths(far))


def _angle(chord: Doubles) -> Doubles:
    """Return the angle between two unit vectors from the length of their difference."""
    return 2 * np.arcsin(np.minimum(chord / 2, 1.0))


def _compared(points: Doubles, level: _BoxLevel, first: Indices, second: Indices) -> float:
    """Return the largest squared distance between the vertices of pairs of boxes."""
    best = 0.0
    count = np.diff(level.first_vertex)
    pairs = np.cumsum(count[first] * count[second])
    cuts = np.searchsorted(pairs, np.arange(0, int(pairs.max(initial=0)), MOST_COMPARED)).tolist()
    for start, end in pairwise([*cuts, len(first)]):
        if start < end:
            of_first, of_second = _products(level.first_vertex, first[start:end], second[start:end])
            best = max(best, float(_squares(points[of_first], points[of_second]).max()))
    return best


def _swept(points: Doubles) -> tuple[float, Doubles]:
    """Return the squared distance of two vertices far apart, and the point between them."""
    best, middle, at = 0.0, points[0], points[0]
    for _ in range(SWEEPS):
        squares = _squares(points, at)
        farthest = points[int(squares.argmax())]
        if squares.max() > best:
            best, middle = float(squares.max()), (at + farthest) / 2
        at = farthest
    return best, middle


def _squares(points: Doubles, targets: Doubles) -> Doubles:
    return _lengths(points - targets)


def _lengths(vectors: Doubles) -> Doubles:
    """Return squared lengths, always summed in the same order."""
    x, y, z = vectors.T
    return (x * x + y * y) + z * z
