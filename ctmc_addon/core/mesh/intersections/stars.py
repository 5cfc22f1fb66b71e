# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertices whose triangles cannot meet each other but at common edges and the vertex: proved for most at once.

Seen along one direction, all triangles round such a vertex run counter-clockwise, and they go round it once. So no two
of them hide or cross each other. Vertices without this proof are left to the exact test.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Doubles, Flags, Floats, Ints
from ...progress import PAUSE, Steps
from ..vectors import dot

LEAST = 1e-6  # The sine between a triangle and the direction is at least this: far above what rounding does.
STEEP = 0.9


def flat_stars_steps(
    corners: list[Floats], faces: Ints, vertex_count: int, normals: Doubles, errors: Doubles
) -> Steps[Flags]:
    """Return which vertices are proved to have a flat star of triangles, (V,) bool.

    Parameters
    ----------
    corners : three of (3, F) float32
        Positions.
    faces : (3, F) int32
    vertex_count : int
    normals : (3, F) float64
        As long as twice the area of each triangle.
    errors : (F,) float64
        Errors of their products with a unit vector, at most.
    """
    least = LEAST * np.sqrt(dot(normals, normals)) + errors
    direction = np.zeros((3, vertex_count))
    for total, along in zip(direction, normals, strict=True):
        for corner in faces:
            total += np.bincount(corner, along, vertex_count)
        yield PAUSE
    size = np.sqrt(dot(direction, direction))
    proved = size > 0
    rounded = (direction / np.where(proved, size, 1.0)).astype(np.float32)
    rounds = np.zeros(vertex_count, np.int64)  # how often the triangles pass one ray
    for start in range(3):
        vertex = faces[start]
        x, y, z = np.take(rounded, vertex, axis=1).astype(np.float64)
        seen = x * normals[0] + y * normals[1] + z * normals[2]
        proved[vertex[seen <= least]] = False
        # The ray is across the direction without rounding: (-y, x, 0), or (z, 0, -x) where that would be short.
        steep = np.abs(z) > STEEP
        yield PAUSE
        ray = np.where(steep, z, -y), np.where(steep, 0.0, x), np.where(steep, -x, 0.0)
        place = corners[start].astype(np.float64)
        after, before = (
            ray[0] * (end[0] - place[0]) + ray[1] * (end[1] - place[1]) + ray[2] * (end[2] - place[2])
            for end in (corners[start - 2], corners[start - 1])
        )
        rounds += np.bincount(vertex[(after <= 0) & (before > 0)], minlength=vertex_count)
        yield PAUSE
    proved[(yield from _open_ends_steps(faces, vertex_count))] = False
    return proved & (rounds == 1)


def _open_ends_steps(faces: Ints, vertex_count: int) -> Steps[Ints]:
    """Ends of the edges that do not have as many triangles one way as the other."""
    first, second = faces.ravel(), faces[[1, 2, 0]].ravel()
    rises = first < second
    rising, falling = np.flatnonzero(rises), np.flatnonzero(~rises)
    low, high = np.take(first, rising), np.take(second, rising)
    falling_low, falling_high = np.take(second, falling), np.take(first, falling)
    yield PAUSE
    ends = []
    higher = np.zeros(vertex_count, np.int32)  # of each vertex one edge that rises there: the others come next
    while len(low):
        higher[low] = high
        rises, falls = np.take(higher, low) == high, np.take(higher, falling_low) == falling_high
        times = np.bincount(low[rises], minlength=vertex_count)
        times -= np.bincount(falling_low[falls], minlength=vertex_count)
        unequal = np.flatnonzero(times).astype(np.int32)
        ends += [unequal, np.take(higher, unequal)]
        rising, falling = np.flatnonzero(~rises), np.flatnonzero(~falls)
        low, high = np.take(low, rising), np.take(high, rising)
        falling_low, falling_high = np.take(falling_low, falling), np.take(falling_high, falling)
        yield PAUSE
    return np.concatenate([*ends, falling_low, falling_high])
