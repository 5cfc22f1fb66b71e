"""Gather the triangles' corners from a map of edge to vertex number, a few layers at a time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .active import Slab
from .cases import CLASSIC, EDGES, TriangleTables

MAP_SAMPLES = 1 << 18  # samples whose edges' vertex numbers are looked up at once: they stay in the cache
MAP_SHARE = 8  # or as many for each vertex: where the surface is dense, more layers at once save time
FEW_VOXELS = 1000  # of as many triangles: below it the calls cost more than the work
MOST = int(CLASSIC.triangle_count.max())  # triangles of a voxel, but for some ambiguous ones


def fill_faces(slab: Slab, following: Slab | None, first_vertex: int, out: NDArray[np.int32]) -> None:
    """Write the triangles of a slab whose own vertices are numbered from `first_vertex`.

    Parameters
    ----------
    following : Slab or None
        The next slab: the edges in this one's top layer of samples are that one's.
    out : (slab.faces, 3) int32
    """
    layer = slab.rows * slab.pitch
    places, vertices = _numbered_edges(slab, following, first_vertex)
    own = slab.tables.own_count.take(slab.row.take(slab.inner))
    first_own = np.cumsum(own, dtype=np.int32) - own + np.int32(first_vertex + sum(map(len, slab.owned)))
    count = slab.tables.triangle_count.take(slab.row)
    count *= slab.whole
    height = min(slab.high - slab.low, max(1, max(MAP_SAMPLES, MAP_SHARE * slab.vertices) // layer))
    vertex_of = np.empty((3, (height + 1) * layer), np.int32)
    steps = (1, slab.pitch, layer)
    offset_of_edge = np.array(
        [
            edge // 4 * vertex_of.shape[1] + sum(steps[axis] for axis in range(3) if low >> axis & 1)
            for edge, (low, _) in enumerate(EDGES)
        ]
        + [0, 0, 0],  # own vertices come last
        np.intp,
    )
    offsets = offset_of_edge.take(slab.tables.triangle_edges)
    start = 0
    for first in range(0, slab.high - slab.low, height):
        last = min(first + height, slab.high - slab.low)
        for kind in range(3):
            known = slice(*np.searchsorted(places[kind], (first * layer, (last + 1) * layer)))
            vertex_of[kind, places[kind][known] - first * layer] = vertices[kind][known]
        voxels = slice(*np.searchsorted(slab.place, (first * layer, last * layer)))
        base = slab.place[voxels] - np.int32(first * layer)
        part = out[start : start + int(count[voxels].sum(dtype=np.int64))]
        start += len(part)
        inner = slice(*np.searchsorted(slab.inner, (voxels.start, voxels.stop)))
        own_vertices = slab.inner[inner] - voxels.start, first_own[inner]
        _gather(slab.tables, offsets, vertex_of.ravel(), base, slab.row[voxels], count[voxels], own_vertices, part)


def _numbered_edges(
    slab: Slab, following: Slab | None, first_vertex: int
) -> tuple[list[NDArray[np.intp]], list[NDArray[np.int32]]]:
    """Place and vertex number of the crossed edges along x, y and z."""
    places, vertices = [], []
    vertex, next_vertex = first_vertex, first_vertex + slab.vertices
    for axis in range(3):
        place = [slab.place.take(slab.owned[axis]).astype(np.intp)]
        number = [np.arange(vertex, vertex + len(place[0]), dtype=np.int32)]
        vertex += len(place[0])
        if following is not None and axis < 2:
            owned = following.place.take(following.owned[axis])
            owned = owned[: np.searchsorted(owned, following.rows * following.pitch)]
            x, y, _ = following.samples(owned)
            top = ((slab.high - slab.low) * slab.rows + (y - slab.y)) * slab.pitch + (x - slab.x)
            place.append(top.astype(np.intp))
            number.append(np.arange(next_vertex, next_vertex + len(top), dtype=np.int32))
            next_vertex += len(following.owned[axis])
        places.append(np.concatenate(place))
        vertices.append(np.concatenate(number))
    return places, vertices


def _gather(
    tables: TriangleTables,
    offsets: NDArray[np.intp],
    numbers: NDArray[np.int32],
    base: NDArray[np.int32],
    row: NDArray[np.int16],
    count: NDArray[np.uint8],
    own_vertices: tuple[NDArray[np.intp], NDArray[np.int32]],
    out: NDArray[np.int32],
) -> None:
    """Write the voxels' triangles, those of voxels with one triangle first, then those with two, and so on."""
    every = offsets.reshape(-1)
    by_count = np.argsort(count, kind="stable")
    ends = np.cumsum(np.bincount(count))
    start = 0
    for triangles in range(1, min(len(ends), MOST + 1)):
        voxels = by_count[ends[triangles - 1] : ends[triangles]]
        at_voxel = base.take(voxels).astype(np.intp)
        first = tables.first_triangle.take(row.take(voxels)) * 3
        part = out[start : start + triangles * len(voxels)].reshape(-1, 3 * triangles)
        start += triangles * len(voxels)
        if len(voxels) < FEW_VOXELS:
            corners = first[:, None] + np.arange(3 * triangles)
            part[:] = numbers.take(every[corners] + at_voxel[:, None], mode="clip")
            continue
        for corner in range(3 * triangles):
            at = every[corner:].take(first)
            at += at_voxel
            part[:, corner] = numbers.take(at, mode="clip")
    if len(ends) <= MOST + 1:
        return
    voxels = by_count[ends[MOST] :]
    some = count.take(voxels).astype(np.intp)
    of = np.repeat(np.arange(len(voxels)), some)
    first = tables.first_triangle.take(row.take(voxels)) - (np.cumsum(some) - some)
    triangle = np.arange(len(of)) + first.take(of)
    last = out[start:]
    last[:] = numbers.take(offsets.take(triangle, axis=0) + base.take(voxels).take(of)[:, None], mode="clip")
    edges = tables.triangle_edges.take(triangle, axis=0)  # (triangles, 3)
    own, which = np.nonzero(edges >= len(EDGES))
    inner, first_own = own_vertices
    last[own, which] = first_own[np.searchsorted(inner, voxels[of[own]])] + (edges[own, which] - len(EDGES))
