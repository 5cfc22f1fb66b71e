# SPDX-License-Identifier: GPL-3.0-or-later
"""Batches: triangles of a surface that are simplified at once. They share the vertices at their borders.

Every vertex of the whole surface has a number of its own. Two batches share the vertices whose numbers both have. While
a batch is simplified its border stays, so batches that fitted before fit afterwards.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags, Indices
from ...mesh.intersections import self_intersections_steps
from ...mesh.pieces.completed_pieces import CompletedPiece, completed_pieces_steps
from ...mesh.topology import compacted
from ...mesh.triangle_mesh import SurfacePieces, TriangleMesh
from ...progress import Step, Steps, WithResult

NEW = -1  # The number of a vertex that has none yet.
BEYOND_PIECES = 1 << 48  # The number of the first new vertex: larger than the number of vertices in all pieces.

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Batch:
    """A batch of a surface.

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

    def with_faces(self, selected: Flags) -> Batch:
        """The batch of the selected faces, (F,) bool."""
        if selected.all():
            return self
        return Batch(replace(self.mesh, faces=self.mesh.faces[selected]), self.numbers).with_used_vertices()

    def with_used_vertices(self) -> Batch:
        """The batch without the vertices that no face has."""
        used, faces = compacted(self.mesh.faces, len(self.numbers))
        normals = None if self.mesh.normals is None else self.mesh.normals[used]
        return Batch(TriangleMesh(self.mesh.vertices[used], faces, normals), self.numbers[used])


class Numbering:
    """Gives out vertex numbers that no piece uses."""

    def __init__(self) -> None:
        self.next = BEYOND_PIECES

    def take(self, count: int) -> Indices:
        """Return `count` numbers that no vertex has yet, (count,) int64."""
        self.next += count
        return np.arange(self.next - count, self.next)

    def completed(self, batch: Batch) -> Batch:
        """A batch with numbers for its new vertices too."""
        new = batch.numbers == NEW
        if not new.any():
            return batch
        numbers = batch.numbers.copy()
        numbers[new] = self.take(int(new.sum()))
        return Batch(batch.mesh, numbers)


def joined(batches: Sequence[Batch]) -> Batch:
    """Batches as a single one, in their order; vertices with one number are one vertex."""
    if len(batches) == 1:
        return batches[0]
    numbers = np.concatenate([batch.numbers for batch in batches])
    firsts = np.cumsum([0] + [len(batch.numbers) for batch in batches])
    # Of the vertices with one number the first stands for all, in the order in which they come.
    order = np.argsort(numbers, kind="stable")
    ordered = numbers[order]
    new = np.ones(len(ordered), bool)
    new[1:] = ordered[1:] != ordered[:-1]
    stands = np.empty(len(order), np.int64)
    stands[order] = order[new][np.cumsum(new) - 1]
    first = stands == np.arange(len(stands))
    place = (np.cumsum(first) - 1)[stands].astype(np.int32)
    faces = np.concatenate([place[batch.mesh.faces + low] for batch, low in zip(batches, firsts[:-1], strict=True)])
    vertices = np.concatenate([batch.mesh.vertices for batch in batches])[first]
    normals: Any = [batch.mesh.normals for batch in batches if len(batch.numbers)]
    whole = bool(normals) and all(each is not None for each in normals)
    normals = np.concatenate(normals)[first] if whole else None
    return Batch(TriangleMesh(vertices, faces, normals), numbers[first])


