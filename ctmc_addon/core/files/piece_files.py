# SPDX-License-Identifier: GPL-3.0-or-later
"""STL and PLY of a surface that comes piece by piece: the bytes that `TriangleMesh.save` writes of it as a whole."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError, OutputError
from ..mesh.face_normals import face_vectors
from ..mesh.triangle_mesh import SurfacePiece, SurfacePieces, TriangleMesh
from ..progress import PAUSE, Step, Steps
from .atomic_write import whole_file
from .mesh_files import (
    SUFFIXES,
    parts_of,
    write_ply_faces,
    write_ply_head,
    write_ply_vertices,
    write_stl_facets,
    write_stl_head,
)

T = TypeVar("T")
Vectors = NDArray[np.float32]

COPIED = 1 << 24  # bytes between two steps
WRITING_SHARE = 0.9  # of the work is done when the last piece has come
MOST_NUMBERED = np.iinfo(np.int32).max  # vertices of a PLY
MOST_FACETS = np.iinfo(np.uint32).max  # of an STL


@dataclass(frozen=True)
class WrittenPieces(Generic[T]):
    """How large the surface is that was written, and what the maker of its pieces returned."""

    vertices: int
    faces: int
    info: T


def write_pieces_steps(
    path: str | os.PathLike[str], pieces: SurfacePieces[T], space: str = "ras"
) -> Steps[WrittenPieces[T]]:
    """Write a surface in RAS+ mm that comes in pieces, whole or not at all; the suffix chooses the format.

    Parameters
    ----------
    path : path
        Ends in .stl or .ply. A PLY takes its own size on the disk once more while it is written.
    pieces : generator of Step and SurfacePiece
        Closed at the end, whatever happens.
    space : {"ras", "lps"}
        Axes of the file.

    Raises
    ------
    OutputError
        For another suffix, or a place that cannot be written to.
    MeshError
        Without any triangle, or with more than the format can count.
    """
    target = Path(path)
    writer = WRITERS.get(target.suffix.lower())
    try:
        if writer is None:
            raise OutputError(f"{target.name or 'an empty name'} is neither .stl nor .ply")
        with whole_file(target) as beside, beside.open("wb") as file:
            return (yield from writer(file, pieces, space))
    finally:
        pieces.close()


def _stl_steps(file: BinaryIO, pieces: SurfacePieces[T], space: str) -> Steps[WrittenPieces[T]]:
    """The number of facets stands before them, so it is written last."""
    write_stl_head(file, 0)
    completing = _Completing(pieces, space)
    while (mesh := (yield from completing.next_steps())) is not None:
        for part in parts_of(len(mesh.faces)):
            write_stl_facets(file, mesh.vertices[mesh.faces[part]])
            yield PAUSE
    written = completing.written(MOST_FACETS)
    file.seek(0)
    write_stl_head(file, written.faces)
    return written


def _ply_steps(file: BinaryIO, pieces: SurfacePieces[T], space: str) -> Steps[WrittenPieces[T]]:
    """All vertices stand before all faces and their numbers before both, so both wait in files without a name."""
    folder = Path(file.name).parent
    with tempfile.TemporaryFile(dir=folder) as vertices, tempfile.TemporaryFile(dir=folder) as faces:
        completing = _Completing(pieces, space)
        sums = np.zeros((0, 3))
        first = 0
        while (mesh := (yield from completing.next_steps())) is not None:
            own, normals = completing.own, mesh.normals
            if normals is None:
                sums = yield from _normal_sums_steps(mesh, sums)
                length = np.sqrt(sums[:, 0] ** 2 + sums[:, 1] ** 2 + sums[:, 2] ** 2)
                length[length == 0] = 1.0
                normals = (sums / length[:, None]).astype(np.float32)
                sums = sums[own:]
            for part in parts_of(own):
                write_ply_vertices(vertices, mesh.vertices[:own][part], normals[:own][part])
            for part in parts_of(len(mesh.faces)):
                write_ply_faces(faces, mesh.faces[part] + np.int32(first))
                yield PAUSE
            first += own
            if first > MOST_NUMBERED:
                break
        written = completing.written(MOST_NUMBERED)
        write_ply_head(file, written.vertices, written.faces)
        total = vertices.tell() + faces.tell()
        for spooled in (vertices, faces):
            spooled.seek(0)
            while block := spooled.read(COPIED):
                file.write(block)
                yield Step(WRITING_SHARE + (1.0 - WRITING_SHARE) * min(1.0, file.tell() / total), "Writing the file")
        return written


def _normal_sums_steps(mesh: TriangleMesh, sums: NDArray[np.float64]) -> Steps[NDArray[np.float64]]:
    """Sums of the normals of the faces at each vertex, (V, 3), begun by the piece before for the first vertices.

    They are added in the order of the faces, as `vertex_normals` does for the whole surface: the same bits.
    """
    vectors = face_vectors(mesh.vertices, mesh.faces)
    yield PAUSE
    corners = np.concatenate([np.arange(len(sums)), mesh.faces.ravel()])
    out = np.empty((len(mesh.vertices), 3))
    for axis in range(3):
        added = np.concatenate([sums[:, axis], np.repeat(vectors[:, axis], 3)])
        out[:, axis] = np.bincount(corners, added, len(out))
        yield PAUSE
    return out


class _Completing(Generic[T]):
    """Gives each piece as a mesh with those vertices of the next that it needs, in the axes of the file."""

    def __init__(self, pieces: SurfacePieces[T], space: str) -> None:
        self.pieces, self.space = pieces, space
        self.held: SurfacePiece | None = None
        self.own = 0  # vertices of the mesh last given that are its piece's own
        self.vertices = self.faces = 0
        self.ended: list[T] = []

    def next_steps(self) -> Steps[TriangleMesh | None]:
        """The next piece; None after the last."""
        while not self.ended:
            try:
                item = next(self.pieces)
            except StopIteration as end:
                self.ended.append(end.value)
                break
            if isinstance(item, Step):
                yield Step(WRITING_SHARE * item.fraction, item.message)
                continue
            held, self.held = self.held, item
            if held is not None:
                return self._completed(held, item)
        held, self.held = self.held, None
        return None if held is None else self._completed(held, None)

    def _completed(self, piece: SurfacePiece, following: SurfacePiece | None) -> TriangleMesh:
        self.own = len(piece.vertices)
        self.vertices += self.own
        self.faces += len(piece.faces)
        vertices, normals = piece.vertices, piece.normals
        top = int(piece.faces.max(initial=-1)) + 1 - self.own
        if top > 0:
            if following is None or top > len(following.vertices):
                raise MeshError("a piece of a surface has triangles beyond the next piece; give the pieces in order")
            vertices = np.concatenate([vertices, following.vertices[:top]])
            if normals is not None and following.normals is not None:
                normals = np.concatenate([normals, following.normals[:top]])
        return TriangleMesh(vertices, piece.faces, normals).in_space(self.space)

    def written(self, most: int) -> WrittenPieces[T]:
        """The size of the whole."""
        if not self.faces:
            raise MeshError("there is no surface to write: no piece has a triangle")
        if max(self.vertices, self.faces) > most:
            raise MeshError(
                f"{self.faces} triangles are more than the file can count; simplify, or use a larger stride"
            )
        return WrittenPieces(self.vertices, self.faces, self.ended[0])


WRITERS: dict[str, Callable[[BinaryIO, SurfacePieces[T], str], Steps[WrittenPieces[T]]]] = dict(
    zip(SUFFIXES, (_stl_steps, _ply_steps), strict=True)
)
