"""Cut triangles in four, so that what is measured at vertices is measured inside large triangles too."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..progress import finish
from .topology import edges_steps
from .triangle_mesh import TriangleMesh

MOST_FACES = 400_000


def longest_edges(mesh: TriangleMesh) -> NDArray[np.float64]:
    """The longest edge of every triangle, (F,)."""
    corners = mesh.vertices[mesh.faces].astype(np.float64)  # (F, 3, 3)
    edges = corners - corners[:, (1, 2, 0)]
    return np.sqrt((edges**2).sum(axis=2)).max(axis=1)


def subdivided(mesh: TriangleMesh, length: float) -> TriangleMesh:
    """The same surface with all triangles cut in four until their longest edges are about `length` on average.

    Not beyond `MOST_FACES`, so that a picture of a large surface stays possible.
    """
    while longest_edges(mesh).mean() > 1.4 * length and 4 * len(mesh.faces) <= MOST_FACES:
        mesh = cut_in_four(mesh)
    return mesh


def cut_in_four(mesh: TriangleMesh) -> TriangleMesh:
    """Every triangle cut in four at the middles of its edges, normals interpolated."""
    edges, face_edges = finish(edges_steps(np.ascontiguousarray(mesh.faces.T), len(mesh.vertices)))
    low, high = edges
    vertices = np.concatenate([mesh.vertices, (mesh.vertices[low] + mesh.vertices[high]) * np.float32(0.5)])
    normals = mesh.normals
    if normals is not None:
        between = normals[low] + normals[high]
        length = np.sqrt((between**2).sum(axis=1, keepdims=True))
        normals = np.concatenate([normals, between / np.maximum(length, np.float32(1e-12))])
    a, b, c = mesh.faces.T
    ab, bc, ca = face_edges + len(mesh.vertices)
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    cut = np.stack([np.stack(quarter, axis=1) for quarter in quarters], axis=1).reshape(-1, 3)
    return TriangleMesh(vertices.astype(np.float32), cut.astype(np.int32), normals)
