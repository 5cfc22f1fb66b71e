# SPDX-License-Identifier: GPL-3.0-or-later
"""Third pass: gather the triangles' corners.

Every corner of a triangle is a crossed edge of its voxel. The edge's owner is the voxel whose lowest corner is the
edge's low end, and the vertex on the edge along axis a of the owner stands at `vertex_of[a, owner's slot]`. So all
that has to be found is the slot of the owner, without a search. Example: edge 5 runs along y (5 // 4 = 1) from the
voxel's corner 1, which is one further along x; edge 7 runs along y from corner 5, one further along x and z.

    along x    The next slot. Where x % 8 = 7, this is place 0 of the next rank; and that is the right byte, since
               the owner of a crossed edge is active, so that its byte is in the list.
    along y    A byte that is pitch / 8 higher; its rank is looked up in a map of a few layers of bytes. The place in
               the byte is the same. Along z, or y and z, likewise.

So the voxel at slot 57 = 8 * 7 + 1 of active_voxels.py's example (byte 113), for edge 7: the byte one layer up is
113 + 5 * 16 = 193; say its rank is 12. The slot there is 8 * 12 + 1 = 97, one further along x is 98, and the corner's
number is `vertex_of[1, 98]`. Edges in the slab's top layer of samples belong to the next slab: its first layer's
ranks are appended to this slab's.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .active_voxels import BYTE, Slab
from .case_table import EDGES, CornerLists
from .order import SlabPositions

MAP_BYTES = 1 << 17  # Look up the ranks of this many bytes of samples at once: the map stays in the cache.
VOXELS_AT_ONCE = 1 << 15  # Look up the corners of this many voxels at once, for the same reason.
# Write the corners of up to this many voxels in one call: more calls would take longer than the writing.
FEW_VOXELS = 1 << 9


def fill_faces(
    slab: Slab, places: SlabPositions, following: tuple[Slab, SlabPositions] | None, out: NDArray[np.int32]
) -> None:
    """Write the triangles of a slab.

    Parameters
    ----------
    places : SlabPositions
        Positions of the slab's vertices and triangles.
    following : (Slab, SlabPositions) or None
        The next slab, or its first layer alone, and where its vertices stand: the edges in this one's top layer of
        samples are that one's.
    out : (F, 3) int32
        The triangles of all slabs.
    """
    top = _first_layer_bytes(None if following is None else following[0])
    slots = _slots_of_neighbors(slab, top)
    vertex_of = _vertex_numbers(slab, places, following, top)
    voxels, size = len(slab.slot), vertex_of.shape[1]
    # Where in `slots` an edge's owner stands, or the voxel before the owner along x; and where in `vertex_of` from
    # that slot on its vertex is. Both flat: added to the voxel's number, and to the slot.
    neighbor_of_edge = [(low >> 1) * voxels for low, _ in EDGES] + [0] * 3
    offset_of_edge = [edge // 4 * size + (low & 1) for edge, (low, _) in enumerate(EDGES)]
    offset_of_edge += [interior * size for interior in range(3, 6)]
    corners = slab.tables.corners
    neighbor_of_corner = np.array(neighbor_of_edge, np.intp).take(corners.edges)
    offset_of_corner = np.array(offset_of_edge, np.int32).take(corners.edges)

    by_kind = np.argsort(slab.corner_list_kind, kind="stable")
    ends = np.cumsum(slab.segments.voxels.sum(axis=1)).tolist()
    for kind, ((begin, end), runs) in enumerate(zip(pairwise(ends), places.faces, strict=False), 1):
        corner_count, columns = CornerLists.columns(kind)
        for first in range(0, end - begin, VOXELS_AT_ONCE):
            voxel = by_kind[begin + first : min(begin + first + VOXELS_AT_ONCE, end)]
            configuration = slab.configuration.take(voxel).astype(np.intp)
            # All (corner_count, voxels): into flat `slots`, then into flat `vertex_of`.
            neighbor_index = neighbor_of_corner[:corner_count].take(configuration, axis=1, mode="clip")
            neighbor_index += voxel
            vertex_flat_index = slots.take(neighbor_index, mode="clip")
            vertex_flat_index += offset_of_corner[:corner_count].take(configuration, axis=1, mode="clip")
            vertices = vertex_of.take(vertex_flat_index, mode="clip")
            for items, rows in runs.pieces(first, len(voxel)):
                block = out[rows].reshape(-1, len(columns))
                if len(block) < FEW_VOXELS:
                    block[:] = vertices[:, items].take(columns, axis=0).T
                    continue
                for column, source in enumerate(columns):
                    block[:, column] = vertices[source, items]


def _first_layer_bytes(slab: Slab | None) -> NDArray[np.intp]:
    """Return the bytes of a slab's first layer."""
    if slab is None:
        return np.zeros(0, np.intp)
    return slab.byte[: np.searchsorted(slab.byte, slab.rows * slab.pitch // BYTE)]


def _slots_of_neighbors(slab: Slab, top: NDArray[np.intp]) -> NDArray[np.int32]:
    """Slots of every voxel and of those one row, one layer and both further, (4, n); at random where not active."""
    bytes_in_row = slab.pitch // BYTE
    bytes_in_layer = slab.rows * bytes_in_row
    ranked = np.concatenate([slab.byte, top + (slab.high - slab.low) * bytes_in_layer])
    first_slot = np.empty((3, len(slab.byte)), np.int32)  # of the bytes one row, one layer and both further
    height = max(1, MAP_BYTES // bytes_in_layer - 1)
    for low in range(0, slab.high - slab.low, height):
        high = min(low + height, slab.high - slab.low)
        begin, end, map_end = np.searchsorted(ranked, np.array([low, high, high + 1]) * bytes_in_layer)
        rank_of = np.empty((high - low + 1) * bytes_in_layer, np.int32)
        local = ranked[begin:map_end] - low * bytes_in_layer
        rank_of[local] = np.arange(begin, map_end, dtype=np.int32)
        local = local[: end - begin]
        for step, ranks in zip((bytes_in_row, bytes_in_layer, bytes_in_layer + bytes_in_row), first_slot, strict=True):
            ranks[begin:end] = rank_of.take(local + step, mode="clip")
    first_slot *= BYTE
    slots = np.empty((4, len(slab.slot)), np.int32)
    slots[0] = slab.slot
    rank, place_in_byte = slab.slot >> 3, slots[0] & 7
    for neighbor, first in zip(slots[1:], first_slot, strict=True):
        np.take(first, rank, out=neighbor, mode="clip")
        neighbor += place_in_byte
    return slots


def _vertex_numbers(
    slab: Slab, places: SlabPositions, following: tuple[Slab, SlabPositions] | None, top: NDArray[np.intp]
) -> NDArray[np.int32]:
    """Numbers of the vertices on edges along x, y, z and inside voxels, by slot; other slots are left as they are."""
    interior = slab.interior_counts
    slots = len(slab.byte) * BYTE
    numbers = np.empty((3 + int(interior.max(initial=0)), slots + len(top) * BYTE), np.int32)
    *edges, inside = (runs.places() for runs in places.vertices)
    for row, of_axis, place in zip(numbers, slab.edge_slots, edges, strict=False):
        row[of_axis] = place
    last = np.cumsum(interior, dtype=np.intp)
    for number, row in enumerate(numbers[3:]):
        has_vertex = interior > number
        row[slab.slot.take(slab.with_interior[has_vertex])] = inside[(last - interior)[has_vertex] + number]
    if following is not None:
        above, above_places = following
        for row, of_axis, runs in zip(numbers, above.edge_slots[:2], above_places.vertices, strict=False):
            of_top = of_axis[: np.searchsorted(of_axis, len(top) * BYTE)]
            start = runs.starts[0]  # those of a slab's lowest layer stand together
            row[of_top + slots] = np.arange(start, start + len(of_top), dtype=np.int32)
    return numbers
