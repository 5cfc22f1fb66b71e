# SPDX-License-Identifier: GPL-3.0-or-later
"""The pieces of a surface as meshes: each with those vertices of the next that its triangles need."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ...errors import MeshError
from ...progress import Step, WithResult
from ..triangle_mesh import SurfacePiece, SurfacePieces, TriangleMesh

T = TypeVar("T")
Piece = TypeVar("Piece")


@dataclass(frozen=True, eq=False)
class CompletedPiece:
    """A piece as a mesh.

    Parameters
    ----------
    mesh : TriangleMesh
    own : int
        Number of the piece's own vertices; they come first.
    first : int
        Number of its first vertex in the whole surface; the others follow, those of the next piece too.
    """

    mesh: TriangleMesh
    own: int
    first: int


def with_next_steps(pieces: Generator[Step | Piece, None, T]) -> Generator[Step | tuple[Piece, Piece | None], None, T]:
    """Yield every piece with the next one, the last with None, and the steps between; closes `pieces` at the end."""
    held: Piece | None = None
    source = WithResult(pieces)
    for item in source:
        if isinstance(item, Step):
            yield item
            continue
        if held is not None:
            yield held, item
        held = item
    if held is not None:
        yield held, None
    return source.result


def completed_pieces_steps(pieces: SurfacePieces[T]) -> Generator[Step | CompletedPiece, None, T]:
    """Yield every piece when the next has come, and the steps between; closes `pieces` at the end.

    Raises
    ------
    MeshError
        If triangles reach beyond the next piece.
    """
    first = 0
    source = WithResult(with_next_steps(pieces))
    for item in source:
        if isinstance(item, Step):
            yield item
        else:
            yield _completed(*item, first)
            first += len(item[0].vertices)
    return source.result


def _completed(piece: SurfacePiece, following: SurfacePiece | None, first: int) -> CompletedPiece:
    vertices, normals, own = piece.vertices, piece.normals, len(piece.vertices)
    beyond = int(piece.faces.max(initial=-1)) + 1 - own
    if beyond > 0:
        if following is None or beyond > len(following.vertices):
            raise MeshError("a piece of a surface has triangles beyond the next piece; give the pieces in order")
        vertices = np.concatenate([vertices, following.vertices[:beyond]])
        if normals is not None and following.normals is not None:
            normals = np.concatenate([normals, following.normals[:beyond]])
    return CompletedPiece(TriangleMesh(vertices, piece.faces, normals), own, first)
