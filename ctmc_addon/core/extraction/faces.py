"""Gather the triangles' corners: a voxel's edge leads to the voxel that owns it, and that to the vertex's number."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .active_voxels import EIGHT, Slab
from .case_table import EDGES, Corners

MAP_EIGHTS = 1 << 17  # eights of samples whose numbers are looked up at once: they stay in the cache
AT_ONCE = 1 << 14  # voxels whose corners are looked up at once, for the same reason


def fill_faces(slab: Slab, following: Slab | None, first_vertex: int, out: NDArray[np.int32]) -> None:
    """Write the triangles of a slab whose own vertices are numbered from `first_vertex`.

    Those of one kind follow one another: voxels with one triangle first, then those with two, and so on.

    Parameters
    ----------
    following : Slab or None
        The next slab: the edges in this one's top layer of samples are that one's.
    out : (slab.faces, 3) int32
    """
    top = _first_layer(following)
    cells = _row_cells(slab, top)
    vertex_of = _numbers(slab, following, top, first_vertex)
    voxels, size = len(slab.cell), vertex_of.shape[1]
    # An edge's low corner is in one of four rows; along it lies the voxel that owns the edge, or the one after it.
    row_of_edge = [(low >> 1) * voxels for low, _ in EDGES] + [0] * 3
    place_of_edge = [edge // 4 * size + (low & 1) for edge, (low, _) in enumerate(EDGES)]
    place_of_edge += [own * size for own in range(3, 6)]
    corners = slab.tables.corners
    row_of_corner = np.array(row_of_edge, np.intp)[corners.edges]
    place_of_corner = np.array(place_of_edge, np.int32)[corners.edges]

    kind = corners.kind.take(slab.row)
    kind *= slab.whole
    by_kind = np.argsort(kind, kind="stable")
    ends = np.cumsum(np.bincount(kind)).tolist()
    start = 0
    for number, (begin, end) in enumerate(pairwise(ends), 1):
        looked_up, columns = Corners.columns(number)
        for first in range(begin, end, AT_ONCE):
            voxel = by_kind[first : min(first + AT_ONCE, end)]
            corner = corners.first.take(slab.row.take(voxel)) + np.arange(looked_up)[:, None]
            at = row_of_corner.take(corner)
            at += voxel
            place = cells.take(at)
            place += place_of_corner.take(corner)
            vertices = vertex_of.take(place, mode="clip")
            part = out[start : start + len(columns) // 3 * len(voxel)].reshape(len(voxel), len(columns))
            start += len(columns) // 3 * len(voxel)
            for column, looked in enumerate(columns):
                part[:, column] = vertices[looked]


def _first_layer(slab: Slab | None) -> NDArray[np.intp]:
    """The eights of a slab's first layer."""
    if slab is None:
        return np.zeros(0, np.intp)
    return slab.eight[: np.searchsorted(slab.eight, slab.rows * slab.pitch // EIGHT)]


def _row_cells(slab: Slab, top: NDArray[np.intp]) -> NDArray[np.int32]:
    """Cells of every voxel and of those one row, one layer and both further, (4, n); at random where not active."""
    in_row = slab.pitch // EIGHT
    in_layer = slab.rows * in_row
    eights = np.concatenate([slab.eight, top + (slab.high - slab.low) * in_layer])
    first_cell = np.empty((3, len(slab.eight)), np.int32)
    height = max(1, MAP_EIGHTS // in_layer - 1)
    for low in range(0, slab.high - slab.low, height):
        high = min(low + height, slab.high - slab.low)
        begin, end, known = np.searchsorted(eights, np.array([low, high, high + 1]) * in_layer)
        number = np.empty((high - low + 1) * in_layer, np.int32)
        here = eights[begin:known] - low * in_layer
        number[here] = np.arange(begin, known, dtype=np.int32)
        here = here[: end - begin]
        for step, cell in zip((in_row, in_layer, in_layer + in_row), first_cell, strict=True):
            cell[begin:end] = number.take(here + step, mode="clip")
    first_cell *= EIGHT
    eight, within = slab.cell >> 3, (slab.cell & 7).astype(np.int32)
    cells = np.empty((4, len(slab.cell)), np.int32)
    cells[0] = slab.cell
    for row, cell in zip(cells[1:], first_cell, strict=True):
        np.take(cell, eight, out=row, mode="clip")
        row += within
    return cells


def _numbers(slab: Slab, following: Slab | None, top: NDArray[np.intp], first_vertex: int) -> NDArray[np.int32]:
    """Vertex numbers of the crossed edges along x, y, z and of the voxels' own vertices, by cell."""
    own = slab.tables.own_count.take(slab.row.take(slab.inner))
    cells = len(slab.eight) * EIGHT
    numbers = np.empty((3 + int(own.max(initial=0)), cells + len(top) * EIGHT), np.int32)
    vertex = first_vertex
    for axis in range(3):
        owned = slab.owned[axis]
        numbers[axis][slab.cell.take(owned)] = np.arange(vertex, vertex + len(owned), dtype=np.int32)
        vertex += len(owned)
    first_own = np.cumsum(own, dtype=np.int32) - own + np.int32(vertex)
    for number in range(len(numbers) - 3):
        has = own > number
        numbers[3 + number][slab.cell.take(slab.inner[has])] = first_own[has] + number
    if following is not None:
        vertex = first_vertex + slab.vertices
        voxels = np.searchsorted(following.cell, len(top) * EIGHT)
        for axis in range(2):
            owned = following.owned[axis]
            of_top = owned[: np.searchsorted(owned, voxels)]
            at = following.cell.take(of_top) + cells
            numbers[axis][at] = np.arange(vertex, vertex + len(of_top), dtype=np.int32)
            vertex += len(owned)
    return numbers
