# SPDX-License-Identifier: GPL-3.0-or-later
"""The surfaces of labels that touch, as one complex: a triangle is stored once, with the two labels it separates.

`ComplexSurface` holds both ends of alpha, as `Surface` does for one label; `ComplexMesh` is the complex at one alpha.
A label's own surface is every triangle that borders it, turned outward. Neighbors have the same float32 positions.
Where a label touches itself in a vertex, its own surface has two there.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...progress import finish
from ..face_normals import face_vectors_steps
from ..triangle_mesh import Surface, TriangleMesh, blend
from .pinched_vertices import split_pinched


class _Interface(NamedTuple):
    """The contact of two labels.

    Parameters
    ----------
    behind, front : int
        The labels; 0 is what has no label.
    triangles : int
    area : float
        Area in the square of the vertices' unit.
    """

    behind: int
    front: int
    triangles: int
    area: float


class Neighbor(NamedTuple):
    """Label on the other side of a label's surface, 0 for none, and the area between them, mm2."""

    label: int
    triangles: int
    area_mm2: float


def neighbors_of(label: int, interfaces: Iterable[_Interface]) -> tuple[Neighbor, ...]:
    """Return the labels that a label borders on, in the order of their numbers, without 0.

    Examples
    --------
    >>> neighbors_of(2, [_Interface(1, 0, 4, 8.0), _Interface(2, 0, 9, 7.0), _Interface(2, 1, 5, 3.5)])
    (Neighbor(label=1, triangles=5, area_mm2=3.5),)
    """
    both = ((each, neighbor) for each in interfaces for neighbor in (each.behind, each.front))
    return tuple(
        sorted(
            Neighbor(neighbor, each.triangles, each.area)
            for each, neighbor in both
            if neighbor not in (0, label) and label in (each.behind, each.front)
        )
    )


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
    normals : (V, 3) float32 or None
        Unit length; those of a vertex's first triangle where several walls meet.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    sides: NDArray[np.int32]
    normals: NDArray[np.float32] | None = None

    @cached_property
    def labels(self) -> tuple[int, ...]:
        """Every label that has a triangle, rising, without 0."""
        ordered = np.sort(_narrow(self.sides.reshape(-1)), kind="stable")
        return tuple(ordered[np.flatnonzero(np.diff(ordered, prepend=ordered.dtype.type(0)))].tolist())

    @property
    def interfaces(self) -> tuple[_Interface, ...]:
        """Every pair of labels that have triangles between them, rising, behind before front."""
        labels = np.array(sorted({0, *self.labels}))
        number = np.searchsorted(labels, self.sides)
        keys = number[:, 0] * len(labels) + number[:, 1]
        counts = np.bincount(keys, minlength=len(labels) ** 2)
        x, y, z = finish(face_vectors_steps(self.vertices, self.faces)).T
        areas = np.bincount(keys, np.sqrt(x**2 + y**2 + z**2), len(labels) ** 2) / 2
        return tuple(
            _Interface(
                int(labels[key // len(labels)]), int(labels[key % len(labels)]), int(counts[key]), float(areas[key])
            )
            for key in np.flatnonzero(counts).tolist()
        )

    def of_label(self, label: int) -> TriangleMesh:
        """Return the closed surface of one label: its own triangles, turned outward, and the vertices in use."""
        faces, _, used = bordering(self.faces, self.sides, label)
        return TriangleMesh(self.vertices[used], faces, None if self.normals is None else self.normals[used])


@dataclass(frozen=True, eq=False)
class ComplexSurface:
    """Extracted surface: every vertex at both ends of alpha (Su and Ma, eq. 5 to 7).

    Parameters
    ----------
    midpoints, linear : (V, 3) float32
        Position at alpha 0 and at alpha 1.
    faces : (F, 3) int32
        As in `ComplexMesh`; the same for every alpha.
    sides : (F, 2) int32
        As in `ComplexMesh`.
    off_edges : (V,) bool
        Whether a vertex lies inside a face or a voxel, as in voxels of three labels or more; others lie on edges.
    """

    midpoints: NDArray[np.float32]
    linear: NDArray[np.float32]
    faces: NDArray[np.int32]
    sides: NDArray[np.int32]
    off_edges: NDArray[np.bool_]

    @property
    def may_cross(self) -> NDArray[np.bool_]:
        """Return whether a triangle may cross another one, (F,); triangles of the case table never do."""
        return self.off_edges[self.faces].any(axis=1)

    def at(self, alpha: float) -> ComplexMesh:
        """Return the complex at `alpha`, in float32 in the order in which Blender mixes a shape key."""
        return ComplexMesh(blend(self.midpoints, self.linear, alpha), self.faces, self.sides)

    def of_label(self, label: int) -> tuple[Surface, NDArray[np.int32]]:
        """Return a label's surface at both ends of alpha, and the label in front of each triangle, (f,) int32."""
        return self.within(bordering(self.faces, self.sides, label))

    def within(self, border: Border) -> tuple[Surface, NDArray[np.int32]]:
        """Return the surface that `of_label` returns, for a given border of a label."""
        used = border.used
        return Surface(self.midpoints[used], self.linear[used], border.faces), border.beyond


class Border(NamedTuple):
    """The triangles that border a label, turned outward.

    Parameters
    ----------
    faces : (f, 3) int32
        In their order in the complex; vertices are renumbered.
    beyond : (f,) int32
        The label on the other side of each triangle.
    used : (v,) int32
        The complex's number of each vertex: rising, then once more for every further fan of triangles around one.
    """

    faces: NDArray[np.int32]
    beyond: NDArray[np.int32]
    used: NDArray[np.int32]


def borders_of(faces: NDArray[np.int32], sides: NDArray[np.int32]) -> dict[int, Border]:
    """Return the border of every label of a complex but 0, looked for once for all of them.

    Each is a manifold: a vertex at which a label touches itself is split.

    Parameters
    ----------
    faces, sides : (F, 3) and (F, 2) int32
        As in `ComplexMesh`.
    """
    junctions = junction_vertices(faces, sides)
    both = _narrow(sides.reshape(-1))  # each triangle stands once for either side
    order = np.argsort(both, kind="stable")
    starts = np.flatnonzero(np.diff(both[order], prepend=both.dtype.type(0)))
    borders = {}
    for start, stop in zip(starts.tolist(), np.append(starts, len(order))[1:].tolist(), strict=True):
        label = int(both[order[start]])
        if label:
            number, side = np.divmod(order[start:stop], 2)
            own = faces[number]
            turned = np.flatnonzero(side)
            own[turned] = own[turned, ::-1]
            lowest = own.min()
            renumbered = np.zeros(own.max() - lowest + 1, np.int32)
            renumbered[own - lowest] = 1
            used = np.flatnonzero(renumbered)
            renumbered[used] = np.arange(len(used), dtype=np.int32)
            used = (used + lowest).astype(np.int32)
            corners, copied = split_pinched(renumbered[own - lowest], junctions[used])
            borders[label] = Border(corners, sides[number, 1 - side], np.append(used, used[copied]))
    return borders


def _narrow(labels: NDArray[np.int32]) -> NDArray[Any]:
    """Return labels in as few bits as hold the highest: NumPy orders 16 bits in a fifth of the time of 32."""
    return labels.astype(np.min_scalar_type(labels.max(initial=0)))


def junction_vertices(faces: NDArray[np.int32], sides: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return whether triangles between different pairs of labels meet at a vertex, (V,), up to the highest in use.

    Parameters
    ----------
    faces, sides : (F, 3) and (F, 2) int32
        As in `ComplexMesh`.
    """
    pairs = sides.max(axis=1).astype(np.int64) << 32 | sides.min(axis=1)
    at_vertex = np.empty(int(faces.max(initial=-1)) + 1, np.int64)
    for corner in faces.T:
        at_vertex[corner] = pairs
    differs = np.zeros(len(at_vertex), bool)
    for corner in faces.T:
        differs[corner[np.take(at_vertex, corner) != pairs]] = True
    return differs


def bordering(faces: NDArray[np.int32], sides: NDArray[np.int32], label: int) -> Border:
    """Return the border of one label of a complex, (f may be 0).

    Parameters
    ----------
    faces, sides : (F, 3) and (F, 2) int32
        As in `ComplexMesh`.
    """
    used = np.zeros(int(faces.max(initial=-1)) + 1, bool)
    used[faces[(sides == label).any(axis=1)]] = True
    near = np.flatnonzero(np.take(used, faces).any(axis=1))  # what meets the label in a vertex tells where to split it
    nothing = Border(np.empty((0, 3), np.int32), np.empty(0, np.int32), np.empty(0, np.int32))
    return borders_of(faces[near], sides[near]).get(label, nothing)
