# SPDX-License-Identifier: GPL-3.0-or-later
"""Exact signed distance from points to a closed surface: positive outside, negative inside.

The sign is that of the angle-weighted pseudonormal of the face, edge or vertex that is nearest (Baerentzen and Aanaes
2005, doi:10.1109/TVCG.2005.49), summed over all triangles around, so that edges of four triangles are right too. Where
it is nearly at a right angle to the way there, as at fins and triangles without area, a point inside the ball around
the point that touches the surface is tested instead: the ball is empty, so all of it has one sign.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arithmetic import arctangents
from ...arrays import Doubles, Flags, Indices
from ...machine.parallel import map_steps, worker_count
from ...progress import PAUSE, Steps, equal_part
from ..topology import FACES_PER_STEP, edges_steps
from ..triangle_mesh import TriangleMesh
from ..vectors import cross, dot
from .nearest_points import CORNER, EDGE, nearest_points
from .triangle_tree import TriangleTree

RIGHT = math.pi / 2
UNCLEAR = 1e-3  # Below this cosine between the way and a pseudonormal, test the sign elsewhere.
MOVED = 0.5  # Test the sign at this share of the way to the surface.
WAYS = np.array(
    [
        *np.concatenate([np.eye(3), -np.eye(3)]),
        *(np.array([x, y, z]) / np.sqrt(3) for x in (1, -1) for y in (1, -1) for z in (1, -1)),
    ]
)
POINTS_AT_ONCE = 1 << 15


class SignedSurface:
    """A surface, prepared for signed distances.

    Attributes
    ----------
    mesh : TriangleMesh
    tree : TriangleTree
    closed : bool
        Whether as many triangles run up every edge as run down it; otherwise distances are unsigned.
    """

    mesh: TriangleMesh
    tree: TriangleTree
    closed: bool

    def prepare_steps(self, mesh: TriangleMesh) -> Steps[None]:
        """Prepare a mesh with at least one triangle, else raise `MeshError`."""
        self.mesh, self.tree = mesh, TriangleTree()
        yield from self.tree.prepare_steps(mesh)
        _, self._face_edges = yield from edges_steps(np.ascontiguousarray(mesh.faces.T), len(mesh.vertices))
        self.closed = yield from self._closed_steps()
        if self.closed:
            yield from self._normals_steps()

    def _closed_steps(self) -> Steps[bool]:
        faces, count = self.mesh.faces, int(self._face_edges.max()) + 1
        balance = np.zeros(count)
        for corner in range(3):
            start, end = faces[:, corner], faces[:, (corner + 1) % 3]
            balance += np.bincount(self._face_edges[corner], np.sign(end - start), count)
            yield PAUSE
        return not balance.any()

    def _normals_steps(self) -> Steps[None]:
        """Compute the pseudonormals of faces, edges and vertices, of any length."""
        faces, edge_count, vertex_count = self.mesh.faces, int(self._face_edges.max()) + 1, len(self.mesh.vertices)
        self._of_face = np.empty((3, len(faces)))
        angles = np.empty((3, len(faces)))
        for start in range(0, len(faces), FACES_PER_STEP):
            block = slice(start, start + FACES_PER_STEP)
            columns = self.mesh.vertices[faces[block]].astype(np.float64).transpose(1, 2, 0)  # corner, axis, face
            sides = [columns[(corner + 1) % 3] - columns[corner] for corner in range(3)]
            vector = cross(sides[0], sides[1])
            length = np.sqrt(dot(vector, vector))
            self._of_face[:, block] = vector / np.where(length > 0, length, 1)
            for corner in range(3):
                angles[corner, block] = _angles(length, -dot(sides[corner], sides[corner - 1]))
            yield PAUSE
        self._of_edge, self._of_vertex = np.zeros((3, edge_count)), np.zeros((3, vertex_count))
        for axis, corner in np.ndindex(3, 3):
            normals = self._of_face[axis]
            self._of_edge[axis] += np.bincount(self._face_edges[corner], normals, edge_count)
            yield PAUSE
            self._of_vertex[axis] += np.bincount(faces[:, corner], normals * angles[corner], vertex_count)
            yield PAUSE

    def distances_steps(self, points: NDArray[Any], threads: int | None = None) -> Steps[tuple[Doubles, Indices]]:
        """Return the signed distance of every point (n, 3), (n,), unsigned where open; and its nearest face, (n,)."""
        points = np.asarray(points, np.float64)
        squared, place = yield from equal_part(self.tree.nearest_steps(points, threads=threads), 0, 2)
        distances = np.sqrt(squared)

        def give_signs(start: int) -> None:
            block = slice(start, start + POINTS_AT_ONCE)
            inside = self._inside(np.ascontiguousarray(points[block].T), distances[block], place[block])
            np.negative(distances[block], out=distances[block], where=inside & (distances[block] > 0))

        if self.closed:
            blocks = range(0, len(points), POINTS_AT_ONCE)
            signs = map_steps(give_signs, blocks, worker_count(threads), "", batches=max(1, len(blocks)))
            yield from equal_part(signs, 1, 2)
        return distances, self.tree.order[place].astype(np.int64)

    def nearest_on(self, points: Doubles, face: Indices) -> Doubles:
        """Return the points of the given faces, (n,), that are nearest to points (3, n)."""
        columns = self.mesh.vertices[self.mesh.faces[face]].astype(np.float64).transpose(1, 2, 0)
        return nearest_points(points, *columns)[0]

    def _inside(self, points: Doubles, distances: Doubles, place: Indices) -> Flags:
        """Return which points (3, n) are inside, by their distances and the places of their nearest triangles."""
        cosine = self._cosines(points, place)
        inside = cosine < 0
        unclear = np.flatnonzero((np.abs(cosine) < UNCLEAR) & (distances > 0))
        for way in WAYS:
            if not len(unclear):
                break
            moved = points[:, unclear] + way[:, None] * (MOVED * distances[unclear])
            _, nearest = self.tree.nearest(moved, np.full(len(unclear), np.inf), [place[unclear]])
            cosine = self._cosines(moved, nearest)
            clear = np.abs(cosine) >= UNCLEAR
            inside[unclear[clear]] = cosine[clear] < 0
            unclear = unclear[~clear]
        return inside

    def _cosines(self, points: Doubles, place: Indices) -> Doubles:
        """Return the cosine between the way from the surface to each point and the pseudonormal there, (n,)."""
        nearest, part = nearest_points(points, *(np.take(corner, place, axis=1) for corner in self.tree.corners))
        face = self.tree.order[place]
        normal = np.take(self._of_face, face, axis=1)
        for corner in range(3):
            for sums, numbers, first in (
                (self._of_edge, self._face_edges[corner], EDGE),
                (self._of_vertex, self.mesh.faces[:, corner], CORNER),
            ):
                here = part == first + corner
                normal[:, here] = np.take(sums, numbers[face[here]], axis=1)
        way = points - nearest
        length = np.sqrt(dot(way, way) * dot(normal, normal))
        return np.asarray(dot(way, normal) / np.where(length > 0, length, 1))


def _angles(crosses: Doubles, dots: Doubles) -> Doubles:
    """Return the angles between vectors, half radians, from the lengths of their cross products and their dots."""
    whole = np.sqrt(crosses * crosses + dots * dots) + np.abs(dots)
    acute = arctangents(crosses / np.where(whole > 0, whole, 1.0))
    return np.where(dots >= 0, acute, RIGHT - acute)
