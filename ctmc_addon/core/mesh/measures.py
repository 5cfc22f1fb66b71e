"""What can be measured on a finished surface, in steps short enough to stop at any moment.

The same numbers as `TriangleMesh` gives at once; lengths in the mesh's unit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..progress import Step, Steps, said, within
from .triangle_mesh import FACES_AT_ONCE, TriangleMesh, face_vectors, finding_edges, finding_roots

MESSAGE = "Measuring"


@dataclass(frozen=True)
class Measures:
    """Measures of one surface.

    Parameters
    ----------
    faces : int
    area, volume : float
        In the square and the cube of the mesh's unit.
    closed : bool
        Whether every edge has two triangles that run through it in opposite ways.
    euler : int
        Vertices in use - edges + faces.
    parts : int
        Number of connected parts.
    """

    faces: int
    area: float
    volume: float
    closed: bool
    euler: int
    parts: int

    @property
    def millilitres(self) -> float:
        """The volume of a mesh in mm, in ml."""
        return self.volume / 1000.0

    @property
    def square_centimetres(self) -> float:
        """The area of a mesh in mm, in cm2."""
        return self.area / 100.0


def measures_steps(mesh: TriangleMesh) -> Steps[Measures]:
    """Measure a mesh.

    Examples
    --------
    >>> from ctmc_addon.core.progress import finish
    >>> corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 6]], np.float32)
    >>> faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)
    >>> found = finish(measures_steps(TriangleMesh(corners, faces)))
    >>> round(found.volume, 6), found.closed, found.euler, found.parts
    (1.0, True, 2, 1)
    """
    area, volume = yield from within(_sizes(mesh), 0.0, 0.3)
    edges, closed = yield from within(_edges(mesh.faces, len(mesh.vertices)), 0.3, 0.7)
    used, parts = yield from within(_parts(mesh.faces, len(mesh.vertices)), 0.7, 1.0)
    return Measures(len(mesh.faces), area, volume, closed, used - edges + len(mesh.faces), parts)


def _blocks(count: int, size: int = FACES_AT_ONCE) -> list[slice]:
    return [slice(start, min(start + size, count)) for start in range(0, count, size)]


def _sizes(mesh: TriangleMesh) -> Steps[tuple[float, float]]:
    """Area and enclosed volume."""
    area, volume = 0.0, 0.0
    if not len(mesh.faces):
        return 0.0, 0.0
    # About the mesh's own middle: far from the origin the terms would cancel badly.
    middle = (mesh.vertices.min(axis=0).astype(np.float64) + mesh.vertices.max(axis=0)) / 2
    for part in _blocks(len(mesh.faces)):
        faces = mesh.faces[part]
        vectors = face_vectors(mesh.vertices, faces)  # (f, 3)
        first = mesh.vertices[faces[:, 0]] - middle
        area += float(0.5 * np.sqrt((vectors**2).sum(axis=1)).sum())
        volume += float((first * vectors).sum() / 6.0)
        yield Step(part.stop / len(mesh.faces), MESSAGE)
    return area, volume


def _edges(faces: NDArray[np.int32], vertices: int) -> Steps[tuple[int, bool]]:
    """Number of edges, and whether the mesh is closed: every edge is run through twice, once in either way."""
    columns = np.ascontiguousarray(faces.T)
    edges, face_edges = yield from said(finding_edges(columns, vertices), 0.0, MESSAGE)
    uses, forward = np.zeros(edges.shape[1], np.int64), np.zeros(edges.shape[1], np.int64)
    for corner, start, end in zip(face_edges, columns, columns[[1, 2, 0]], strict=True):
        yield Step(0.9, MESSAGE)
        uses += np.bincount(corner, minlength=len(uses))
        forward += np.bincount(corner[start < end], minlength=len(uses))
    return edges.shape[1], len(faces) > 0 and bool((uses == 2).all() and (forward == 1).all())


def _parts(faces: NDArray[np.int32], vertices: int) -> Steps[tuple[int, int]]:
    """Vertices in use, and the number of connected parts."""
    used = np.zeros(vertices, bool)
    used[faces] = True
    lowest = yield from said(finding_roots(faces, vertices), 0.0, MESSAGE)
    roots = used & (lowest == np.arange(vertices, dtype=np.int32))
    return int(used.sum()), int(roots.sum())
