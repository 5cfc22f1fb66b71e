# SPDX-License-Identifier: GPL-3.0-or-later
"""Replace a surface by a few triangles that look like it, for small pictures and not for measurements.

Vertices in the same cube of a grid become one: Rossignac and Borrel 1993, doi:10.1007/978-3-642-78114-8_29. The result
may touch itself.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..progress import Step, Steps
from .face_normals import vertex_normals
from .triangle_mesh import TriangleMesh
from .vectors import cross, dot

GROWTH = 1.1  # A cube's side grows at least this many times from one try to the next.
PIECE = 1 << 16  # A piece has at most this many triangles.
DIRECTIONS = 6  # Both directions along each axis.
FACES_PER_CUBE = 2.4  # A smooth surface has two, a noisy one more.
TRIES = 3  # Try at most this many sides to meet a goal.
CLOSE = 0.1  # A goal is met within this share.
MOST_SIDE = 1 << 20  # An axis has at most this many cubes, so that three indices fit into 64 bits.


def coarse_mesh(mesh: TriangleMesh, most_faces: int) -> TriangleMesh:
    """Return a mesh of at most `most_faces` triangles that looks the same from afar; the mesh itself if it has no more.

    Parameters
    ----------
    mesh : TriangleMesh
    most_faces : int
        1 or more. Fewer than a dozen may leave none; the mesh is returned then.

    Examples
    --------
    >>> axis = np.arange(11, dtype=np.float32)
    >>> x, y = (side.ravel() for side in np.meshgrid(axis, axis))
    >>> first = (np.arange(10) + 11 * np.arange(10)[:, None]).reshape(-1, 1)
    >>> faces = np.concatenate([first + [0, 1, 12], first + [0, 12, 11]]).astype(np.int32)
    >>> plane = TriangleMesh(np.stack([x, y, 0 * x], 1), faces)
    >>> len(plane.faces), len(coarse_mesh(plane, 60).faces) <= 60
    (200, True)
    """
    if len(mesh.faces) <= most_faces:
        return mesh
    columns = np.ascontiguousarray(mesh.vertices.T, np.float64)  # (3, v)
    start = columns.min(axis=1)
    extent = float((columns.max(axis=1) - start).max())
    side = max(math.sqrt(2.0 * _area(columns, mesh.faces) / most_faces), extent / MOST_SIDE)
    while extent > 0 and side <= extent:
        number, count = _numbered(_cubes(columns, start, side))
        faces = np.concatenate([_moved(number, mesh.faces[at]) for at in _pieces(len(mesh.faces))])
        if len(faces) <= most_faces:
            break
        side *= max(GROWTH, math.sqrt(len(faces) / most_faces))
    else:
        return mesh
    if not len(faces):
        return mesh
    weight = np.bincount(number, minlength=count)
    vertices = np.stack([np.bincount(number, row, count) / weight for row in columns], axis=1)
    normals = None if mesh.normals is None else _mean_normals(mesh.normals, number, count)
    return TriangleMesh(vertices.astype(np.float32), faces, normals)


def light_faces_steps(
    vertices: NDArray[np.float32], faces: NDArray[np.int32], goal: int, normals: NDArray[np.float32] | None = None
) -> Steps[tuple[NDArray[np.int64], NDArray[np.int32]]]:
    """Choose about `goal` of a surface's triangles that look like all of them once their corners are moved.

    As `coarse_mesh`, but the vertices of a cube move to the one nearest to their mean, so that the result follows the
    surface wherever its vertices go; and those whose normals have different main directions stay apart, so that the
    two sides of a thin plate do.

    Parameters
    ----------
    vertices : (V, 3) float32
    faces : (F, 3) int32
    goal : int
    normals : (V, 3) float32, optional
        By default those of the faces.

    Returns
    -------
    kept : (n,) int64
        Numbers of triangles, in order.
    target : (V,) int32
        The vertex that each vertex moves to.
    """
    if normals is None:
        normals = vertex_normals(vertices, faces)
    axis, most = np.zeros(len(vertices), np.int8), normals[:, 0]
    for next_axis in (1, 2):
        is_more = np.abs(normals[:, next_axis]) > np.abs(most)
        axis[is_more], most = next_axis, np.where(is_more, normals[:, next_axis], most)
    direction = 2 * axis + (most < 0)
    columns = np.ascontiguousarray(vertices.T, np.float64)  # (3, V)
    start = columns.min(axis=1)
    extent = float((columns.max(axis=1) - start).max())
    goal_count = goal / FACES_PER_CUBE
    least = max(extent / MOST_SIDE, float(np.finfo(np.float32).tiny))
    side, number, count = math.sqrt(_area(columns, faces) / goal_count), np.zeros(0, np.int64), 0
    for attempt in range(TRIES):
        yield Step(0.1 + 0.3 * attempt, "Making the light display")
        side = max(side, least)
        number, count = _numbered(DIRECTIONS * _cubes(columns, start, side) + direction)
        if abs(count - goal_count) < CLOSE * goal_count:
            break
        side *= math.sqrt(count / goal_count)
    yield Step(0.7, "Making the light display")
    weight = np.bincount(number, minlength=count)
    away = np.zeros(len(vertices))
    for column in columns:
        away += (column - (np.bincount(number, column, count) / weight)[number]) ** 2
    order = np.argsort(number, kind="stable")
    first = np.concatenate([[0], np.cumsum(weight)[:-1]])
    closest = np.minimum.reduceat(away[order], first)
    nearest = order[away[order] == closest[number[order]]][::-1]
    middle = np.empty(count, np.int32)
    middle[number[nearest]] = nearest  # The last to be written is the first vertex.
    yield Step(0.9, "Making the light display")
    corners = number.astype(np.int32)[faces]  # (F, 3)
    a, b, c = corners.T
    whole = np.flatnonzero((a != b) & (b != c) & (c != a))
    a, b, c = np.sort(corners[whole], axis=1).T
    order = np.lexsort((c, b, a))
    is_first = np.ones(len(order), bool)
    is_first[1:] = np.any([row[order][1:] != row[order][:-1] for row in (a, b, c)], axis=0)
    return np.sort(whole[order[is_first]]), middle[number]


def _cubes(columns: NDArray[np.float64], start: NDArray[np.float64], side: float) -> NDArray[np.int64]:
    """Return the number of the cube in which each vertex lies, (V,)."""
    key = np.zeros(columns.shape[1], np.int64)
    for column, first in zip(columns, start, strict=True):
        key *= MOST_SIDE
        key += np.floor((column - first) / side).astype(np.int64)
    return key


def _pieces(count: int) -> list[slice]:
    """Return slices of `PIECE` triangles at most: all at once would take more memory than the mesh."""
    return [slice(at, at + PIECE) for at in range(0, count, PIECE)]


def _moved(number: NDArray[np.int64], faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the triangles between cubes, (f, 3), without those that lie in fewer than three."""
    moved = np.take(number, faces).astype(np.int32)
    a, b, c = moved.T
    return moved[(a != b) & (b != c) & (c != a)]


def _numbered(key: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Return the number of every key among the different ones, and how many those are."""
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    first = np.ones(len(key), bool)
    np.not_equal(ordered[1:], ordered[:-1], out=first[1:])
    number = np.empty(len(key), np.int64)
    number[order] = np.cumsum(first) - 1
    return number, int(np.count_nonzero(first))


def _area(columns: NDArray[np.float64], faces: NDArray[np.int32]) -> float:
    area = 0.0
    for at in _pieces(len(faces)):
        a, b, c = (columns[:, corner] for corner in faces[at].T)  # (3, f) each
        twice = cross(b - a, c - a)
        area += float(np.sqrt(dot(twice, twice)).sum()) / 2
    return area


def _mean_normals(normals: NDArray[np.float32], number: NDArray[np.int64], count: int) -> NDArray[np.float32]:
    """Return the unit normal of every cube."""
    sums = np.stack([np.bincount(number, row, count) for row in normals.T.astype(np.float64)])  # (3, n)
    length = np.sqrt(dot(sums, sums))
    return np.ascontiguousarray((sums / np.where(length > 0, length, 1.0)).T.astype(np.float32))
