# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a hollow has its cavities, and how thick its wall may be, by cubes that are parted again and again.

The depth changes by no more than the way between two points, so cubes that are nowhere deep enough are dropped early.
Cavities are told apart by the cubes whose middles are inside: two that are connected only by a passage narrower than
such a cube count as two, through which no powder or resin would come out either.

Distances are in mm, positive inside; points are (3, n) float64, RAS+ mm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays import Doubles, Flags, Indices
from ..mesh.topology import component_numbers_steps
from ..progress import PAUSE, Steps
from .depth import Depth

FIRST_CUBES = 8  # Along the longest side of the box.
HALF_DIAGONAL = 0.8661
MOST_CUBES = 50000  # Part no more of them.
LEAST_SIDE_MM = 0.2
CLOSE_MM = 0.01  # The greatest depth is known to this, where few places are nearly as deep.
MOST_DEEP = 1024  # Part these at a time, the deepest.
COUNTED = 8  # Cubes of a cavity that is told of; smaller ones may be noise.
EIGHTHS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]).T  # (3, 8)
NEIGHBORS = [(x, y, z) for x in (0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) > (0, 0, 0)]


@dataclass(frozen=True)
class Cavities:
    """Cavities of a hollow.

    Parameters
    ----------
    points : (3, n) float64
        Middles of the cubes within the largest cavity, in the order of their position.
    side : float
        Of the cubes, mm.
    others : int
        Other cavities.
    """

    points: Doubles
    side: float
    others: int


def deepest_steps(depth: Depth, low: Doubles, high: Doubles) -> Steps[tuple[Doubles, float]]:
    """Return the deepest point in a box (3,) to (3,), as (3,), and its depth: the first of equals.

    The depth is right to `CLOSE_MM`, and never too large.
    """
    cubes = _Cubes.over(low, high)
    best, deepest = (low + high) / 2, -math.inf
    while True:
        points = cubes.points()
        here = yield from depth(points)
        top = int(here.argmax())
        if here[top] > deepest:
            best, deepest = points[:, top].copy(), float(here[top])
        near = np.flatnonzero(here + HALF_DIAGONAL * cubes.side > deepest + CLOSE_MM)
        if not len(near):
            return best, deepest
        order = np.argsort(-here[near], kind="stable")[:MOST_DEEP]
        cubes = cubes.kept(np.sort(near[order])).parted()


def cavities_steps(depth: Depth, wall: float, low: Doubles, high: Doubles) -> Steps[Cavities]:
    """Find the cavities in a box, where the depth is above the wall's thickness; perhaps no point is."""
    cubes = _Cubes.over(low, high)
    inside = np.zeros(cubes.at.shape[1], np.bool_)  # cubes all of which are
    while True:
        open_cubes = np.flatnonzero(~inside)
        here = np.full(len(inside), np.inf)
        here[open_cubes] = (yield from depth(cubes.points(open_cubes))) - wall
        reach = HALF_DIAGONAL * cubes.side
        near = np.flatnonzero(here > -reach)
        done = len(near) > MOST_CUBES or cubes.side / 2 < LEAST_SIDE_MM
        if done or not len(near):
            members = cubes.kept(np.flatnonzero(here > 0))
            return (yield from _largest_steps(members))
        cubes, inside = cubes.kept(near).parted(), (here[near] > reach).repeat(8)


def _largest_steps(members: _Cubes) -> Steps[Cavities]:
    """Return the largest of the connected groups of cubes."""
    at = members.at[:, np.lexsort(members.at[::-1])]
    if not at.shape[1]:
        return Cavities(np.empty((3, 0)), members.side, 0)
    size = at.max(axis=1) + 3  # free on both sides
    flat = _flat(at + 1, size)
    own = np.arange(len(flat))
    links = [np.stack([own, own], axis=1)]
    for offset in NEIGHBORS:
        other = _flat(at + 1 + np.array(offset)[:, None], size)
        place = np.minimum(np.searchsorted(flat, other), len(flat) - 1)
        met = flat[place] == other
        links.append(np.stack([own[met], place[met]], axis=1))
        yield PAUSE
    rows = np.concatenate(links).astype(np.int32)
    component = (yield from component_numbers_steps(rows, len(flat)))[: len(flat)]
    counts = np.bincount(component)
    largest = int(counts.argmax())
    others = int((counts >= COUNTED).sum()) - int(counts[largest] >= COUNTED)
    kept = _Cubes(members.origin, members.side, at[:, component == largest])
    return Cavities(kept.points(), members.side, others)


@dataclass(frozen=True)
class _Cubes:
    """Cubes of one grid: from where it begins, their side, and their numbers along x, y and z, (3, n)."""

    origin: Doubles
    side: float
    at: Indices

    @classmethod
    def over(cls, low: Doubles, high: Doubles) -> _Cubes:
        spans = high - low
        side = max(float(spans.max()) / FIRST_CUBES, LEAST_SIDE_MM)
        counts = [max(1, math.ceil(span / side)) for span in spans.tolist()]
        origin = (low + high) / 2 - np.array(counts) * (side / 2)
        return cls(origin, side, np.stack([each.ravel() for each in np.indices(counts)]))

    def points(self, numbers: NDArray[np.intp] | slice = slice(None)) -> Doubles:
        """Return the middles of cubes, (3, n)."""
        return self.origin[:, None] + (self.at[:, numbers] + 0.5) * self.side

    def kept(self, which: NDArray[np.intp] | Flags) -> _Cubes:
        return _Cubes(self.origin, self.side, self.at[:, which])

    def parted(self) -> _Cubes:
        """Return eight cubes for each."""
        at = (2 * self.at[:, :, None] + EIGHTHS[:, None]).reshape(3, -1)
        return _Cubes(self.origin, self.side / 2, at)


def _flat(at: Indices, size: Indices) -> Indices:
    return (at[0] * size[1] + at[1]) * size[2] + at[2]
