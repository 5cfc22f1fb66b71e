# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the quality of a triangle mesh: its roughness and the shape of its triangles; sample it for distances.

Positions in any one space; lengths in its unit, angles in degrees.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError
from ..progress import PAUSE, Steps, finish
from .face_normals import face_vectors, face_vectors_steps
from .topology import edges_steps
from .triangle_mesh import TriangleMesh

SAMPLES = 20_000  # The distance of two surfaces is measured at this many points of each.
SEED = 0


def roughness(mesh: TriangleMesh) -> float:
    """Mean angle between neighboring triangles, degrees.

    Over all edges with two triangles, each edge counted once; triangles without area have no direction and
    are left out. A flat surface has 0, a cube of two triangles a side 60 (twelve edges of 90, six of 0).

    Examples
    --------
    >>> corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 1]], np.float32)
    >>> round(roughness(TriangleMesh(corners, np.array([[0, 1, 2], [1, 0, 3]], np.int32))), 6)
    90.0
    """
    faces = neighbors(mesh)
    normals = face_vectors(mesh.vertices, mesh.faces)
    flat = (normals**2).sum(axis=1) == 0
    first, second = normals[faces[:, ~flat[faces].any(axis=0)]]  # (n, 3) each
    if not len(first):
        return 0.0
    # The arc tangent keeps small angles, which the arc cosine would round away.
    sine = np.sqrt((np.cross(first, second) ** 2).sum(axis=1))
    return float(np.degrees(np.arctan2(sine, (first * second).sum(axis=1))).mean())


def neighbors(mesh: TriangleMesh) -> NDArray[np.intp]:
    """The two faces at every edge that has two, (2, n)."""
    _, face_edges = finish(edges_steps(np.ascontiguousarray(mesh.faces.T), len(mesh.vertices)))
    edges = face_edges.ravel()
    order = np.argsort(edges, kind="stable")
    count = np.bincount(edges)
    first = (np.cumsum(count) - count)[count == 2]
    return order[np.stack([first, first + 1])] % len(mesh.faces)


def triangle_shapes(mesh: TriangleMesh) -> NDArray[np.float64]:
    """Return how near every triangle is to an equilateral one, (F,): 1 is equilateral, 0 has no area.

    ``4 sqrt(3) area / (sum of the squared sides)`` (Bank and Smith 1997, doi:10.1137/S0036142994265292).

    Examples
    --------
    >>> flat = TriangleMesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32))
    >>> triangle_shapes(flat).round(6)
    array([1.])
    """
    corners = mesh.vertices[mesh.faces].astype(np.float64)  # (F, 3, 3)
    squares = ((corners[:, (1, 2, 0)] - corners) ** 2).sum(axis=(1, 2))
    doubled = np.sqrt((face_vectors(mesh.vertices, mesh.faces) ** 2).sum(axis=1))  # twice the area
    return 2.0 * np.sqrt(3.0) * doubled / np.where(squares > 0, squares, 1.0)


def surface_samples_steps(mesh: TriangleMesh, count: int = SAMPLES, seed: int = SEED) -> Steps[NDArray[np.float64]]:
    """Points spread over the surface evenly by area, (count, 3) float64.

    The area is cut into `count` equal shares, and each share gets one point at random: the same for the same
    seed, and with no share missed.

    Raises
    ------
    MeshError
        If the surface has no area.
    """
    vectors = yield from face_vectors_steps(mesh.vertices, mesh.faces)
    below = np.cumsum(np.sqrt((vectors**2).sum(axis=1)))
    yield PAUSE
    if not len(below) or below[-1] == 0:
        raise MeshError("a surface without area has no points to measure at; lower the threshold or reduction")
    chance = np.random.default_rng(seed).random((3, count))
    area_position = (np.arange(count) + chance[0]) * (below[-1] / count)
    face = np.minimum(np.searchsorted(below, area_position, side="right"), len(below) - 1)
    a, b, c = (mesh.vertices[mesh.faces[face, corner]].astype(np.float64) for corner in range(3))
    # Uniform in a triangle: the root keeps points from crowding at the corner a (Osada et al. 2002, eq. 1).
    root, along = np.sqrt(chance[1])[:, None], chance[2][:, None]
    return (1.0 - root) * a + root * ((1.0 - along) * b + along * c)
