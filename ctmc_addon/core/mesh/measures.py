# SPDX-License-Identifier: GPL-3.0-or-later
"""Area, volume, closedness, Euler number, number of components and quality of the triangles of a surface.

Lengths in the vertices' unit. `TriangleMesh.measures` gives the same at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..progress import PAUSE, Stages, Step, Steps
from .angles.triangle_angles import QualitySums, TriangleQuality, squared_length
from .pieces.piece_links import PieceLinks
from .topology import (
    FACES_PER_STEP,
    EdgeKeys,
    Topology,
    component_numbers_steps,
    edge_ends,
    edge_keys_steps,
    keys_of_edges_steps,
)

STAGES = {"Measuring area and volume": 3, "Measuring edges": 4, "Counting components": 3}
SMALL_SHARE = 0.001  # Components that enclose less than this share of the largest one are small.
MANY = 10  # From this number on small components are worth a word.
BLOCK = 1 << 15  # Work out the volumes of this many triangles at once: they fit the cache.


@dataclass(frozen=True)
class Measures:
    """Measures of one surface.

    Parameters
    ----------
    faces : int
    area : float
        Sum of the triangles' areas, in the square of the mesh's unit.
    volume : float
        Volume by the divergence theorem, in the cube of the mesh's unit: positive if the faces point outside.
        NaN for an open mesh, which encloses none.
    closed : bool
        Whether there are faces, and every edge has two that run through it in opposite ways.
    euler : int
        Vertices in use - edges + faces; 2 for every closed component without handles.
    components : int
        Number of connected components, the walls of cavities among them.
    small_components : int
        Components that enclose less than `small`, cavities among them; 0 if there are fewer than `MANY`.
    small : float
        The volume below which a component is small.
    vertices : int
        Vertices, in use or not.
    borders : int
        Connected lines of edges with one face: of a surface from a volume, where the volume or region cuts it.
    quality : TriangleQuality or None
        Quality of the triangles for simulation; None if there are none.
    size : (x, y, z) float or None
        Sides of the box around the triangles along the axes; None where there are none.
    cavities : int
        Components whose triangles point into what they enclose: walls of cavities; 0 if all do.
    """

    faces: int
    area: float
    volume: float
    closed: bool
    euler: int
    components: int
    small_components: int = 0
    small: float = 0.0
    borders: int = 0
    vertices: int = 0
    quality: TriangleQuality | None = None
    size: tuple[float, float, float] | None = None
    cavities: int = 0

    @property
    def bodies(self) -> int:
        """The number of connected components, each with its cavities."""
        return self.components - self.cavities

    @property
    def enclosed_volume(self) -> float | None:
        """The volume that a closed surface encloses; None for an open one."""
        return self.volume if self.closed else None

    @property
    def has_many_small_components(self) -> bool:
        """Whether to propose to remove the small components."""
        return self.small_components >= MANY


def measures_steps(
    vertices: NDArray[np.float32], faces: NDArray[np.int32], topology: Topology | None = None
) -> Steps[Measures]:
    """Measure a surface.

    Parameters
    ----------
    vertices : (V, 3) float32
    faces : (F, 3) int32
    topology : Topology, optional
        The edges and components, where someone else needs them too.

    Examples
    --------
    >>> from ctmc_addon.core import finish
    >>> corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 6]], np.float32)
    >>> faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)
    >>> measures = finish(measures_steps(corners, faces))
    >>> round(measures.volume, 6), measures.closed, measures.euler, measures.components
    (1.0, True, 2, 1)
    """
    measured = PieceMeasures()
    yield from measured.add_steps(vertices, faces, len(vertices), topology)
    return (yield from measured.measures_steps())


class PieceMeasures:
    """Measures of a surface that comes in pieces, taken from the first to the last; none is kept.

    Where the pieces are cut decides nothing: sums go on in the order of the triangles, about the first vertex. An edge
    between two vertices of the next piece waits for that piece's triangles. Of every component of a piece there are
    sums, from which its volume about its own middle follows when all pieces have come: with N the sum of the triangles'
    vectors and V the volume about another point that lies at -m from the middle, it is V - m . N / 3.
    """

    def __init__(self) -> None:
        self._links = PieceLinks()
        self._quality = QualitySums()
        self._sums: list[NDArray[np.float64]] = []  # of every component, (c, 8)
        self._origin = np.zeros(3)
        self._faces = self._edges = self._vertices = self._used_vertices = 0
        self._area = self._volume = 0.0  # six times the volume, so whole numbers stay exact
        self._closed = True
        self._borders = [np.empty((2, 0), np.int64)]  # edges with one triangle, vertices counted in the surface
        self._box: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None  # lowest and highest corner
        self._used = np.empty(0, bool)  # of the next piece's vertices by this one
        self._seam = np.empty(0, np.int64)  # edges between them, their triangles, and those that run up
        self._seam_counts = np.empty((2, 0), np.int64)

    def add_steps(
        self, vertices: NDArray[np.float32], faces: NDArray[np.int32], own: int, topology: Topology | None = None
    ) -> Steps[None]:
        """Add the next piece: its triangles, its `own` vertices, and the vertices of the following piece it needs."""
        stages = Stages(STAGES)
        sizes, edges, components = STAGES
        if not self._vertices and len(vertices):  # far from the origin the terms would cancel badly
            self._origin = vertices[0].astype(np.float64)
        first = self._vertices
        self._add_vertices(vertices, faces, own)
        self._faces += len(faces)
        if topology is None:
            counting = edge_keys_steps(faces, len(vertices))
        else:
            counting = keys_of_edges_steps(faces, *topology.edges)
        yield from stages.run(edges, self._add_edges_steps(counting, own, first))
        numbers = yield from stages.run(components, self._links.add_steps(faces, own, topology and topology.components))
        yield from stages.run(sizes, self._add_sums_steps(vertices, faces, numbers))

    def measures_steps(self) -> Steps[Measures]:
        """Return the measures of the surface after all pieces were added."""
        component = yield from self._links.joined_steps()
        sums = np.concatenate([np.empty((0, 8)), *self._sums])
        count = int(component.max(initial=-1)) + 1
        volume, *rest, faces = (np.bincount(component, column, count) for column in sums.T)
        vectors, corners = np.stack(rest[:3]), np.stack(rest[3:])  # (3, c) each
        volumes = (volume - (corners * vectors).sum(axis=0) / (3 * np.maximum(faces, 1))) / 6.0
        border, borders = np.concatenate(self._borders, axis=1), 0
        if border.shape[1]:
            numbers, ends = np.unique(border, return_inverse=True)
            borders = yield from _borders_steps(ends.reshape(border.shape).astype(np.int32), len(numbers))
        closed = self._closed and self._faces > 0
        small = _small_below(float(np.abs(volumes).max(initial=0.0)))
        cavities = int((volumes < 0).sum())
        return Measures(
            faces=self._faces,
            area=self._area,
            volume=self._volume / 6.0 if closed else math.nan,
            closed=closed,
            euler=self._used_vertices - self._edges + self._faces,
            components=count,
            small_components=int((np.abs(volumes) < small).sum()) if count >= MANY else 0,
            small=small,
            borders=borders,
            vertices=self._vertices,
            quality=self._quality.quality(),
            size=None if self._box is None else _sides(*self._box),
            cavities=cavities if cavities < count else 0,
        )

    def _add_vertices(self, vertices: NDArray[np.float32], faces: NDArray[np.int32], own: int) -> None:
        used = np.zeros(max(len(vertices), len(self._used)), bool)
        used[faces] = True
        used[: len(self._used)] |= self._used
        self._vertices += own
        in_use = int(np.count_nonzero(used[:own]))
        if in_use:
            corners = vertices[:own] if in_use == own else vertices[:own][used[:own]]
            box = corners.min(axis=0), corners.max(axis=0)
            before = box if self._box is None else self._box
            self._box = np.minimum(before[0], box[0]), np.maximum(before[1], box[1])
        self._used_vertices += in_use
        self._used = used[own:]

    def _add_edges_steps(self, counting: Steps[EdgeKeys], own: int, first: int) -> Steps[None]:
        keys, irregular, its_counts = yield from counting
        seam = int(np.searchsorted(keys, own << 31))  # the lower ends, in order
        at = np.searchsorted(keys, self._seam)
        again = keys.take(at, mode="clip") == self._seam if len(keys) else np.zeros(len(at), bool)
        self._finish_edges(self._seam[~again], self._seam_counts[:, ~again], first)
        # All others are closed by this piece alone.
        looked_at = np.unique(np.concatenate([irregular, at[again], np.arange(seam, len(keys))]))
        counts = np.repeat([[2], [1]], len(looked_at), axis=1)
        counts[:, np.searchsorted(looked_at, irregular)] = its_counts
        counts[:, np.searchsorted(looked_at, at[again])] += self._seam_counts[:, again]
        done = int(np.searchsorted(looked_at, seam))
        self._edges += seam - done
        self._finish_edges(keys[looked_at[:done]], counts[:, :done], first)
        self._seam = keys[seam:] - (own << 31 | own)
        self._seam_counts = counts[:, done:]

    def _finish_edges(self, keys: NDArray[np.int64], counts: NDArray[np.int64], first: int) -> None:
        count, upwards = counts
        self._edges += len(count)
        self._closed &= bool((count == 2).all() and (upwards == 1).all())
        self._borders.append(edge_ends(keys[count == 1]).astype(np.int64) + first)

    def _add_sums_steps(
        self, vertices: NDArray[np.float32], faces: NDArray[np.int32], numbers: NDArray[np.int32]
    ) -> Steps[None]:
        count = int(numbers.max(initial=-1)) + 1
        sums = np.zeros((8, count))
        for start in range(0, len(faces), FACES_PER_STEP):
            block, component = faces[start : start + FACES_PER_STEP], numbers[start : start + FACES_PER_STEP]
            # (3, f) each, in the order of C: NumPy adds long rows faster than rows of 3.
            a, b, c = (np.take(vertices, corner, axis=0).T.astype(np.float64, order="C") for corner in block.T)
            u, v = b - a, c - a
            vectors = np.stack([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])
            for corner in (a, b, c):
                corner -= self._origin[:, None]
            self._quality.add((a.T, b.T, c.T), vectors.T)
            volume = a[0] * vectors[0] + a[1] * vectors[1] + a[2] * vectors[2]
            self._area = _added(self._area, 0.5 * np.sqrt(squared_length(vectors.T)))
            self._volume = _added(self._volume, volume)
            columns = (volume, *vectors, *(a + b + c))
            for row, column in zip(sums, columns, strict=False):
                row += np.bincount(component, column, count)
            sums[7] += np.bincount(component, minlength=count)
            yield Step((start + len(block)) / len(faces))
        self._sums.append(sums.T)


def _small_below(largest: float) -> float:
    """Return the volume below which components are small: a thousandth of the largest, rounded down to one digit.

    Examples
    --------
    >>> _small_below(5000.0), _small_below(6.9), _small_below(0.0)
    (5.0, 0.006, 0.0)
    """
    if not largest:
        return 0.0
    share = f"{largest * SMALL_SHARE:.15e}"  # one digit less than floats have: 0.3 is 0.29999999999999998
    return float(share[0] + share[share.index("e") :])


def _sides(low: NDArray[np.float32], high: NDArray[np.float32]) -> tuple[float, float, float]:
    x, y, z = (high.astype(np.float64) - low.astype(np.float64)).tolist()
    return x, y, z


def _added(total: float, terms: NDArray[np.float64]) -> float:
    """Return the total with the terms added one after the other, so that it matters not where they are cut."""
    return float(np.cumsum(np.concatenate([[total], terms]))[-1])


def _borders_steps(ends: NDArray[np.int32], vertex_count: int) -> Steps[int]:
    """Return the number of connected lines that the edges between (2, E) vertices form."""
    if not ends.shape[1]:
        return 0
    component = yield from component_numbers_steps(np.ascontiguousarray(ends.T), vertex_count)
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
    columns, corners = [vertices[:, axis].astype(np.float64) for axis in range(3)], faces.T
    blocks = [slice(start, start + BLOCK) for start in range(0, len(faces), BLOCK)]
    values, middles = np.empty(len(faces)), []
    for along in columns:
        for block in blocks:
            a, b, c = (np.take(along, corner[block]) for corner in corners)
            values[block] = a + b + c
        yield PAUSE
        # bincount adds in the order of the faces: the same bits everywhere.
        middles.append(np.bincount(component, values, count) / corners_of)
    for block in blocks:
        own = component[block]
        offsets = [
            [np.take(along, corner[block]) - np.take(middle, own) for corner in corners]
            for along, middle in zip(columns, middles, strict=True)
        ]
        values[block] = triple_products(offsets)
        yield PAUSE
    return np.bincount(component, values, count) / 6.0


def component_moments_steps(
    vertices: NDArray[np.float32], faces: NDArray[np.int32], component: NDArray[np.int32]
) -> Steps[NDArray[np.float64]]:
    """Return sums over the faces of every component, (components, 8), from the component of every face, (F,).

    Sums of the parts of a component add up to those of the whole, so `volumes_of_moments` gives its volume wherever it
    is cut: six times the volume about the origin, twice the area vector, the sum of all corners, their number.
    """
    count = int(component.max()) + 1 if len(component) else 0
    columns, corners = [vertices[:, axis].astype(np.float64) for axis in range(3)], faces.T
    rows = np.empty((7, len(faces)))
    for start in range(0, len(faces), BLOCK):
        block = slice(start, start + BLOCK)
        a, b, c = ([np.take(along, corner[block]) for along in columns] for corner in corners)
        for row, ends in zip(rows[4:], zip(a, b, c, strict=True), strict=True):
            row[block] = ends[0] + ends[1] + ends[2]
        first, second = ([to - of for to, of in zip(ends, a, strict=True)] for ends in (b, c))
        for axis in range(3):
            y, z = axis - 2, axis - 1
            rows[1 + axis, block] = first[y] * second[z] - first[z] * second[y]
        rows[0, block] = a[0] * rows[1, block] + a[1] * rows[2, block] + a[2] * rows[3, block]
        yield PAUSE
    sums = [np.bincount(component, row, count) for row in rows]
    return np.stack([*sums, 3.0 * np.bincount(component, minlength=count)], axis=1)


def volumes_of_moments(moments: NDArray[np.float64]) -> NDArray[np.float64]:
    """Signed volumes about the middle of each component, (n,), from moments (n, 8)."""
    middles = moments[:, 4:7] / np.maximum(moments[:, 7:], 1.0)
    x, y, z = (middles * moments[:, 1:4]).T
    return (moments[:, 0] - (x + y + z)) / 6.0


def triple_products(columns: Sequence[Sequence[NDArray[np.float64]]]) -> NDArray[np.float64]:
    """Six times the signed volume between every face and the origin, (F,), from x, y and z of its corners."""
    (ax, bx, cx), (ay, by, cy), (az, bz, cz) = columns
    return ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
