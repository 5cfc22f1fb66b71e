# SPDX-License-Identifier: GPL-3.0-or-later
"""The crossed edges and the triangles of some layers of samples, a band.

Vertices stand band by band. In a band come those on edges along x, then y, then z, then points on faces whose normal
is z, then y, then x, then points inside voxels; each list in the order of the samples that own them. So what stands in
a band's lowest layer begins its lists, where the band below finds it. A sample owns the edges and the faces that begin
there, as the lowest corner of a voxel. Bands have as many layers as the size of a layer gives, on every machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..case_table import CLASSIC, EDGES, FACES
from .owners import Owners
from .voxel_patterns import (
    FACE_CORNERS,
    FACE_POINT,
    INNER_POINT,
    PatternTables,
    faces_with_points,
    pattern_numbers,
    tables_of,
)

BAND_SAMPLES = 1 << 20
OWN_FACES = (4, 2, 0)  # Faces at a voxel's lowest corner, with normals z, y and x.
FACE_LIST = tuple({4: 3, 5: 3, 2: 4, 3: 4, 0: 5, 1: 5}[face] for face in range(6))
FACE_EDGES = np.array(
    [[edge for edge, ends in enumerate(EDGES) if set(ends) <= set(face)] for face in FACES], np.intp
)  # Shape (6, 4).


@dataclass(frozen=True, eq=False)
class Band:
    """The layers `low` to `high` of voxels, and their crossings.

    Parameters
    ----------
    low, high : int
    edges : three (n,) intp
        Flat samples, counted from the band's first, that own a crossed edge along x, y and z.
    plain : (p,) intp
        Flat samples of voxels with two owners.
    mixed : (m,) intp
        Flat samples of voxels with three owners or more.
    owners : (m, 8)
        Owners of the corners of those.
    has_point : (m, 6) bool
        On which faces of those three or more owners meet.
    pattern : (m,) intp
        Patterns of those, as numbered in `tables`.
    tables : PatternTables
    touching : (t, 2) intp
        Pairs of labels that share a voxel, each once.
    """

    low: int
    high: int
    edges: tuple[NDArray[np.intp], ...]
    plain: NDArray[np.intp]
    mixed: NDArray[np.intp]
    owners: NDArray[Any]
    has_point: NDArray[np.bool_]
    pattern: NDArray[np.intp]
    tables: PatternTables
    touching: NDArray[np.intp]

    @property
    def counts(self) -> list[int]:
        """Return the number of vertices in each list."""
        points = [int(np.count_nonzero(self.has_point[:, face])) for face in OWN_FACES]
        inner = int(np.diff(self.tables.first_inner)[self.pattern].sum())
        return [*map(len, self.edges), *points, inner]


@dataclass(frozen=True, eq=False)
class BandFaces:
    """The triangles of a band.

    Parameters
    ----------
    faces : (f, 3) int32
        Vertex numbers of the whole complex, in index space.
    sides : (f, 2)
        Labels counted from 1; behind is the larger.
    on_cap : (f,) bool
        Whether the triangle belongs to a voxel beyond the outermost samples.
    point_edges : (e,) int32
        Vertices on edges that the points on faces, then inside voxels, are means of.
    point_first : (p + 1,) intp
        Start of the edges of each point.
    """

    faces: NDArray[np.int32]
    sides: NDArray[Any]
    on_cap: NDArray[np.bool_]
    point_edges: NDArray[np.int32]
    point_first: NDArray[np.intp]


def band_ranges(shape: Sequence[int]) -> list[tuple[int, int]]:
    """Return the layers of voxels of each band."""
    layers, rows, columns = shape
    step = max(1, BAND_SAMPLES // (rows * columns))
    return [(low, min(low + step, layers - 1)) for low in range(0, layers - 1, step)]


def find_band(owners: Owners, low: int, high: int, skipped: NDArray[np.bool_] | None = None) -> Band:
    """Find the crossed edges and voxels in the layers `low` to `high` of voxels, but for those `skipped` (z, y, x)."""
    number = owners.number[low : high + 1]
    rows, columns = number.shape[1:]
    layer = rows * columns
    flat = number.reshape(-1)
    own = (high - low) * layer
    crossed = [np.zeros((high - low + 1, rows, columns), bool) for _ in range(3)]
    np.not_equal(number[..., 1:], number[..., :-1], out=crossed[0][..., :-1])
    np.not_equal(number[:, 1:], number[:, :-1], out=crossed[1][:, :-1])
    np.not_equal(number[1:], number[:-1], out=crossed[2][:-1])
    edges = tuple(np.flatnonzero(along[:-1]) for along in crossed)
    # A voxel is active if one of its edges is crossed.
    active = crossed[0].reshape(-1)  # marked in place, the edges are known
    for along in crossed[1:]:
        active |= along.reshape(-1)
    for step in (1, columns, layer):
        active[:-step] |= active[step:]
    # Marks have also come to the last row and column, which have no voxels.
    cells = active.reshape(-1, rows, columns)
    cells[-1] = cells[:, -1] = cells[..., -1] = False
    if skipped is not None:
        cells[:-1] &= ~skipped[low:high]
    voxel = np.flatnonzero(active[:own])
    corners = np.array([(corner & 1) + (corner >> 1 & 1) * columns + (corner >> 2) * layer for corner in range(8)])
    at_corners = flat.take(voxel[:, None] + corners)  # (n, 8)
    largest, lowest = at_corners.max(axis=1), at_corners.min(axis=1)
    of_two = ((at_corners == largest[:, None]) | (at_corners == lowest[:, None])).all(axis=1)
    is_plain = of_two & (largest != lowest)
    mixed = at_corners[~of_two]
    numbers, pattern = np.unique(pattern_numbers(mixed), return_inverse=True)
    pairs = np.sort(mixed.astype(np.intp), axis=1)
    pairs = np.concatenate(
        [np.stack([lowest, largest], axis=1)[is_plain].astype(np.intp), *(pairs[:, at : at + 2] for at in range(7))]
    )
    most = int(pairs.max(initial=0)) + 1
    keys = np.unique(pairs[:, 0] * most + pairs[:, 1])
    touching = np.stack([keys // most, keys % most], axis=1)
    touching = touching[(touching[:, 0] > 0) & (touching[:, 0] < touching[:, 1])]
    return Band(
        low,
        high,
        edges,
        voxel[is_plain],
        voxel[~of_two],
        mixed,
        faces_with_points(mixed),
        pattern.reshape(-1),
        tables_of(numbers),
        touching,
    )


class _Numbers:
    """The vertex numbers of a band: on edges and faces by the flat sample that owns them, and by their voxel inside."""

    def __init__(self, band: Band, starts: Sequence[int], above: Band | None, above_starts: Sequence[int], layer: int):
        self.size = (band.high - band.low + 1) * layer
        self.edges = [np.empty(self.size, np.int32) for _ in range(3)]
        top = (band.high - band.low) * layer
        for numbers, flat, start in zip(self.edges, band.edges, starts, strict=False):
            numbers[flat] = np.arange(start, start + len(flat), dtype=np.int32)
        if above is not None:
            for numbers, flat, start in zip(self.edges[:2], above.edges, above_starts, strict=False):
                lowest = flat[: np.searchsorted(flat, layer)]
                numbers[lowest + top] = np.arange(start, start + len(lowest), dtype=np.int32)
        self.points: dict[int, tuple[NDArray[np.intp], NDArray[np.int32]]] = {}
        for at, face in enumerate(OWN_FACES, 3):
            flat = band.mixed[band.has_point[:, face]]
            numbers = np.arange(starts[at], starts[at] + len(flat), dtype=np.int32)
            if above is not None and face == OWN_FACES[0]:
                beyond = above.mixed[above.has_point[:, face]]
                beyond = beyond[: np.searchsorted(beyond, layer)]
                flat = np.concatenate([flat, beyond + top])
                start = above_starts[at]
                numbers = np.concatenate([numbers, np.arange(start, start + len(beyond), dtype=np.int32)])
            self.points[at] = flat, numbers
        inner = np.diff(band.tables.first_inner)[band.pattern]
        self.inner = starts[6] + np.cumsum(inner) - inner  # the first of every mixed voxel


def fill_band(
    owners: Owners, band: Band, starts: Sequence[int], above: Band | None, above_starts: Sequence[int]
) -> BandFaces:
    """Return the triangles of a band.

    Parameters
    ----------
    starts, above_starts : sequence of 7 int
        Start of each list of vertices of this band and of the one above.
    """
    rows, columns = owners.number.shape[1:]
    layer = rows * columns
    numbers = _Numbers(band, starts, above, above_starts, layer)
    corner_steps = np.array([(c & 1) + (c >> 1 & 1) * columns + (c >> 2) * layer for c in range(8)], np.intp)
    edge_steps = corner_steps[[low for low, _ in EDGES]]

    def on_edges(voxel: NDArray[np.intp], edge: NDArray[np.intp]) -> NDArray[np.int32]:
        flat = voxel + edge_steps.take(edge)
        out = np.empty(len(flat), np.int32)
        for axis in range(3):
            own = np.flatnonzero(edge // 4 == axis)
            out[own] = numbers.edges[axis].take(flat[own])
        return out

    # Voxels of two owners.
    flat_owners = owners.number[band.low : band.high + 1].reshape(-1)
    at_corners = flat_owners.take(band.plain[:, None] + corner_steps)
    largest, lowest = at_corners.max(axis=1), at_corners.min(axis=1)
    case = np.packbits(at_corners == largest[:, None], axis=1, bitorder="little")[:, 0]
    count = CLASSIC.triangle_count.take(case).astype(np.intp)
    voxel = np.repeat(np.arange(len(band.plain)), count)
    within = np.arange(len(voxel)) - np.repeat(np.cumsum(count) - count, count)
    triangle = CLASSIC.triangle_edges[CLASSIC.first_triangle.take(case).take(voxel) + within]
    faces = on_edges(np.repeat(band.plain.take(voxel), 3), triangle.reshape(-1)).reshape(-1, 3)
    sides = np.stack([largest.take(voxel), lowest.take(voxel)], axis=1)
    flat_voxel = band.plain.take(voxel)

    # Voxels of three owners or more.
    tables = band.tables
    count = np.diff(tables.first_triangle)[band.pattern]
    voxel = np.repeat(np.arange(len(band.mixed)), count)
    within = np.arange(len(voxel)) - np.repeat(np.cumsum(count) - count, count)
    triangle_number = tables.first_triangle[band.pattern].take(voxel) + within
    nodes = tables.triangles[triangle_number]
    corner_of_side = tables.sides[triangle_number]
    mixed_sides = np.take_along_axis(band.owners[voxel], corner_of_side, axis=1)
    mixed_faces = np.empty(nodes.shape, np.int32)
    of_edge = nodes < FACE_POINT
    at_voxel = np.broadcast_to(voxel[:, None], nodes.shape)
    mixed_faces[of_edge] = on_edges(band.mixed[at_voxel[of_edge]], nodes[of_edge])
    of_inner = nodes >= INNER_POINT
    mixed_faces[of_inner] = numbers.inner[at_voxel[of_inner]] + nodes[of_inner] - INNER_POINT
    for face in range(6):
        of_face = nodes == FACE_POINT + face
        step = corner_steps[FACE_CORNERS[face]].min()
        flat, point_numbers = numbers.points[FACE_LIST[face]]
        own_flat = band.mixed[at_voxel[of_face]] + step
        mixed_faces[of_face] = point_numbers.take(np.searchsorted(flat, own_flat), mode="clip")
    turned = mixed_sides[:, 0] < mixed_sides[:, 1]
    mixed_faces[turned] = mixed_faces[turned][:, ::-1]
    mixed_sides[turned] = mixed_sides[turned][:, ::-1]

    # What the points are means of.
    edge_lists, counts = [], []
    for face in OWN_FACES:
        own = np.flatnonzero(band.has_point[:, face])
        ends = np.array([EDGES[edge] for edge in FACE_EDGES[face]])  # (4, 2)
        crossed = band.owners[own][:, ends[:, 0]] != band.owners[own][:, ends[:, 1]]  # (n, 4)
        at, which = np.nonzero(crossed)
        edge_lists.append(on_edges(band.mixed[own[at]], FACE_EDGES[face][which]))
        counts.append(np.count_nonzero(crossed, axis=1))
    inner_count = np.diff(tables.first_inner)[band.pattern]
    voxel = np.repeat(np.arange(len(band.mixed)), inner_count)
    within = np.arange(len(voxel)) - np.repeat(np.cumsum(inner_count) - inner_count, inner_count)
    inner = tables.first_inner[band.pattern].take(voxel) + within
    count = np.diff(tables.inner_first)[inner]
    point = np.repeat(np.arange(len(inner)), count)
    within = np.arange(len(point)) - np.repeat(np.cumsum(count) - count, count)
    edge = tables.inner_edges[tables.inner_first[inner].take(point) + within]
    edge_lists.append(on_edges(band.mixed[voxel[point]], edge))
    counts.append(count)
    point_first = np.concatenate([[0], np.cumsum(np.concatenate(counts))]).astype(np.intp)

    flat_voxel = np.concatenate([flat_voxel, np.repeat(band.mixed, np.diff(tables.first_triangle)[band.pattern])])
    z, rest = np.divmod(flat_voxel, layer)
    y, x = np.divmod(rest, columns)
    z += band.low
    on_cap = (x == 0) | (x == columns - 2) | (y == 0) | (y == rows - 2)
    on_cap |= (z == 0) | (z == owners.number.shape[0] - 2)
    return BandFaces(
        np.concatenate([faces, mixed_faces]),
        np.concatenate([sides, mixed_sides]),
        on_cap,
        np.concatenate(edge_lists),
        point_first,
    )
