"""How good a triangle mesh is: how rough, how well shaped its triangles, and where to measure it.

Positions in any one space; lengths in its unit, angles in degrees.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError
from .triangle_mesh import TriangleMesh, face_vectors

SAMPLES = 20_000  # points on each of two surfaces that are compared
SEED = 0


def roughness(mesh: TriangleMesh) -> float:
    """Mean angle between neighbouring triangles, degrees.

    Over all edges with two triangles, each edge counted once; triangles without area have no direction and
    are left out. A flat surface has 0, a cube of two triangles a side 60 (twelve edges of 90, six of 0).

    Examples
    --------
    >>> corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 1]], np.float32)
    >>> round(roughness(TriangleMesh(corners, np.array([[0, 1, 2], [1, 0, 3]], np.int32))), 6)
    90.0
    """
    one, other = neighbours(mesh)
    normals = face_vectors(mesh.vertices, mesh.faces)
    flat = (normals**2).sum(axis=1) == 0
    kept = ~(flat[one] | flat[other])
    first, second = normals[one[kept]], normals[other[kept]]  # (n, 3)
    if not len(first):
        return 0.0
    # The arc tangent keeps small angles, which the arc cosine would round away.
    sine = np.sqrt((np.cross(first, second) ** 2).sum(axis=1))
    return float(np.degrees(np.arctan2(sine, (first * second).sum(axis=1))).mean())


def neighbours(mesh: TriangleMesh) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The two faces at every edge that has two, (n,) each."""
    start, end = mesh.faces.ravel().astype(np.int64), mesh.faces[:, (1, 2, 0)].ravel()
    keys = np.minimum(start, end) * len(mesh.vertices) + np.maximum(start, end)  # (3 F,)
    order = np.argsort(keys, kind="stable")
    _, first, count = np.unique(keys[order], return_index=True, return_counts=True)
    first = first[count == 2]
    return order[first] // 3, order[first + 1] // 3


def triangle_shapes(mesh: TriangleMesh) -> NDArray[np.float64]:
    """How near every triangle is to an equilateral one, (F,): 1 is equilateral, 0 has no area.

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


def surface_samples(mesh: TriangleMesh, count: int = SAMPLES, seed: int = SEED) -> NDArray[np.float64]:
    """Points spread over the surface evenly by area, (count, 3) float64.

    The area is cut into `count` equal shares, and each share gets one point at random: the same for the same
    seed, and with no share missed.

    Raises
    ------
    MeshError
        For a surface without area.
    """
    vectors = face_vectors(mesh.vertices, mesh.faces)
    below = np.cumsum(np.sqrt((vectors**2).sum(axis=1)))
    if not len(below) or below[-1] == 0:
        raise MeshError("a surface without area has no points to measure at; lower the threshold or reduction")
    chance = np.random.default_rng(seed).random((3, count))
    place = (np.arange(count) + chance[0]) * (below[-1] / count)
    face = np.minimum(np.searchsorted(below, place, side="right"), len(below) - 1)
    a, b, c = (mesh.vertices[mesh.faces[face, corner]].astype(np.float64) for corner in range(3))
    # Uniform in a triangle: the root keeps points from crowding at the corner a (Osada et al. 2002, eq. 1).
    root, along = np.sqrt(chance[1])[:, None], chance[2][:, None]
    return (1.0 - root) * a + root * ((1.0 - along) * b + along * c)
