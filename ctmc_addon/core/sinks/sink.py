# SPDX-License-Identifier: GPL-3.0-or-later
"""The interface of all sinks: they receive a surface and keep it or write it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path

from ..mesh.measures import Measures
from ..mesh.triangle_mesh import Pieces, Surface, TriangleMesh
from ..progress import Steps


@dataclass(frozen=True, eq=False)
class Taken:
    """Parts of a surface that a sink keeps in memory.

    Parameters
    ----------
    mesh : TriangleMesh
        The surface at alpha; empty if it was written to a file.
    surface : Surface or None
        The surface at both ends of alpha, if the sink keeps them.
    measured : Measures or None
        Measures of the surface that was written to a file.
    wrong_side : int or None
        Samples of a label on the wrong side of the surface; None without a label.
    """

    mesh: TriangleMesh
    surface: Surface | None = None
    measured: Measures | None = None
    wrong_side: int | None = None


class Sink(ABC):
    """Receives a surface, in pieces or as a simplified mesh.

    Attributes
    ----------
    normals : bool
        Whether it shows the normals of vertices, so that they must be made.
    holds : bool
        Whether the full surface is in memory anyway, so that its pieces may be kept for another look.
    folder : Path or None
        Has room for what is written; None where nothing is.
    """

    normals = True
    holds = False
    folder: Path | None = None

    @abstractmethod
    def full_steps(self, pieces: Pieces, alpha: float) -> Steps[Taken]:
        """Take the full surface as its pieces come, at `alpha`."""

    @abstractmethod
    def mesh_steps(self, mesh: TriangleMesh) -> Steps[Taken]:
        """Receive a simplified mesh in RAS+ mm.

        Parameters
        ----------
        mesh : TriangleMesh
            (V, 3) float32 vertices and (F, 3) int32 faces.

        Returns
        -------
        Taken

        Raises
        ------
        OutputError
            If a file cannot be written.
        """
