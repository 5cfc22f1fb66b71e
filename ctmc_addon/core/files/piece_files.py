# SPDX-License-Identifier: GPL-3.0-or-later
"""Write a surface that comes in pieces as STL or PLY, with the same bytes as `TriangleMesh.save` for the whole."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError, OutputError
from ..mesh.face_normals import face_vectors
from ..mesh.measures import Measures, PieceMeasures
from ..mesh.pieces.completed_pieces import completed_pieces_steps
from ..mesh.triangle_mesh import SurfacePieces, TriangleMesh
from ..progress import PAUSE, Step, Steps, WithResult, finish
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

COPIED = 1 << 24  # Copy this many bytes between two steps.
WRITING_SHARE = 0.9  # This share of the work is done when the last piece has come.
MOST_NUMBERED = np.iinfo(np.int32).max  # A PLY can number this many vertices.
MOST_FACETS = np.iinfo(np.uint32).max  # An STL can count this many facets.


@dataclass(frozen=True)
class _WrittenPieces(Generic[T]):
    """Size and measures of a written surface, and the result of the generator of its pieces."""

    vertices: int
    faces: int
    measured: Measures
    info: T


def write_pieces_steps(
    path: str | os.PathLike[str], pieces: SurfacePieces[T], space: str = "ras"
) -> Steps[_WrittenPieces[T]]:
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
        with whole_file(target) as temporary, temporary.open("wb") as file:
            return (yield from writer(file, pieces, space))
    finally:
        pieces.close()


def _stl_steps(file: IO[bytes], pieces: SurfacePieces[T], space: str) -> Steps[_WrittenPieces[T]]:
    """Write facets; their number precedes them in the file, so it is written last."""
    write_stl_head(file, 0)
    source, measured = WithResult(completed_pieces_steps(pieces)), PieceMeasures()
    vertices = faces = 0
    for item in source:
        if isinstance(item, Step):
            yield _while_writing(item)
            continue
        finish(measured.add_steps(item.mesh.vertices, item.mesh.faces, item.own))
        mesh = item.mesh.in_space(space)
        vertices += item.own
        faces += len(mesh.faces)
        _require_countable(faces, faces, MOST_FACETS)
        for part in parts_of(len(mesh.faces)):
            write_stl_facets(file, mesh.vertices.take(mesh.faces[part], axis=0))
            yield PAUSE
    _require_triangles(faces)
    file.seek(0)
    write_stl_head(file, faces)
    return _WrittenPieces(vertices, faces, (yield from measured.measures_steps()), source.result)


def _ply_steps(file: IO[bytes], pieces: SurfacePieces[T], space: str) -> Steps[_WrittenPieces[T]]:
    """Write a PLY; vertices precede faces, and their numbers precede both, so both wait in unnamed files."""
    folder = Path(file.name).parent
    with tempfile.TemporaryFile(dir=folder) as of_vertices, tempfile.TemporaryFile(dir=folder) as of_faces:
        source, measured = WithResult(completed_pieces_steps(pieces)), PieceMeasures()
        sums = np.zeros((0, 3))
        vertices = faces = 0
        for item in source:
            if isinstance(item, Step):
                yield _while_writing(item)
                continue
            finish(measured.add_steps(item.mesh.vertices, item.mesh.faces, item.own))
            mesh, own = item.mesh.in_space(space), item.own
            vertices += own
            faces += len(mesh.faces)
            _require_countable(faces, max(vertices, faces), MOST_NUMBERED)
            normals = mesh.normals
            if normals is None:
                sums = yield from _normal_sums_steps(mesh, sums)
                length = np.sqrt(sums[:, 0] ** 2 + sums[:, 1] ** 2 + sums[:, 2] ** 2)
                length[length == 0] = 1.0
                normals = (sums / length[:, None]).astype(np.float32)
                sums = sums[own:]
            for part in parts_of(own):
                write_ply_vertices(of_vertices, mesh.vertices[:own][part], normals[:own][part])
            for part in parts_of(len(mesh.faces)):
                write_ply_faces(of_faces, mesh.faces[part] + np.int32(item.first))
                yield PAUSE
        _require_triangles(faces)
        write_ply_head(file, vertices, faces)
        total = of_vertices.tell() + of_faces.tell()
        for spooled in (of_vertices, of_faces):
            spooled.seek(0)
            while block := spooled.read(COPIED):
                file.write(block)
                yield Step(WRITING_SHARE + (1.0 - WRITING_SHARE) * min(1.0, file.tell() / total), "Writing the file")
        return _WrittenPieces(vertices, faces, (yield from measured.measures_steps()), source.result)


def _while_writing(step: Step) -> Step:
    return Step(WRITING_SHARE * step.fraction, step.message)


def _require_triangles(faces: int) -> None:
    if not faces:
        raise MeshError("there is no surface to write: no piece has a triangle")


def _require_countable(faces: int, count: int, most: int) -> None:
    if count > most:
        raise MeshError(
            f"a surface of more than {faces} triangles is larger than the file can count; simplify, "
            "or use a larger stride"
        )


def _normal_sums_steps(mesh: TriangleMesh, sums: NDArray[np.float64]) -> Steps[NDArray[np.float64]]:
    """Return sums of the normals of the faces at each vertex, (V, 3), begun by the piece before for the first vertices.

    They are added in the order of the faces, as in `vertex_normals` for the whole surface, so the bits are the same.
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


WRITERS: dict[str, Callable[[IO[bytes], SurfacePieces[T], str], Steps[_WrittenPieces[T]]]] = dict(
    zip(SUFFIXES, (_stl_steps, _ply_steps), strict=True)
)
