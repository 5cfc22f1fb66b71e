# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the cavities of a hollow.

A cavity is a connected group of cubes whose middles are inside. Two that are connected only by a passage narrower than
a cube count as two; powder or resin would not come out through it either.

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

LEAST_SIDE = 0.1  # Do not divide cubes into cubes smaller than this share of the wall.
MOST_CUBES = 50000  # Do not divide more cubes than this.
COUNTED = 8  # Count cavities of at least this many cubes; smaller ones may be noise.
NEIGHBORS = [(x, y, z) for x in (0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) > (0, 0, 0)]


@dataclass(frozen=True)
class Cavities:
    """Cavities of a hollow.

    Parameters
    ----------
    points : (3, n) float64
        Middles of the cubes in the largest cavity, sorted by position.
    side : float
        Side of the cubes, mm.
    further : int
        Number of further cavities.
    """

    points: Doubles
    side: float
    further: int


def cavities_steps(depth: Depth, wall: float, low: Doubles, high: Doubles) -> Steps[Cavities]:
    """Find the cavities in a box, where the depth is above the thickness of the wall; the result may be empty."""
    cubes = Cubes.over(low, high)
    inside = np.zeros(cubes.at.shape[1], np.bool_)  # The whole cube is inside.
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
    """Return the largest connected group of cubes."""
    at = members.at[:, np.lexsort(members.at[::-1])]
    if not at.shape[1]:
        return Cavities(np.empty((3, 0)), members.side, 0)
    size = at.max(axis=1) + 3  # One cube free on both sides.
    flat = _flat(at + 1, size)
    own = np.arange(len(flat))
    links = [np.stack([own, own], axis=1)]
    for offset in NEIGHBORS:
        neighbor = _flat(at + 1 + np.array(offset)[:, None], size)
        place = np.minimum(np.searchsorted(flat, neighbor), len(flat) - 1)
        met = flat[place] == neighbor
        links.append(np.stack([own[met], place[met]], axis=1))
        yield PAUSE
    rows = np.concatenate(links).astype(np.int32)
    component = (yield from component_numbers_steps(rows, len(flat)))[: len(flat)]
    counts = np.bincount(component)
    largest = int(counts.argmax())
    further = int((counts >= COUNTED).sum()) - int(counts[largest] >= COUNTED)
    kept = Cubes(members.origin, members.side, at[:, component == largest])
    return Cavities(kept.points(), members.side, further)


def _flat(at: Indices, size: Indices) -> Indices:
    return (at[0] * size[1] + at[1]) * size[2] + at[2]
