# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute normals of faces, and average them to vertices."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..progress import PAUSE, Steps, finish
from .topology import FACES_PER_STEP

SHORT = 0.1  # The least squared length of an edge, in twice the mean area of a face.


def face_vectors(vertices: NDArray[Any], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """Twice the area times the outward unit normal of every face, (F, 3) float64."""
    flat = np.ascontiguousarray(vertices).reshape(-1)  # taken coordinate by coordinate, in half the time of points
    firsts = (3 * faces[:, corner].astype(np.intp) for corner in range(3))
    a, b, c = ([flat.take(first + axis).astype(np.float64) for axis in range(3)] for first in firsts)
    u, v = ([end - start for start, end in zip(a, corner, strict=True)] for corner in (b, c))
    out = np.empty((len(faces), 3))
    for axis in range(3):
        after, last = (axis + 1) % 3, (axis + 2) % 3
        np.subtract(u[after] * v[last], u[last] * v[after], out=out[:, axis])
    return out


def face_vectors_steps(vertices: NDArray[Any], faces: NDArray[np.int32]) -> Steps[NDArray[np.float64]]:
    """`face_vectors`, block by block."""
    vectors = np.empty((len(faces), 3))
    for start in range(0, len(faces), FACES_PER_STEP):
        block = slice(start, start + FACES_PER_STEP)
        vectors[block] = face_vectors(vertices, faces[block])
        yield PAUSE
    return vectors


def vertex_normals(vertices: NDArray[Any], faces: NDArray[np.int32]) -> NDArray[np.float32]:
    """Area-weighted mean of the normals of the faces at every vertex, (V, 3) float32, unit length."""
    return finish(vertex_normals_steps(vertices, faces))


def vertex_normals_steps(vertices: NDArray[Any], faces: NDArray[np.int32]) -> Steps[NDArray[np.float32]]:
    """Do what `vertex_normals` does, in steps."""
    vectors = yield from face_vectors_steps(vertices, faces)
    return (yield from _mean_normals_steps(len(vertices), faces, vectors, None))


def sphere_normals_steps(vertices: NDArray[Any], faces: NDArray[np.int32]) -> Steps[NDArray[np.float32]]:
    """Mean normals of the faces at every vertex, (V, 3) float32, exact on a sphere, as steps.

    A face counts by its area over the squared lengths of its two edges at the vertex (Max 1999, Weights for Computing
    Vertex Normals from Facet Normals, doi:10.1080/10867651.1999.10487501). Edges much shorter than usual count as
    longer ones, because thin triangles have poor normals.
    """
    vectors = yield from face_vectors_steps(vertices, faces)
    doubled = np.sqrt(vectors[:, 0] ** 2 + vectors[:, 1] ** 2 + vectors[:, 2] ** 2)
    shortest = SHORT * float(np.cumsum(doubled)[-1]) / max(1, len(faces)) if len(faces) else 0.0
    weights = np.empty((len(faces), 3))
    for start in range(0, len(faces), FACES_PER_STEP):
        block = slice(start, start + FACES_PER_STEP)
        corners = [vertices[faces[block, corner]].astype(np.float64) for corner in range(3)]
        squares = []
        for corner in range(3):
            edge = corners[(corner + 1) % 3] - corners[corner]
            squares.append(np.maximum(edge[:, 0] ** 2 + edge[:, 1] ** 2 + edge[:, 2] ** 2, shortest))
        for corner in range(3):
            product = squares[corner] * squares[corner - 1]
            weights[block, corner] = 1.0 / np.where(product > 0, product, np.inf)
        yield PAUSE
    return (yield from _mean_normals_steps(len(vertices), faces, vectors, weights))


def _mean_normals_steps(
    count: int, faces: NDArray[np.int32], vectors: NDArray[np.float64], weights: NDArray[np.float64] | None
) -> Steps[NDArray[np.float32]]:
    """Return the sums of vectors (F, 3) at vertices, weighted at each corner (F, 3), at unit length."""
    sums = np.empty((count, 3))
    corners = faces.ravel()
    for axis in range(3):
        yield PAUSE
        at_corners = np.repeat(vectors[:, axis], 3)
        if weights is not None:
            at_corners = at_corners * weights.ravel()
        # bincount adds in the order of the corners: the same bits everywhere.
        sums[:, axis] = np.bincount(corners, at_corners, count)
    length = np.sqrt(sums[:, 0] ** 2 + sums[:, 1] ** 2 + sums[:, 2] ** 2)
    length[length == 0] = 1.0
    return (sums / length[:, None]).astype(np.float32)