def batches_steps(pieces: SurfacePieces[T], least: int, most_whole: float) -> Generator[Step | Batch, None, T]:
    """Gather pieces to batches of at least `least` triangles; up to `most_whole` triangles are one batch.

    Where a batch ends is read from the triangles alone: at the first position in their list, `least` or more after its
    start, where every triangle before has a lower lowest vertex than every triangle after. In what extraction makes,
    every layer of samples ends so. It does not matter how the surface was cut into pieces.

    Yields
    ------
    Step or Batch
        The steps of the pieces; a batch that is all of the surface has all its vertices, used or not.
    """
    gathered: list[CompletedPiece] = []
    count, begun = 0, False
    source = WithResult(completed_pieces_steps(pieces))
    for item in source:
        if isinstance(item, Step):
            yield item
            continue
        gathered.append(item)
        count += len(item.mesh.faces)
        begun = begun or count > most_whole
        if begun and count >= least:
            rest = yield from _complete_batches(_concatenated(gathered), least)
            gathered, count = [rest], len(rest.mesh.faces)
    if count:
        rest = _concatenated(gathered)
        if begun:
            yield from _bands(_batch(rest, 0, count, 0), least)
        else:
            yield Batch(rest.mesh, np.arange(len(rest.mesh.vertices)))
    return source.result


def _concatenated(pieces: Sequence[CompletedPiece]) -> CompletedPiece:
    """Pieces that follow each other as a single one."""
    if len(pieces) == 1:
        return pieces[0]
    first, last = pieces[0].first, pieces[-1]
    faces = np.concatenate([piece.mesh.faces + np.int32(piece.first - first) for piece in pieces])
    vertices = np.concatenate([piece.mesh.vertices[: piece.own] for piece in pieces[:-1]] + [last.mesh.vertices])
    normals: Any = [piece.mesh.normals if piece is last else _own_normals(piece) for piece in pieces]
    normals = None if any(each is None for each in normals) else np.concatenate(normals)
    return CompletedPiece(TriangleMesh(vertices, faces, normals), last.first - first + last.own, first)


def _own_normals(piece: CompletedPiece) -> NDArray[np.float32] | None:
    return None if piece.mesh.normals is None else piece.mesh.normals[: piece.own]


def _complete_batches(piece: CompletedPiece, least: int) -> Generator[Batch, None, CompletedPiece]:
    """Yield the batches whose end is known, whatever follows the piece; return the rest of it."""
    mesh, start, low = piece.mesh, 0, 0
    clean = _clean_cuts(mesh.faces, piece.own)
    while start + least < len(clean):
        ahead = clean[start + least :]
        end = start + least + int(np.argmax(ahead))
        if not clean[end]:
            break
        yield from _bands(_batch(piece, start, end, low), least)
        # All triangles that follow have higher vertices alone.
        start, low = end, int(_lowest(mesh.faces[start:end]).max()) + 1
    if not start:
        return piece
    normals = None if mesh.normals is None else mesh.normals[low:]
    rest = TriangleMesh(mesh.vertices[low:], mesh.faces[start:] - np.int32(low), normals)
    return CompletedPiece(rest, piece.own - low, piece.first + low)


def _clean_cuts(faces: NDArray[np.int32], bound: int) -> Flags:
    """Return before which triangles, (F + 1,) bool, the list can be cut; later ones have no vertex below `bound`.

    Where a triangle of the last layer lies in the next one, what follows decides: that is no cut yet.
    """
    lowest = _lowest(faces)
    before = np.full(len(faces) + 1, -1, np.int32)
    np.maximum.accumulate(lowest, out=before[1:])
    after = np.append(lowest, np.int32(bound))
    np.minimum.accumulate(after[::-1], out=after[::-1])
    return after > before


