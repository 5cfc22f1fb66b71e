# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of a surface that share vertices at their borders, told apart and put together by the vertices' numbers.

Every vertex of the whole surface has a number of its own. Two parts share the vertices whose numbers both have. While
a part is simplified its border stays, so parts that fitted before fit afterwards.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...mesh.completed_pieces import completed_pieces_steps
from ...mesh.triangle_mesh import SurfacePieces, TriangleMesh
from ...mesh.vectors import cross, dot
from ...progress import Step, WithResult

NEW = -1  # number of a vertex that has none yet
BEYOND_PIECES = 1 << 48  # number of the first vertex that is made here: more than the pieces have together
RINGS = 2  # of triangles beside a seam are simplified again without it

T = TypeVar("T")
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a surface.

    mesh : TriangleMesh
    numbers : (V,) int64
        Number of every vertex in the whole surface.
    """

    mesh: TriangleMesh
    numbers: Indices

    @property
    def face_count(self) -> int:
        """Number of triangles."""
        return len(self.mesh.faces)

    def with_faces(self, selected: Flags) -> Part:
        """The part of the selected faces, (F,) bool."""
        if selected.all():
            return self
        return Part(replace(self.mesh, faces=self.mesh.faces[selected]), self.numbers).with_used_vertices()

    def with_used_vertices(self) -> Part:
        """The part without the vertices that no face has."""
        used, faces = compacted(self.mesh.faces, len(self.numbers))
        normals = None if self.mesh.normals is None else self.mesh.normals[used]
        return Part(TriangleMesh(self.mesh.vertices[used], faces, normals), self.numbers[used])


class Numbering:
    """Hands out numbers of vertices that no piece has."""

    def __init__(self) -> None:
        self.next = BEYOND_PIECES

    def take(self, count: int) -> Indices:
        """So many new numbers."""
        self.next += count
        return np.arange(self.next - count, self.next)

    def completed(self, part: Part) -> Part:
        """A part with numbers for its new vertices too."""
        new = part.numbers == NEW
        if not new.any():
            return part
        numbers = part.numbers.copy()
        numbers[new] = self.take(int(new.sum()))
        return Part(part.mesh, numbers)


def compacted(faces: NDArray[Any], vertex_count: int) -> tuple[Flags, NDArray[np.int32]]:
    """Which of the vertices are used, (vertex_count,) bool, and the faces with those alone counted."""
    used = np.zeros(vertex_count, bool)
    used[faces] = True
    number = np.cumsum(used, dtype=np.int32) - np.int32(1)
    return used, number[faces]


def joined(parts: Sequence[Part]) -> Part:
    """Parts as a single one, in their order; vertices with one number are one vertex."""
    if len(parts) == 1:
        return parts[0]
    numbers = np.concatenate([part.numbers for part in parts])
    firsts = np.cumsum([0] + [len(part.numbers) for part in parts])
    # Of the vertices with one number the first stands for all, in the order in which they come.
    order = np.argsort(numbers, kind="stable")
    ordered = numbers[order]
    new = np.ones(len(ordered), bool)
    new[1:] = ordered[1:] != ordered[:-1]
    stands = np.empty(len(order), np.int64)
    stands[order] = order[new][np.cumsum(new) - 1]
    first = stands == np.arange(len(stands))
    place = (np.cumsum(first) - 1)[stands].astype(np.int32)
    faces = np.concatenate([place[part.mesh.faces + low] for part, low in zip(parts, firsts[:-1], strict=True)])
    vertices = np.concatenate([part.mesh.vertices for part in parts])[first]
    normals: Any = [part.mesh.normals for part in parts if len(part.numbers)]
    whole = bool(normals) and all(each is not None for each in normals)
    normals = np.concatenate(normals)[first] if whole else None
    return Part(TriangleMesh(vertices, faces, normals), numbers[first])


def batches_steps(pieces: SurfacePieces[T], least: int) -> Generator[Step | Part, None, T]:
    """Gather pieces to parts of at least so many triangles, where there are so many."""
    gathered: list[Part] = []
    source = WithResult(completed_pieces_steps(pieces))
    for item in source:
        if isinstance(item, Step):
            yield item
            continue
        numbers = np.arange(item.first, item.first + len(item.mesh.vertices))
        gathered.append(Part(item.mesh, numbers).with_used_vertices())
        if sum(part.face_count for part in gathered) >= least:
            whole = joined(gathered)
            gathered = []
            yield from _cut(whole, least)
    if any(part.face_count for part in gathered):
        yield from _cut(joined(gathered), least)
    return source.result


def _cut(part: Part, most: int) -> Iterator[Part]:
    """Bands of a part that is more than twice as large as a batch, as a slab is that has a cap on a whole slice."""
    if part.face_count <= 2 * most:
        yield part
        return
    vertices = part.mesh.vertices
    axis = int(np.argmax(vertices.max(axis=0) - vertices.min(axis=0)))
    along = vertices[part.mesh.faces[:, 0], axis]
    ends = np.sort(along)[most::most]
    band = np.searchsorted(ends, along, side="right")
    for number in range(len(ends) + 1):
        selected = band == number
        if selected.any():
            yield part.with_faces(selected)


def shared(first: Part, second: Part) -> Indices:
    """Sorted numbers of the vertices that both have."""
    return np.intersect1d(first.numbers, second.numbers)


def beside(part: Part, seam: Indices) -> Flags:
    """Faces within `RINGS` rings of triangles of the vertices with these sorted numbers, (F,) bool."""
    near = np.zeros(len(part.numbers), bool)
    if len(seam):
        at = np.minimum(np.searchsorted(seam, part.numbers), len(seam) - 1)
        near = seam[at] == part.numbers
    faces = np.zeros(part.face_count, bool)
    for _ in range(RINGS):
        faces = near[part.mesh.faces].any(axis=1)
        near[part.mesh.faces[faces]] = True
    return faces


def area(mesh: TriangleMesh) -> float:
    """Sum of the areas of the triangles, added in their order."""
    if not len(mesh.faces):
        return 0.0
    a, b, c = (mesh.vertices[corner].T for corner in mesh.faces.T)
    normal = cross(b - a, c - a).astype(np.float64)
    return float(np.cumsum(np.sqrt(dot(normal, normal)))[-1]) / 2.0
