# SPDX-License-Identifier: GPL-3.0-or-later
"""The forms a surface travels in.

`Surface` holds what extraction knows: for every vertex both ends of alpha. `TriangleMesh` is the
surface at one alpha, and `SurfacePiece` one slab of that, where nobody holds all of it. They are in
whatever space their positions are in: index space or RAS+ mm.
"""

from __future__ import annotations

import os
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..files import mesh_files
from ..files.map_names import NamedValues
from ..progress import Step, WithResult, finish
from .measures import Measures, measures_steps

T = TypeVar("T")


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
    def measures(self) -> Measures:
        """Measure area, volume, closedness, Euler number and components at once."""
        return finish(measures_steps(self.vertices, self.faces))

    @property
    def area(self) -> float:
        """Sum of the triangles' areas, in the square of the vertices' unit."""
        return self.measures.area

    @property
    def volume(self) -> float:
        """Volume by the divergence theorem, positive where the faces point outside; NaN for an open mesh."""
        return self.measures.volume

    @property
    def enclosed_volume(self) -> float | None:
        """The volume that a closed mesh encloses; None for an open one."""
        return self.measures.enclosed_volume

    @property
    def closed(self) -> bool:
        """Whether there are triangles and every edge has two of them, which run through it in opposite ways."""
        return self.measures.closed

    @property
    def euler(self) -> int:
        """Vertices in use - edges + faces; 2 for every closed component without handles."""
        return self.measures.euler

    @property
    def components(self) -> int:
        """Number of connected components."""
        return self.measures.components

    def in_space(self, space: str) -> TriangleMesh:
        """Return a surface in RAS+ mm in the axes of `space`, "ras" or "lps"; half a turn, so the winding stays."""
        if space == "ras":
            return self
        turn = np.array([-1, -1, 1], np.float32)
        normals = None if self.normals is None else self.normals * turn
        return TriangleMesh(self.vertices * turn, self.faces, normals)

    def save(self, path: str | os.PathLike[str], space: str = "ras", maps: Sequence[NamedValues] = ()) -> None:
        """Write a surface in RAS+ mm to a binary STL or PLY, whole or not at all; the suffix chooses the format.

        Parameters
        ----------
        path : path
            Ends in .stl or .ply; its folder exists.
        space : {"ras", "lps"}
            Axes of the file.
        maps : sequence of SurfaceMap
            Each becomes a float property of a PLY's vertices; an STL holds none.

        Raises
        ------
        OutputError
            For another suffix, a map of another surface, or a place that cannot be written to.
        """
        turned = self.in_space(space)
        mesh_files.write_mesh(path, turned.vertices, turned.faces, turned.normals, maps)


@dataclass(frozen=True, eq=False)
class SurfacePiece:
    """Triangles of one slab of slices; pieces come in the order of the slices.

    A triangle has its corners in its own piece and in the next one: neighbors share the vertices of one seam.

    Parameters
    ----------
    vertices : (v, 3) float32
        Positions (x, y, z).
    faces : (f, 3) int32
        Counter-clockwise seen from outside. Numbers below v are vertices of this piece, v + n is vertex n of the next.
    normals : (v, 3) float32 or None
        Unit length, pointing outside.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    normals: NDArray[np.float32] | None = None


# Pieces with both ends of alpha, and signs of life between them; returns the samples of a label on the wrong side.
Pieces = Generator["Step | Surface", None, "int | None"]
# The same at one alpha; what it returns is up to whoever made it.
SurfacePieces = Generator[Step | SurfacePiece, None, T]


@dataclass(frozen=True, eq=False)
class Surface:
    """Extracted surface: every vertex at both ends of alpha (Su and Ma, eq. 5 to 7).

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
        """Return the surface at `alpha`, computed in float32 in the order in which Blender mixes a shape key."""
        return TriangleMesh(blend(self.midpoints, self.linear, alpha), self.faces, self.normals)


def replayed_steps(pieces: Sequence[Surface], result: int | None = None) -> Pieces:
    """Yield pieces that are in memory, and return the result of their maker."""
    yield Step()
    yield from pieces
    return result


def at_alpha_steps(pieces: Pieces, alpha: float) -> SurfacePieces[int | None]:
    """Yield the same pieces at one alpha, and the steps between."""
    source = WithResult(pieces)
    for item in source:
        if isinstance(item, Step):
            yield item
        else:
            yield SurfacePiece(blend(item.midpoints, item.linear, alpha), item.faces, item.normals)
    return source.result


def blend(midpoints: NDArray[np.float32], linear: NDArray[np.float32], alpha: float) -> NDArray[np.float32]:
    """``midpoints + alpha * (linear - midpoints)`` in float32, step by step as Blender mixes a shape key."""
    mixed = linear - midpoints
    mixed *= np.float32(alpha)
    mixed += midpoints
    return mixed
