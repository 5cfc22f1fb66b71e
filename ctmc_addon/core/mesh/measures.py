# SPDX-License-Identifier: GPL-3.0-or-later
"""Area, volume, closedness, Euler number and number of components of a surface.

Lengths in the vertices' unit. `TriangleMesh.measures` gives the same at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..progress import PAUSE, Stages, Step, Steps
from .face_normals import face_vectors
from .topology import FACES_PER_STEP, component_numbers_steps, edge_counts_steps

STAGES = {"Measuring area and volume": 3, "Measuring edges": 4, "Counting components": 3}
SMALL = 10.0  # components that enclose less are small, in the cube of the mesh's unit
MANY = 10  # small components are worth a word


@dataclass(frozen=True)
class Measures:
    """Measures of one surface.

    Parameters
    ----------
    faces : int
    area : float
        Sum of the triangles' areas, in the square of the mesh's unit.
    volume : float
        By the divergence theorem, in the cube of the mesh's unit: positive where the faces point outside.
        NaN for an open mesh, which encloses none.
    closed : bool
        Whether there are faces, and every edge has two that run through it in opposite ways.
    euler : int
        Vertices in use - edges + faces; 2 for every closed component without handles.
    components : int
        Number of connected components.
    small_components : int
        How many of them enclose less than `SMALL`, cavities among them; 0 where there are fewer than `MANY` components.
    vertices : int
        In use or not.
    borders : int
        Connected lines of edges with one face: of a surface from a volume, where the volume or region cuts it.
    """

    faces: int
    area: float
    volume: float
    closed: bool
    euler: int
    components: int
    small_components: int = 0
    borders: int = 0
    vertices: int = 0

    @property
    def enclosed_volume(self) -> float | None:
        """The volume that a closed surface encloses; None for an open one."""
        return self.volume if self.closed else None

    @property
    def has_many_small_components(self) -> bool:
        """Whether to propose to remove the small components."""
        return self.small_components >= MANY

    @property
    def milliliters(self) -> float:
        """The volume of a mesh in mm, in ml."""
        return self.volume / 1000.0

    @property
    def square_centimeters(self) -> float:
        """The area of a mesh in mm, in cm2."""
        return self.area / 100.0


def measures_steps(vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> Steps[Measures]:
    """Measure a surface.

    Parameters
    ----------
    vertices : (V, 3) float32
    faces : (F, 3) int32

    Examples
    --------
    >>> from ctmc_addon.core import finish
    >>> corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 6]], np.float32)
    >>> faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)
    >>> measures = finish(measures_steps(corners, faces))
    >>> round(measures.volume, 6), measures.closed, measures.euler, measures.components
    (1.0, True, 2, 1)
    """
    sizes, edges, components = STAGES
    stages = Stages(STAGES)
    area, volume = yield from stages.run(sizes, _sizes_steps(vertices, faces))
    counting = edge_counts_steps(faces, len(vertices))
    ends, count, upwards = yield from stages.run(edges, counting)
    borders = yield from borders_steps(ends[:, count == 1], len(vertices))
    closed = len(faces) > 0 and bool((count == 2).all() and (upwards == 1).all())
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    total, small = yield from stages.run(components, _components_steps(vertices, faces))
    volume = volume if closed else float("nan")
    return Measures(
        len(faces),
        area,
        volume,
        closed,
        int(used.sum()) - len(count) + len(faces),
        total,
        small,
        borders,
        len(vertices),
    )


def borders_steps(ends: NDArray[np.int32], vertex_count: int) -> Steps[int]:
    """Number of connected lines that the edges between (2, E) vertices form."""
    if not ends.shape[1]:
        return 0
    as_faces = np.ascontiguousarray(ends[[0, 1, 1]].T)
    component = yield from component_numbers_steps(as_faces, vertex_count)
    return int(component.max()) + 1


def component_volumes_steps(
    vertices: NDArray[np.float32], faces: NDArray[np.int32], component: NDArray[np.int32]
) -> Steps[NDArray[np.float64]]:
    """Signed volume of every component, (components,), from the component of every face, (F,).

    Negative for a cavity, whose faces point into the hole. Each component is measured about its own middle:
    for one that is open at the border that is the volume of the cone over its rim, near the truth.
    """
    count = int(component.max()) + 1 if len(component) else 0
    corners_of = np.bincount(component, minlength=count) * 3
    columns = []
    for axis in range(3):
        yield PAUSE
        a, b, c = (vertices[corner, axis].astype(np.float64) for corner in faces.T)  # (F,) each
        yield PAUSE
        middle = (np.bincount(component, a + b + c, count) / corners_of)[component]
        columns.append((a - middle, b - middle, c - middle))
    yield PAUSE
    triple = triple_products(columns)
    yield PAUSE
    # bincount adds in the order of the faces: the same bits everywhere.
    return np.bincount(component, triple, count) / 6.0


def triple_products(columns: Sequence[Sequence[NDArray[np.float64]]]) -> NDArray[np.float64]:
    """Six times the signed volume between every face and the origin, (F,), from x, y and z of its corners."""
    (ax, bx, cx), (ay, by, cy), (az, bz, cz) = columns
    return ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)


def _components_steps(vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> Steps[tuple[int, int]]:
    """Number of components, and how many of them are small."""
    component = yield from component_numbers_steps(faces, len(vertices))
    count = int(component.max()) + 1 if len(component) else 0
    if count < MANY:
        return count, 0
    volumes = yield from component_volumes_steps(vertices, faces, component)
    return count, int((np.abs(volumes) < SMALL).sum())


def _sizes_steps(vertices: NDArray[np.float32], faces: NDArray[np.int32]) -> Steps[tuple[float, float]]:
    """Area and volume."""
    area, volume = 0.0, 0.0
    if not len(faces):
        return area, volume
    # About the mesh's own middle: far from the origin the terms would cancel badly.
    middle = (vertices.min(axis=0).astype(np.float64) + vertices.max(axis=0)) / 2
    for start in range(0, len(faces), FACES_PER_STEP):
        block = faces[start : start + FACES_PER_STEP]
        vectors = face_vectors(vertices, block)  # (f, 3)
        area += float(0.5 * np.sqrt((vectors**2).sum(axis=1)).sum())
        volume += float(((vertices[block[:, 0]] - middle) * vectors).sum() / 6.0)
        yield Step((start + len(block)) / len(faces))
    return area, volume
