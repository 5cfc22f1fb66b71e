# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut triangles in four, so that what is measured at vertices is measured inside large triangles too."""

from __future__ import annotations

import numpy as np

from ...progress import PAUSE, Steps
from ..topology import FACES_PER_STEP, edges_steps
from ..triangle_mesh import TriangleMesh

MOST_FACES = 400_000


def mean_longest_edge_steps(mesh: TriangleMesh) -> Steps[float]:
    """Mean of the longest edges of all triangles."""
    total = 0.0
    for start in range(0, len(mesh.faces), FACES_PER_STEP):
        corners = mesh.vertices[mesh.faces[start : start + FACES_PER_STEP]].astype(np.float64)  # (f, 3, 3)
        edges = corners - corners[:, (1, 2, 0)]
        total += float(np.sqrt((edges**2).sum(axis=2)).max(axis=1).sum())
        yield PAUSE
    return total / max(1, len(mesh.faces))


def subdivided_steps(mesh: TriangleMesh, length: float) -> Steps[TriangleMesh]:
    """Return the same surface with all triangles cut in four until their longest edges are about `length` on average.

    Not beyond `MOST_FACES`, so that a picture of a large surface stays possible.
    """
    while 4 * len(mesh.faces) <= MOST_FACES and (yield from mean_longest_edge_steps(mesh)) > 1.4 * length:
        mesh = yield from cut_in_four_steps(mesh)
    return mesh


def cut_in_four_steps(mesh: TriangleMesh) -> Steps[TriangleMesh]:
    """Return every triangle cut in four at the middles of its edges, normals interpolated."""
    edges, face_edges = yield from edges_steps(np.ascontiguousarray(mesh.faces.T), len(mesh.vertices))
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
