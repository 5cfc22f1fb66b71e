# SPDX-License-Identifier: GPL-3.0-or-later
"""Decide exactly whether two triangles have a common point besides a common vertex or edge.

Positions are columns: a corner is (3, n) float64 that hold float32 values, a triangle three of them. No triangle may
be without area.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags
from ..vectors import cross, dot
from .orientation import EPSILON, Doubles, sides, turns

Triangle = Sequence[Doubles]  # three corners


def triangles_meet(first: Triangle, second: Triangle) -> Flags:
    """Return whether triangles without a common vertex have a common point, (n,), so that an edge meets a triangle."""
    met = np.zeros(first[0].shape[1], bool)
    for edges, triangle in ((first, second), (second, first)):
        for start in range(3):
            left = np.flatnonzero(~met)
            edge = [_columns(edges[(start + end) % 3], left) for end in range(2)]
            met[left] = _edge_meets(edge[0], edge[1], [_columns(corner, left) for corner in triangle])
    return met


def surely_apart(first: Triangle, second: Triangle) -> Flags:
    """Whether a plane through an edge of one triangle, across that triangle, surely parts the two, (n,).

    In one plane this finds all that are farther apart than rounding.
    """
    apart = np.zeros(first[0].shape[1], bool)
    if not len(apart):
        return apart
    reach = max(float(np.abs(corner).max()) for corner in (*first, *second))
    for parting, opposite in ((first, second), (second, first)):
        normal = cross(parting[1] - parting[0], parting[2] - parting[0])
        for start in range(3):
            # Any direction works on which their projections are separated by more than the rounding.
            way = cross(parting[start] - parting[start - 1], normal)
            error = np.abs(way).max(axis=0)
            error *= 16 * EPSILON * reach
            inner, outer = ([dot(way, corner) for corner in corners] for corners in (parting, opposite))
            apart |= np.maximum.reduce(inner) + error < np.minimum.reduce(outer) - error
    return apart


def triangles_at_vertex_meet(first: Triangle, second: Triangle) -> Flags:
    """Return whether triangles that have corner 0 in common have another common point, (n,).

    What they have in common is convex and reaches from the vertex to an edge on the other side of one of them.
    """
    met = _edge_meets(first[1], first[2], second)
    left = np.flatnonzero(~met)
    met[left] = _edge_meets(
        _columns(second[1], left), _columns(second[2], left), [_columns(corner, left) for corner in first]
    )
    return met


def triangles_at_edge_meet(start: Doubles, end: Doubles, first: Doubles, second: Doubles) -> Flags:
    """Return whether triangles with a common edge and third corners `first`, `second` overlap in one plane, (n,)."""
    met = sides(start, end, first, second) == 0
    at = np.flatnonzero(met)
    flat = [_columns(point, at) for point in (start, end, first, second)]
    kept = _projected(flat[:3], flat)
    met[at] = turns(kept[0], kept[1], kept[2]) == turns(kept[0], kept[1], kept[3])
    return met


def have_no_area(corners: Triangle) -> Flags:
    """Return whether the corners of a triangle are on one line, (n,)."""
    out = np.ones(corners[0].shape[1], bool)
    for axes in ([0, 1], [1, 2], [2, 0]):
        a, b, c = (corner[axes] for corner in corners)
        out &= turns(a, b, c) == 0
    return out


def _columns(points: Doubles, at: NDArray[np.int64]) -> Doubles:
    return np.take(points, at, axis=1)


def _edge_meets(p: Doubles, q: Doubles, triangle: Triangle) -> Flags:
    """Return whether the edge pq and the triangle, both with their ends, have a common point, (n,)."""
    a, b, c = triangle
    above, below = sides(a, b, c, p), sides(a, b, c, q)
    flat = (above == 0) & (below == 0)
    met = (above * below <= 0) & ~flat
    at = np.flatnonzero(met)
    p_at, q_at, *corners = (_columns(point, at) for point in (p, q, a, b, c))
    around = [sides(p_at, q_at, corners[start], corners[start - 2]) for start in range(3)]
    met[at] = (np.minimum.reduce(around) >= 0) | (np.maximum.reduce(around) <= 0)
    at = np.flatnonzero(flat)
    if len(at):
        points = [_columns(point, at) for point in (a, b, c, p, q)]
        met[at] = _flat_edge_meets(*_projected(points[:3], points))
    return met


def _projected(triangle: Triangle, points: Sequence[Doubles]) -> list[Doubles]:
    """Return the points, (2, n), without an axis along which the triangle keeps an area."""
    axis = np.full(points[0].shape[1], -1)
    for left_out in range(3):
        axes = [left_out - 2, left_out - 1]
        a, b, c = (corner[axes] for corner in triangle)
        axis[(axis < 0) & (turns(a, b, c) != 0)] = left_out
    column = np.arange(len(axis))
    return [np.stack([point[axis - 2, column], point[axis - 1, column]]) for point in points]


def _flat_edge_meets(a: Doubles, b: Doubles, c: Doubles, p: Doubles, q: Doubles) -> Flags:
    """`_edge_meets` in a plane: an end is in the triangle, or the edge meets one of its edges."""
    met = _is_inside(p, a, b, c) | _is_inside(q, a, b, c)
    for start, end in ((a, b), (b, c), (c, a)):
        met |= _segments_meet(p, q, start, end)
    return met


def _is_inside(point: Doubles, a: Doubles, b: Doubles, c: Doubles) -> Flags:
    around = [turns(start, end, point) for start, end in ((a, b), (b, c), (c, a))]
    return (np.minimum.reduce(around) >= 0) | (np.maximum.reduce(around) <= 0)


def _segments_meet(p: Doubles, q: Doubles, a: Doubles, b: Doubles) -> Flags:
    """Return whether two segments in the plane, with their ends, have a common point, (n,)."""
    across_pq = turns(p, q, a) * turns(p, q, b) <= 0
    across_ab = turns(a, b, p) * turns(a, b, q) <= 0
    # On one line they meet where their boxes do; elsewhere these meet too.
    boxes = (np.minimum(p, q) <= np.maximum(a, b)) & (np.minimum(a, b) <= np.maximum(p, q))
    return across_pq & across_ab & boxes.all(axis=0)