def _lowest(faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Lowest vertex of every triangle, (F,)."""
    return np.minimum(np.minimum(faces[:, 0], faces[:, 1]), faces[:, 2])


def _batch(piece: CompletedPiece, start: int, end: int, low: int) -> Batch:
    """The triangles from `start` to `end`, whose vertices are not below `low`."""
    mesh = piece.mesh
    faces = mesh.faces[start:end] - np.int32(low)
    high = int(faces.max()) + 1
    normals = None if mesh.normals is None else mesh.normals[low : low + high]
    numbers = np.arange(piece.first + low, piece.first + low + high)
    return Batch(TriangleMesh(mesh.vertices[low : low + high], faces, normals), numbers).with_used_vertices()


def _bands(batch: Batch, most: int) -> Iterator[Batch]:
    """Yield a batch, or bands of it that have about `most` triangles: from one and a half times as many on, two."""
    count = round(batch.face_count / most)
    if count < 2:
        yield batch
        return
    vertices = batch.mesh.vertices
    axis = int(np.argmax(vertices.max(axis=0) - vertices.min(axis=0)))
    yield from _parts(batch, _band_of_face(batch, axis, count))


def _band_of_face(batch: Batch, axis: int, count: int) -> Indices:
    """Return the band of every face, (F,), for bands along an axis with equal numbers of triangles."""
    along = batch.mesh.vertices[batch.mesh.faces[:, 0], axis]
    places = [batch.face_count * number // count for number in range(1, count)]
    ends = np.partition(along, places)[places]
    return np.searchsorted(ends, along, side="right")


def _parts(batch: Batch, number_of_face: Indices) -> Iterator[Batch]:
    """The batches of the faces with one number each, (F,), in the order of the numbers."""
    for number in range(int(number_of_face.max()) + 1):
        selected = number_of_face == number
        if selected.any():
            yield batch.with_faces(selected)


def regions(surface: Batch, most: int, axis: int = -1) -> tuple[list[Batch], int]:
    """Regions of a surface, of no more than about `most` triangles each, and the axis along which they follow.

    Of the axes, but for the given one, that is taken on which the fewest triangles lie at a border between regions: it
    runs along the seams of batches, where there are many small triangles, and not across them.
    """
    count = -(-surface.face_count // most)
    if count < 2:
        return [surface], axis
    best = None
    for along in range(3):
        if along == axis:
            continue
        band = _band_of_face(surface, along, count)
        of_vertex = np.empty(len(surface.numbers), np.int64)
        for corner in surface.mesh.faces.T:
            of_vertex[corner] = band
        at_border = sum(int((of_vertex[corner] != band).sum()) for corner in surface.mesh.faces.T)
        if best is None or at_border < best[0]:
            best = at_border, along, band
    assert best is not None
    return list(_parts(surface, best[2])), best[1]


def shared_count(first: Batch, second: Batch) -> int:
    """Count the vertices that two batches share; the numbers rise, as those of `batches_steps`."""
    low, high = np.searchsorted(first.numbers, second.numbers[[0, -1]])
    numbers = first.numbers[low : high + 1]
    at = np.minimum(np.searchsorted(second.numbers, numbers), len(second.numbers) - 1)
    return int((second.numbers[at] == numbers).sum())


def faces_near_other_batches(batches: Sequence[Batch]) -> tuple[Batch, Indices]:
    """Return the faces whose boxes meet those of another batch, as a batch, and the batch of each, (f,).

    Triangles of different batches that cross each other are among them.
    """
    limit = np.float32(np.inf)  # nothing meets the box of a batch that has lost all of its triangles
    boxes = [
        (batch.mesh.vertices.min(axis=0, initial=limit), batch.mesh.vertices.max(axis=0, initial=-limit))
        for batch in batches
    ]
    near = []
    for number, (batch, (low, high)) in enumerate(zip(batches, boxes, strict=True)):
        selected = np.zeros(batch.face_count, bool)
        corners = [batch.mesh.vertices[corner] for corner in batch.mesh.faces.T]
        lowest, highest = np.minimum.reduce(corners), np.maximum.reduce(corners)
        for other, (least, most) in enumerate(boxes):
            if other != number and (low <= most).all() and (high >= least).all():
                selected |= ((lowest <= most) & (highest >= least)).all(axis=1)
        near.append(batch.with_faces(selected))
    return joined(near), np.repeat(np.arange(len(near)), [batch.face_count for batch in near])


def crossing_batches_steps(batches: Sequence[Batch]) -> Steps[Indices]:
    """The numbers of the batches of two triangles that cross each other, of different ones, (n, 2)."""
    if len(batches) == 1:
        return np.empty((0, 2), np.int64)
    near, owner = faces_near_other_batches(batches)
    pairs = owner[(yield from self_intersections_steps(near.mesh.vertices, near.mesh.faces))]
    return pairs[pairs[:, 0] != pairs[:, 1]]
