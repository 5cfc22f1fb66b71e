# SPDX-License-Identifier: GPL-3.0-or-later
"""Hold a surface in memory, both ends of alpha."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError
from ..mesh.triangle_mesh import Pieces, Surface, TriangleMesh
from ..progress import PAUSE, Step, Steps, WithResult
from .sink import Sink, Taken


class Hold(Sink):
    """Joins the pieces to one surface."""

    holds = True

    def full_steps(self, pieces: Pieces, alpha: float) -> Steps[Taken]:
        """Take the full surface as its pieces come."""
        held: list[Surface] = []
        source = WithResult(pieces)
        for item in source:
            if isinstance(item, Step):
                yield item
            else:
                held.append(item)
        surface = yield from joined_steps(held)
        yield PAUSE
        mesh = surface.at(alpha)
        yield PAUSE
        return Taken(mesh, surface, wrong_side=source.result)

    def mesh_steps(self, mesh: TriangleMesh) -> Steps[Taken]:
        """Take a mesh that is done."""
        yield PAUSE
        return Taken(mesh)


HOLD = Hold()


def joined_steps(pieces: list[Surface]) -> Steps[Surface]:
    """Return one surface of all its pieces, using them up; of a single piece, the piece itself."""
    if len(pieces) == 1:
        return pieces.pop()
    vertices = np.cumsum([0] + [len(piece.linear) for piece in pieces], dtype=np.int64)
    if vertices[-1] > np.iinfo(np.int32).max:
        raise MeshError(f"{vertices[-1]} vertices are more than a mesh can number; use a larger stride")

    def joined(take: Callable[[Surface], NDArray[Any]]) -> NDArray[Any]:
        return np.concatenate([take(piece) for piece in pieces])

    midpoints = joined(lambda piece: piece.midpoints)
    yield PAUSE
    linear = joined(lambda piece: piece.linear)
    yield PAUSE
    all_normals = [piece.normals for piece in pieces if piece.normals is not None]
    normals = np.concatenate(all_normals) if all_normals else None
    yield PAUSE
    faces = joined(lambda piece: piece.faces)
    yield PAUSE
    start = 0
    for piece, first in zip(pieces, vertices, strict=False):
        faces[start : start + len(piece.faces)] += np.int32(first)
        start += len(piece.faces)
        yield PAUSE
    pieces.clear()
    return Surface(midpoints, linear, faces, normals)
