# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a hollow has its cavities.

Cavities are told apart by the cubes whose middles are inside: two that are connected only by a passage narrower than
such a cube count as two, through which no powder or resin would come out either.

Distances are in mm, positive inside; points are (3, n) float64, RAS+ mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import Doubles, Indices
from ...mesh.topology import component_numbers_steps
from ...progress import PAUSE, Steps
from ..fields.depth import Depth
from .cubes import HALF_DIAGONAL, Cubes

LEAST_SIDE = 0.1  # Of the wall.
MOST_CUBES = 50000  # Part no more of them.
COUNTED = 8  # Cubes of a cavity that is told of; smaller ones may be noise.
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


def cavities_steps(depth: Depth, wall: float, low: Doubles, high: Doubles) -> Steps[Cavities]:
    """Find the cavities in a box, where the depth is above the wall's thickness; perhaps no point is."""
    cubes = Cubes.over(low, high)
    inside = np.zeros(cubes.at.shape[1], np.bool_)  # cubes all of which are
    while True:
        open_cubes = np.flatnonzero(~inside)
        here = np.full(len(inside), np.inf)
        here[open_cubes] = (yield from depth(cubes.points(open_cubes))) - wall
        reach = HALF_DIAGONAL * cubes.side
        near = np.flatnonzero(here > -reach)
        done = len(near) > MOST_CUBES or cubes.side / 2 < LEAST_SIDE * wall
        if done or not len(near):
            members = cubes.kept(np.flatnonzero(here > 0))
            return (yield from _largest_steps(members))
        cubes, inside = cubes.kept(near).parted(), (here[near] > reach).repeat(8)


def _largest_steps(members: Cubes) -> Steps[Cavities]:
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
    kept = Cubes(members.origin, members.side, at[:, component == largest])
    return Cavities(kept.points(), members.side, others)


def _flat(at: Indices, size: Indices) -> Indices:
    return (at[0] * size[1] + at[1]) * size[2] + at[2]
