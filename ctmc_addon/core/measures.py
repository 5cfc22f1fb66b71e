"""What can be measured on a finished surface, in steps short enough to stop at any moment.

The same numbers as `TriangleMesh` gives at once; lengths in the mesh's unit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .mesh import FACES_AT_ONCE, TriangleMesh, face_vectors, finding_roots
from .progress import Step, Steps, said, within

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
    """Number of edges, and whether the mesh is closed: half edges are gathered by their lower vertex, then sorted."""
    shelves = max(1, min(255, 3 * len(faces) // FACES_AT_ONCE))
    shelf_size = -(-vertices // shelves) or 1
    shelf: list[list[NDArray[np.int64]]] = [[] for _ in range(shelves)]
    blocks = _blocks(len(faces), FACES_AT_ONCE // 2)
    for number, part in enumerate(blocks):
        start = faces[part].ravel().astype(np.int64)
        end = faces[part][:, (1, 2, 0)].ravel().astype(np.int64)
        low, backward = np.minimum(start, end), start > end
        half = (low * vertices + np.maximum(start, end)) * 2 + backward
        at = (low // shelf_size).astype(np.uint8)
        order = np.argsort(at, kind="stable")
        ends = np.cumsum(np.bincount(at, minlength=shelves))[:-1]
        for into, some in zip(shelf, np.split(half[order], ends), strict=True):
            into.append(some)
        yield Step(0.5 * (number + 1) / len(blocks), MESSAGE)
    edges, closed = 0, len(faces) > 0
    for number, pieces in enumerate(shelf):
        keys = np.sort(np.concatenate(pieces)) if pieces else np.empty(0, np.int64)
        edge = keys >> 1
        starts = np.flatnonzero(np.concatenate([[True], edge[1:] != edge[:-1]])) if len(edge) else edge
        edges += len(starts)
        # Closed: every edge twice, once in either way.
        closed = closed and len(edge) == 2 * len(starts) and bool((keys[::2] + 1 == keys[1::2]).all())
        yield Step(0.5 + 0.5 * (number + 1) / shelves, MESSAGE)
    return edges, bool(closed)


def _parts(faces: NDArray[np.int32], vertices: int) -> Steps[tuple[int, int]]:
    """Vertices in use, and the number of connected parts."""
    used = np.zeros(vertices, bool)
    used[faces] = True
    lowest = yield from said(finding_roots(faces, vertices), 0.0, MESSAGE)
    roots = used & (lowest == np.arange(vertices, dtype=np.int32))
    return int(used.sum()), int(roots.sum())
