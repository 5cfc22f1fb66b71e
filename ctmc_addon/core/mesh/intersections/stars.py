# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertices whose triangles cannot meet each other but at common edges and the vertex: proved for most at once.

Seen along one direction, all triangles round such a vertex run counter-clockwise, and they go round it once. So no two
of them hide each other, and none can cross another. What this does not prove is left to the exact test.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...progress import PAUSE, Steps
from ..vectors import cross, dot

Doubles = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int32]

LEAST = 1e-6  # sine between a triangle and the direction, at least: far above what rounding does


def flat_stars_steps(columns: Doubles, faces: Ints, normals: Doubles, errors: Doubles) -> Steps[Flags]:
    """Which vertices are proved so, (V,) bool.

    Parameters
    ----------
    columns : (3, V) float64
    faces : (3, F) int32
    normals : (3, F) float64
        As long as twice the area of each triangle.
    errors : (F,) float64
        By how much their products with a unit vector may be wrong.
    """
    vertex_count = columns.shape[1]
    least = LEAST * np.sqrt(dot(normals, normals)) + errors
    direction = np.zeros((3, vertex_count))
    for total, along in zip(direction, normals, strict=True):
        for corner in faces:
            total += np.bincount(corner, along, vertex_count)
    yield PAUSE
    size = np.sqrt(dot(direction, direction))
    proved = size > 0
    direction /= np.where(proved, size, 1.0)
    # Any direction across it: the cross product with the axis that it is farthest from.
    across = cross(direction, np.eye(3)[:, np.argmin(np.abs(direction), axis=0)])
    yield PAUSE
    rounds = np.zeros(vertex_count, np.int64)  # how often the triangles pass one ray
    for start in range(3):
        vertex, after, before = faces[start], faces[start - 2], faces[start - 1]
        seen = dot(np.take(direction, vertex, axis=1), normals)
        bad = seen <= least
        proved[vertex[bad]] = False
        ray, place = np.take(across, vertex, axis=1), np.take(columns, vertex, axis=1)
        height = [dot(ray, np.take(columns, end, axis=1) - place) for end in (after, before)]
        rounds += np.bincount(vertex[(height[0] <= 0) & (height[1] > 0)], minlength=vertex_count)
        yield PAUSE
    proved[(yield from _open_ends_steps(faces, vertex_count))] = False
    return proved & (rounds == 1)


def _open_ends_steps(faces: Ints, vertex_count: int) -> Steps[NDArray[np.int64]]:
    """Ends of the edges that do not have as many triangles one way as the other."""
    edges = np.empty((3, faces.shape[1]), np.int64)
    for start, keys in enumerate(edges):
        first, second = faces[start - 1], faces[start]
        np.multiply(np.minimum(first, second), np.int64(2 * vertex_count), out=keys)
        keys += 2 * np.maximum(first, second)
        keys += first < second
        yield PAUSE
    keys = np.sort(edges, axis=None)
    yield PAUSE
    if len(keys) % 2 == 0 and ((keys[::2] ^ 1) == keys[1::2]).all() and not (keys[::2] & 1).any():
        return np.zeros(0, np.int64)
    edge = keys >> 1
    starts = np.flatnonzero(np.concatenate([[True], edge[1:] != edge[:-1]]))
    count = np.diff(starts, append=len(edge))
    open_edges = edge[starts[2 * np.add.reduceat(keys & 1, starts) != count]]
    yield PAUSE
    return np.concatenate(np.divmod(open_edges, vertex_count))
