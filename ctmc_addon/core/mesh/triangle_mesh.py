"""The two forms a surface travels in, and what can be measured on it.

`Surface` holds what extraction knows: for every vertex both ends of alpha. `TriangleMesh` is the
surface at one alpha. Both are in whatever space their positions are in: index space or RAS+ mm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..progress import Pauses, finish

FACES_AT_ONCE = 1 << 18  # between two pauses
SHELF = 1 << 19  # corners whose edges are sorted together
Target = tuple[float | None, NDArray[np.float32]]
"""An alpha, or None for the linear end itself, and the (V, 3) positions at it that are to be filled in."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles over shared vertices.

    Parameters
    ----------
    vertices : (V, 3) float32
        Positions (x, y, z).
    faces : (F, 3) int32
        Vertex numbers, counter-clockwise seen from outside.
    normals : (V, 3) float32 or None
        Unit length, pointing outside.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    normals: NDArray[np.float32] | None = None

    @cached_property
    def area(self) -> float:
        """Sum of the triangles' areas, in the square of the vertices' unit."""
        cross = face_vectors(self.vertices, self.faces)
        return float(0.5 * np.sqrt(cross[:, 0] ** 2 + cross[:, 1] ** 2 + cross[:, 2] ** 2).sum())

    @cached_property
    def volume(self) -> float:
        """Enclosed volume by the divergence theorem, positive where the faces point outside.

        Means something only where the mesh is closed.
        """
        if not len(self.faces):
            return 0.0
        # About the mesh's own middle: far from the origin the terms would cancel badly.
        middle = self.vertices.astype(np.float64).mean(axis=0)
        corners = self.vertices[self.faces].astype(np.float64) - middle  # (F, 3, 3)
        return float((corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0)

    @property
    def enclosed(self) -> float | None:
        """The volume that a closed mesh encloses; an open one has none."""
        return self.volume if self.closed else None

    @cached_property
    def edges(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Every undirected edge once, (E, 2) with the lower vertex first, and its number of triangles, (E,)."""
        a, b = self.faces[:, (0, 1, 2)].ravel().astype(np.int64), self.faces[:, (1, 2, 0)].ravel()
        keys = np.minimum(a, b) * len(self.vertices) + np.maximum(a, b)
        keys, counts = np.unique(keys, return_counts=True)
        return np.stack(np.divmod(keys, max(len(self.vertices), 1)), axis=1), counts

    @property
    def boundary_edges(self) -> NDArray[np.int64]:
        """Edges with one triangle, (n, 2)."""
        edges, counts = self.edges
        return edges[counts == 1]

    @property
    def non_manifold_edges(self) -> NDArray[np.int64]:
        """Edges with three triangles or more, (n, 2)."""
        edges, counts = self.edges
        return edges[counts > 2]

    @property
    def closed(self) -> bool:
        """Whether there are triangles and every edge has two of them, which run through it in opposite ways."""
        if not len(self.faces) or (self.edges[1] != 2).any():
            return False
        start, end = self.faces[:, (0, 1, 2)].ravel().astype(np.int64), self.faces[:, (1, 2, 0)].ravel()
        directed = np.sort(start * len(self.vertices) + end)
        return bool((directed[1:] != directed[:-1]).all())

    @property
    def euler(self) -> int:
        """Vertices in use - edges + faces; 2 for every closed part without handles."""
        used = np.zeros(len(self.vertices), bool)
        used[self.faces] = True
        return int(used.sum()) - len(self.edges[0]) + len(self.faces)

    @cached_property
    def part_of_face(self) -> NDArray[np.int32]:
        """Number of the connected part of every face, (F,) int32; parts in the order of their first face."""
        return part_numbers(self.faces, len(self.vertices))

    @property
    def parts(self) -> int:
        """Number of connected parts."""
        return int(self.part_of_face.max()) + 1 if len(self.faces) else 0


@dataclass(frozen=True, eq=False)
class Surface:
    """What extraction found: for every vertex both ends of alpha (Su and Ma, eq. 5 to 7).

    Parameters
    ----------
    midpoints, linear : (V, 3) float32
        Position at alpha 0 and at alpha 1.
    faces : (F, 3) int32
        The same for every alpha.
    normals : (V, 3) float32 or None
        Unit length, pointing outside; those of the isosurface, so the same for every alpha.
    """

    midpoints: NDArray[np.float32]
    linear: NDArray[np.float32]
    faces: NDArray[np.int32]
    normals: NDArray[np.float32] | None = None

    def at(self, alpha: float) -> TriangleMesh:
        """The surface at `alpha`, computed in float32 in the order in which Blender mixes a shape key."""
        return TriangleMesh(blend(self.midpoints, self.linear, alpha), self.faces, self.normals)

    def keeping(self, faces: NDArray[np.bool_]) -> Surface:
        """The surface of the chosen faces, (F,) bool, without the vertices that are then unused."""
        kept = self.faces[faces]
        used = np.zeros(len(self.midpoints), bool)
        used[kept] = True
        number = np.cumsum(used, dtype=np.int32) - 1
        return replace(
            self,
            midpoints=self.midpoints[used],
            linear=self.linear[used],
            faces=number[kept].astype(np.int32, copy=False),
            normals=None if self.normals is None else self.normals[used],
        )


def blend(midpoints: NDArray[np.float32], linear: NDArray[np.float32], alpha: float) -> NDArray[np.float32]:
    """``midpoints + alpha * (linear - midpoints)`` in float32, step by step as Blender mixes a shape key."""
    mixed = linear - midpoints
    mixed *= np.float32(alpha)
    mixed += midpoints
    return mixed


def face_vectors(vertices: NDArray[Any], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """Twice the area times the outward unit normal of every face, (F, 3) float64."""
    a, b, c = (vertices[faces[:, corner]].astype(np.float64) for corner in range(3))  # (F, 3) each
    u, v = b - a, c - a
    out = np.empty_like(u)
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        out[:, axis] = u[:, one] * v[:, two] - u[:, two] * v[:, one]
    return out


def vertex_normals(vertices: NDArray[Any], faces: NDArray[np.int32]) -> NDArray[np.float32]:
    """Area-weighted mean of the normals of the faces at every vertex, (V, 3) float32, unit length."""
    return finish(averaging_normals(vertices, faces))


def averaging_normals(vertices: NDArray[Any], faces: NDArray[np.int32]) -> Pauses[NDArray[np.float32]]:
    """`vertex_normals`, pausing now and then."""
    vectors = np.empty((len(faces), 3))
    for start in range(0, len(faces), FACES_AT_ONCE):
        part = slice(start, start + FACES_AT_ONCE)
        vectors[part] = face_vectors(vertices, faces[part])
        yield
    sums = np.empty((len(vertices), 3))
    corners = faces.ravel()
    for axis in range(3):
        yield
        # bincount adds in the order of the corners: the same bits everywhere.
        sums[:, axis] = np.bincount(corners, np.repeat(vectors[:, axis], 3), len(vertices))
    length = np.sqrt(sums[:, 0] ** 2 + sums[:, 1] ** 2 + sums[:, 2] ** 2)
    length[length == 0] = 1.0
    return (sums / length[:, None]).astype(np.float32)


def finding_edges(faces: NDArray[np.int32], vertex_count: int) -> Pauses[tuple[NDArray[np.int32], NDArray[np.int32]]]:
    """Every edge of the faces, (3, F), once, (2, E), the lower end first and in the order of their ends.

    With them the edge from corner i to corner i + 1 of every face, (3, F). Pauses now and then.
    """
    start, end = faces.ravel(), faces[[1, 2, 0]].ravel()
    yield
    low, high = np.minimum(start, end), np.maximum(start, end)
    yield
    face_edges = np.empty(len(low), np.int32)
    # A shelf of edges for each run of lower vertices, so that nothing large is sorted at once.
    run = max(1, vertex_count * SHELF // max(1, len(low)))
    edges, count = [np.empty((2, 0), np.int32)], 0
    for first in range(0, vertex_count, run):
        corners = np.flatnonzero((low >= first) & (low < first + run))
        keys = low[corners].astype(np.int64) * vertex_count + high[corners]
        order = np.argsort(keys, kind="stable")
        keys = keys[order]
        new = np.ones(len(keys), bool)
        new[1:] = keys[1:] != keys[:-1]
        face_edges[corners[order]] = np.cumsum(new, dtype=np.int32) + np.int32(count - 1)
        edges.append(np.array(np.divmod(keys[new], vertex_count), np.int32))
        count += edges[-1].shape[1]
        yield
    return np.concatenate(edges, axis=1), face_edges.reshape(faces.shape)


def part_numbers(faces: NDArray[np.int32], vertex_count: int) -> NDArray[np.int32]:
    """Number of the connected part of every face, (F,) int32; parts in the order of their first face."""
    return finish(numbering_parts(faces, vertex_count))


def numbering_parts(faces: NDArray[np.int32], vertex_count: int) -> Pauses[NDArray[np.int32]]:
    """`part_numbers`, pausing now and then."""
    roots = (yield from finding_roots(faces, vertex_count))[faces[:, 0]]  # (F,)
    yield
    first = np.full(vertex_count, -1, np.int32)
    first[roots[::-1]] = np.arange(len(faces), dtype=np.int32)[::-1]  # of several faces the last to write is the first
    yield
    there = np.flatnonzero(first >= 0)
    number = np.empty(vertex_count, np.int32)
    number[there[np.argsort(first[there], kind="stable")]] = np.arange(len(there), dtype=np.int32)
    return number[roots]


def finding_roots(faces: NDArray[np.int32], vertex_count: int) -> Pauses[NDArray[np.int32]]:
    """Lowest vertex of the connected part that every vertex is in, (V,) int32, pausing now and then.

    Every vertex takes the lowest number among its faces' vertices and then that number's number
    (pointer jumping), until nothing changes; the rounds grow with the logarithm of the diameter.
    """
    lowest = np.arange(vertex_count, dtype=np.int32)
    starts = range(0, len(faces), FACES_AT_ONCE)
    links = [faces[start : start + FACES_AT_ONCE, pair : pair + 2] for start in starts for pair in (0, 1)]
    while links:
        apart: list[NDArray[np.int32]] = []
        root = lowest.copy()  # a link is done with only when both its ends have had one root since the last round
        for some in links:
            one, other = root[some[:, 0]], root[some[:, 1]]
            differ = one != other
            if differ.any():
                apart.append(some[differ])
                low = np.minimum(one, other)[differ]
                np.minimum.at(lowest, one[differ], low)
                np.minimum.at(lowest, other[differ], low)
            yield
        while True:
            shorter = lowest[lowest]
            yield
            if (shorter == lowest).all():
                break
            lowest = shorter
        links = apart
    return lowest
