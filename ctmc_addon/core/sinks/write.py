# SPDX-License-Identifier: GPL-3.0-or-later
"""Write a surface to STL or PLY as it comes, so that memory follows a piece of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..files.piece_files import write_pieces_steps
from ..mesh.triangle_mesh import Pieces, TriangleMesh, at_alpha_steps
from ..progress import Step, Steps
from .sink import Sink, Taken

NOTHING = TriangleMesh(np.empty((0, 3), np.float32), np.empty((0, 3), np.int32))


@dataclass(frozen=True)
class Write(Sink):
    """Writes a surface to a file, whole or not at all.

    Parameters
    ----------
    path : Path
        Ends in .stl or .ply.
    space : {"ras", "lps"}
        Axes of the file.
    """

    path: Path
    space: str = "ras"

    @property
    def normals(self) -> bool:  # type: ignore[override]
        """Return whether the file shows the normals of vertices: STL has only those of its facets."""
        return self.path.suffix.lower() == ".ply"

    @property
    def folder(self) -> Path:  # type: ignore[override]
        """The folder of the file."""
        return self.path.parent

    def full_steps(self, pieces: Pieces, alpha: float) -> Steps[Taken]:
        """Take the full surface as its pieces come."""
        written = yield from write_pieces_steps(self.path, at_alpha_steps(pieces, alpha), self.space)
        return Taken(NOTHING, measured=written.measured, wrong_side=written.info)

    def mesh_steps(self, mesh: TriangleMesh) -> Steps[Taken]:
        """Take a mesh that is done."""
        yield Step(0.0, "Measuring the surface")
        measured = mesh.measures
        yield Step(0.5, "Writing the surface")
        mesh.save(self.path, self.space)
        return Taken(NOTHING, measured=measured)
