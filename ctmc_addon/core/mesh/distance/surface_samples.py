# SPDX-License-Identifier: GPL-3.0-or-later
"""Sample a surface for balls that touch it: at its vertices, and inside large triangles."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ...arrays import Doubles, Floats, Indices
from ...progress import PAUSE, Steps
from ..face_normals import face_vectors, sphere_normals_steps
from ..topology import FACES_PER_STEP
from ..triangle_mesh import TriangleMesh
from ..vectors import dot
from .patch_tree import PatchTree

MOST_SPLITS = 64  # Divide an edge into at most this many parts.


class SurfaceSamples(NamedTuple):
    """Samples of a surface.

    Parameters
    ----------
    tree : PatchTree
        Its `order` numbers the samples: the vertices first.
    gap : float
        Usual distance of neighbors, in the unit of the mesh.
    areas : (n,) float64
        Share of each sample in the area; they add up to it.
    """

    tree: PatchTree
    gap: float
    areas: Doubles

    @property
    def places(self) -> Indices:
        """One place in the tree of every sample, (n,) int64; further places repeat a sample."""
        places = np.empty(len(self.areas), np.int64)
        places[self.tree.order[::-1]] = np.arange(len(self.tree.order))[::-1]  # The first place is written last.
        return places


def surface_samples_steps(
    mesh: TriangleMesh, longest: float, normals: Floats | None = None, side: int = 1
) -> Steps[SurfaceSamples]:
    """Sample a surface.

    Parameters
    ----------
    mesh : TriangleMesh
    longest : float
        Triangles with a longer edge have samples of their own, about so far apart.
    normals : (V, 3) float32, optional
        At the vertices; by default those of the triangles.
    side : int
        1 for normals of the tree that point outside, -1 for the inside.
    """
    if normals is None:
        normals = yield from sphere_normals_steps(mesh.vertices, mesh.faces)
    positions, directions, area = [mesh.vertices], [normals], 0.0
    of_vertices, of_middles = np.zeros(len(mesh.vertices)), [np.zeros(0)]
    for start in range(0, len(mesh.faces), FACES_PER_STEP):
        faces = mesh.faces[start : start + FACES_PER_STEP]
        vectors = face_vectors(mesh.vertices, faces)
        lengths = np.sqrt(vectors[:, 0] ** 2 + vectors[:, 1] ** 2 + vectors[:, 2] ** 2)
        area += float(np.cumsum(lengths)[-1]) / 2  # cumsum adds one after the other: the same bits everywhere
        corners = [mesh.vertices[faces[:, corner]].T.astype(np.float64) for corner in range(3)]
        edges = [corners[(corner + 1) % 3] - corners[corner] for corner in range(3)]
        most = np.sqrt(
            np.maximum(np.maximum(dot(edges[0], edges[0]), dot(edges[1], edges[1])), dot(edges[2], edges[2]))
        )
        splits = np.minimum(np.ceil(most / longest), MOST_SPLITS).astype(np.int64)
        splits[lengths == 0] = 1
        third = np.where(splits > 1, 0.0, lengths / 6)
        for corner in range(3):
            of_vertices += np.bincount(faces[:, corner], third, len(of_vertices))
        for number in np.unique(splits[splits > 1]).tolist():
            of = np.flatnonzero(splits == number)
            a, b, c = (corner[:, of] for corner in corners)
            normal = (vectors[of] / lengths[of, None]).astype(np.float32)
            for u, v in _middles_of_splits(number):
                positions.append((a + (b - a) * u + (c - a) * v).T.astype(np.float32))
                directions.append(normal)
                of_middles.append(lengths[of] / (2 * number * number))
        yield PAUSE
    samples = np.concatenate(positions)
    tree = PatchTree()
    yield from tree.prepare_steps(samples, np.concatenate(directions) * np.float32(side))
    return SurfaceSamples(tree, math.sqrt(area / len(samples)), np.concatenate([of_vertices, *of_middles]))


def _middles_of_splits(number: int) -> Iterator[tuple[float, float]]:
    """Yield the middles of the triangles that a triangle is cut into at `number` parts of its edges, as shares."""
    for i in range(number):
        for j in range(number - i):
            yield (i + 1 / 3) / number, (j + 1 / 3) / number
            if i + j < number - 1:
                yield (i + 2 / 3) / number, (j + 2 / 3) / number
