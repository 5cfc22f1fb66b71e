# SPDX-License-Identifier: GPL-3.0-or-later
"""The surfaces of labels that touch, as one complex: a triangle is stored once, with the two labels it separates.

`ComplexSurface` holds both ends of alpha, as `Surface` does for one label; `ComplexMesh` is the complex at one alpha.
A label's own surface is every triangle that borders it, turned outward. Neighbors have the same float32 positions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .face_normals import face_vectors
from .triangle_mesh import Surface, TriangleMesh, blend


class Neighbor(NamedTuple):
    """What a label's surface borders on: another label, or 0 for what has no label."""

    label: int
    triangles: int
    area_mm2: float


def neighbors_of(mesh: TriangleMesh, beyond: NDArray[np.int32]) -> tuple[Neighbor, ...]:
    """Return how much of a label's surface borders on each other label, 0 left out, in the order of their numbers.

    Parameters
    ----------
    mesh : TriangleMesh
        In mm.
    beyond : (F,) int32
        The label in front of each triangle.

    Examples
    --------
    >>> corners = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0], [2, 2, 0]], np.float32)
    >>> square = TriangleMesh(corners, np.array([[0, 1, 2], [1, 3, 2]], np.int32))
    >>> neighbors_of(square, np.array([0, 7], np.int32))
    (Neighbor(label=7, triangles=1, area_mm2=2.0),)
    """
    shared = np.flatnonzero(beyond)
    vectors = face_vectors(mesh.vertices, mesh.faces[shared])
    areas = np.sqrt(vectors[:, 0] ** 2 + vectors[:, 1] ** 2 + vectors[:, 2] ** 2) / 2
    labels, at, counts = np.unique(beyond[shared], return_inverse=True, return_counts=True)
    sums = np.bincount(at.ravel(), areas, len(labels))
    return tuple(Neighbor(*row) for row in zip(labels.tolist(), counts.tolist(), sums.tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class ComplexMesh:
    """Triangles over shared vertices, each between two labels.

    Parameters
    ----------
    vertices : (V, 3) float32
        Positions (x, y, z).
    faces : (F, 3) int32
        Vertex numbers; the normal (counter-clockwise) points out of ``sides[:, 0]`` into ``sides[:, 1]``.
    sides : (F, 2) int32
        The label behind a triangle and the one in front of it, never equal; 0 is what has no label.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    sides: NDArray[np.int32]

    @property
    def labels(self) -> tuple[int, ...]:
        """Every label that has a triangle, rising, without 0."""
        return tuple(int(label) for label in np.unique(self.sides) if label)

    def of_label(self, label: int) -> tuple[TriangleMesh, NDArray[np.int32]]:
        """Return a label's closed surface, turned outward, and the label in front of each triangle, (f,) int32."""
        faces, beyond, used = bordering(self.faces, self.sides, label, len(self.vertices))
        return TriangleMesh(self.vertices[used], faces), beyond


@dataclass(frozen=True, eq=False)
class ComplexSurface:
    """What extraction found: for every vertex both ends of alpha (Su and Ma, eq. 5 to 7).

    Parameters
    ----------
    midpoints, linear : (V, 3) float32
        Position at alpha 0 and at alpha 1.
    faces : (F, 3) int32
        As in `ComplexMesh`; the same for every alpha.
    sides : (F, 2) int32
        As in `ComplexMesh`.
    """

    midpoints: NDArray[np.float32]
    linear: NDArray[np.float32]
    faces: NDArray[np.int32]
    sides: NDArray[np.int32]

    def at(self, alpha: float) -> ComplexMesh:
        """The complex at `alpha`, in float32 in the order in which Blender mixes a shape key."""
        return ComplexMesh(blend(self.midpoints, self.linear, alpha), self.faces, self.sides)

    def of_label(self, label: int) -> tuple[Surface, NDArray[np.int32]]:
        """Return a label's surface at both ends of alpha, and the label in front of each triangle, (f,) int32."""
        faces, beyond, used = bordering(self.faces, self.sides, label, len(self.linear))
        return Surface(self.midpoints[used], self.linear[used], faces), beyond


def bordering(
    faces: NDArray[np.int32], sides: NDArray[np.int32], label: int, vertex_count: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
    """Return the triangles that border a label, turned outward.

    Parameters
    ----------
    faces, sides : (F, 3) and (F, 2) int32
        As in `ComplexMesh`.
    vertex_count : int

    Returns
    -------
    faces : (f, 3) int32
        In their order in the complex; vertices numbered anew.
    beyond : (f,) int32
        The label on the other side of each triangle.
    used : (v,) int32
        The complex's number of each vertex, rising.
    """
    behind = np.flatnonzero((sides == label).any(axis=1))
    own, turned = faces[behind], sides[behind, 1] == label
    own[turned] = own[turned][:, ::-1]
    beyond = np.where(turned, sides[behind, 0], sides[behind, 1]).astype(np.int32)
    used = np.zeros(vertex_count, bool)
    used[own] = True
    new_number = np.cumsum(used, dtype=np.int32) - np.int32(1)
    return new_number[own], beyond, np.flatnonzero(used).astype(np.int32)
