# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the nearest two points of two surfaces.

The least distance of a vertex to the other surface is a bound. Triangles whose vertices are so far that no point of
theirs can be nearer are left out; the rest are compared with the triangles of the other surface within the bound, by
vertices, edges, and whether an edge passes through. The bound falls on the way.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arrays import Doubles, Indices
from ...progress import PAUSE, Step, Steps
from ..topology import FACES_PER_STEP
from ..triangle_mesh import TriangleMesh
from ..vectors import dot
from .nearest_points import nearest_of_segments, nearest_points, pierced
from .signed_distance import SignedSurface

TRIANGLES_AT_ONCE = 256
PAIRS_AT_ONCE = 1 << 14
EXACT = 2.0**-34  # Distances are right to this share of the extent.

Point = tuple[float, float, float]


class _Pair(NamedTuple):
    """Two points and their distance."""

    distance: float
    first: Doubles
    second: Doubles


def nearest_pair_steps(
    mesh: TriangleMesh, target: SignedSurface, distances: Doubles, nearest: Indices
) -> Steps[tuple[Point, Point]]:
    """Return the nearest two points of two surfaces, that of `mesh` first; one point twice where they cross.

    Parameters
    ----------
    mesh : TriangleMesh
    target : SignedSurface
    distances, nearest : (V,) float64, (V,) int64
        Of the mesh's vertices, as `other.distances_steps` returns them.
    """
    away = np.abs(distances)
    used = np.zeros(len(away), bool)
    used[mesh.faces] = True
    best = int(np.argmin(np.where(used, away, np.inf)))
    start = mesh.vertices[best].astype(np.float64)
    foot = target.nearest_on(start[:, None], nearest[best : best + 1])[:, 0]
    pair = _Pair(float(away[best]), start, foot)
    if pair.distance > 0:
        pair = yield from _refined_steps(mesh, target, away, nearest, pair)
    return _point(pair.first), _point(pair.second)


def _refined_steps(
    mesh: TriangleMesh, target: SignedSurface, away: Doubles, nearest: Indices, pair: _Pair
) -> Steps[_Pair]:
    """Return a nearer pair of points on two triangles, if there is one."""
    tree = target.tree
    extent = float(np.abs(mesh.vertices).max()) + float(np.abs(target.mesh.vertices[target.mesh.faces[0]]).max())
    exact = extent * EXACT
    least, numbers = [np.empty(0)], [np.empty(0, np.int64)]
    for start in range(0, len(mesh.faces), FACES_PER_STEP):
        faces = mesh.faces[start : start + FACES_PER_STEP]
        corners = mesh.vertices[faces].astype(np.float64)
        sides = corners - corners[:, (1, 2, 0)]
        longest = np.sqrt((sides * sides).sum(axis=2).max(axis=1))
        # No point of a triangle is farther from its nearest corner than the longest side over the root of 3.
        lower = away[faces].min(axis=1) - longest / np.sqrt(3)
        near = np.flatnonzero(lower < pair.distance - exact)
        least.append(lower[near])
        numbers.append(near + start)
        yield PAUSE
    lower, number = np.concatenate(least), np.concatenate(numbers)
    order = np.argsort(lower, kind="stable")
    for start in range(0, len(order), TRIANGLES_AT_ONCE):
        block = order[start : start + TRIANGLES_AT_ONCE]
        if pair.distance <= exact or lower[block[0]] >= pair.distance - exact:
            break
        faces = mesh.faces[number[block]]
        columns = np.ascontiguousarray(mesh.vertices[faces].astype(np.float64).transpose(1, 2, 0))  # corner, axis, n
        middle = (columns[0] + columns[1] + columns[2]) / 3
        reach = np.sqrt(np.max([dot(corner - middle, corner - middle) for corner in columns], axis=0))
        closest = np.take_along_axis(faces, away[faces].argmin(axis=1)[:, None], axis=1)[:, 0]
        at = np.ascontiguousarray(mesh.vertices[closest].astype(np.float64).T)
        way = at - target.nearest_on(at, nearest[closest])
        length = np.sqrt(dot(way, way))
        way /= np.where(length > 0, length, 1)
        first, second = tree.within(middle, (pair.distance + reach) ** 2)
        for low in range(0, len(first), PAIRS_AT_ONCE):
            of_mesh, of_target = first[low : low + PAIRS_AT_ONCE], second[low : low + PAIRS_AT_ONCE]
            triangles = np.take(columns, of_mesh, axis=2), np.take(tree.corners, of_target, axis=2)
            # A gap along any way is a bound: here along the way to the nearest point of a corner.
            along = [[dot(np.take(way, of_mesh, axis=1), corner) for corner in corners] for corners in triangles]
            gap = np.min(along[0], axis=0) - np.max(along[1], axis=0)
            near = np.flatnonzero(gap < pair.distance - exact)
            if len(near):
                pair = _nearer(triangles[0][:, :, near], triangles[1][:, :, near], pair)
            yield Step(start / len(order))
    return pair


def _nearer(first: Doubles, second: Doubles, pair: _Pair) -> _Pair:
    """Return the nearest points of pairs of triangles (3, 3, n), corner, axis, pair; or those that are nearer."""
    for this, that, swapped in ((first, second, False), (second, first, True)):
        for corner in range(3):
            through, at = pierced(this[corner], this[(corner + 1) % 3], *that)
            if through.any():
                point = at[:, np.flatnonzero(through)[0]]
                return _Pair(0.0, point, point)
            foot, _ = nearest_points(this[corner], *that)
            pair = _least(pair, *((foot, this[corner]) if swapped else (this[corner], foot)))
    for at_first, at_second in np.ndindex(3, 3):
        ends = first[at_first], first[(at_first + 1) % 3], second[at_second], second[(at_second + 1) % 3]
        pair = _least(pair, *nearest_of_segments(*ends))
    return pair


def _least(pair: _Pair, first: Doubles, second: Doubles) -> _Pair:
    """Return the nearest of some pairs of points (3, n), if they are nearer than `pair`."""
    squared = dot(first - second, first - second)
    best = int(np.argmin(squared))
    distance = float(np.sqrt(squared[best]))
    return _Pair(distance, first[:, best], second[:, best]) if distance < pair.distance else pair


def _point(position: Doubles) -> Point:
    x, y, z = position.tolist()
    return x, y, z
