# SPDX-License-Identifier: GPL-3.0-or-later
"""Active voxels and their vertices of some layers of samples, cut apart and put together again along the slices.

Values are read in slabs as high as memory allows, and vertices are numbered in slabs of equal work (scan.py), whose
ends are known only when all values were seen. So parts are made as the values come and grouped anew afterwards.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..extraction.active_voxels import BYTE, Slab
from ..extraction.faces import fill_faces


@dataclass(frozen=True, eq=False)
class SlabPart:
    """What was extracted of the sample layers `slab.low` to `slab.high`, but for the faces.

    Parameters
    ----------
    slab : Slab
        The active voxels; layers are counted in the whole volume.
    vectors : tuple of (v, 3) float32
        Of every vertex, in the order of the slab: midpoint, linear crossing and, where asked for, normal.
    """

    slab: Slab
    vectors: tuple[NDArray[np.float32], ...]

    @property
    def low(self) -> int:
        """First layer."""
        return self.slab.low

    @property
    def high(self) -> int:
        """End of the layers, left out."""
        return self.slab.high


def split_at(part: SlabPart, layer: int) -> tuple[SlabPart, SlabPart]:
    """The part's layers below one, and from that one on."""
    slab = part.slab
    layer_bytes = (layer - slab.low) * slab.rows * (slab.pitch // BYTE)
    byte = int(np.searchsorted(slab.byte, layer_bytes))
    voxel = int(np.searchsorted(slab.slot, byte * BYTE))
    edges = [int(np.searchsorted(owners, voxel)) for owners in slab.edge_owners]
    interior = int(np.searchsorted(slab.with_interior, voxel))
    lower = replace(
        slab,
        high=layer,
        byte=slab.byte[:byte],
        slot=slab.slot[:voxel],
        configuration=slab.configuration[:voxel],
        is_cell=slab.is_cell[:voxel],
        edge_owners=tuple(owners[:end] for owners, end in zip(slab.edge_owners, edges, strict=True)),
        with_interior=slab.with_interior[:interior],
        corner_values=slab.corner_values[:interior],
    )
    upper = replace(
        slab,
        low=layer,
        byte=slab.byte[byte:] - layer_bytes,
        slot=slab.slot[voxel:] - byte * BYTE,
        configuration=slab.configuration[voxel:],
        is_cell=slab.is_cell[voxel:],
        edge_owners=tuple(owners[end:] - voxel for owners, end in zip(slab.edge_owners, edges, strict=True)),
        with_interior=slab.with_interior[interior:] - voxel,
        corner_values=slab.corner_values[interior:],
    )
    ends = segment_ends(slab)
    cuts = [start + count for start, count in zip(ends, segment_counts(lower), strict=False)]
    below = tuple(
        np.concatenate([vectors[start:cut] for start, cut in zip(ends, cuts, strict=False)]) for vectors in part.vectors
    )
    above = tuple(
        np.concatenate([vectors[cut:end] for cut, end in zip(cuts, ends[1:], strict=True)]) for vectors in part.vectors
    )
    return SlabPart(lower, below), SlabPart(upper, above)


def joined(parts: list[SlabPart]) -> SlabPart:
    """One part of several that follow one another."""
    if len(parts) == 1:
        return parts[0]
    slabs = [part.slab for part in parts]
    first = slabs[0]
    layer_bytes = first.rows * (first.pitch // BYTE)
    voxels = np.cumsum([0] + [len(slab.slot) for slab in slabs]).tolist()
    bytes_ = np.cumsum([0] + [len(slab.byte) for slab in slabs]).tolist()
    slab = replace(
        first,
        high=slabs[-1].high,
        byte=np.concatenate([slab.byte + (slab.low - first.low) * layer_bytes for slab in slabs]),
        slot=np.concatenate([slab.slot + at * BYTE for slab, at in zip(slabs, bytes_, strict=False)]),
        configuration=np.concatenate([slab.configuration for slab in slabs]),
        is_cell=np.concatenate([slab.is_cell for slab in slabs]),
        edge_owners=tuple(
            np.concatenate([slab.edge_owners[axis] + at for slab, at in zip(slabs, voxels, strict=False)])
            for axis in range(3)
        ),
        with_interior=np.concatenate([slab.with_interior + at for slab, at in zip(slabs, voxels, strict=False)]),
        corner_values=np.concatenate([slab.corner_values for slab in slabs]),
    )
    ends = [segment_ends(slab) for slab in slabs]
    vectors = tuple(
        np.concatenate(
            [
                part.vectors[number][end[segment] : end[segment + 1]]
                for segment in range(4)
                for part, end in zip(parts, ends, strict=True)
            ]
        )
        for number in range(len(parts[0].vectors))
    )
    return SlabPart(slab, vectors)


def segment_counts(slab: Slab) -> list[int]:
    """How many vertices of a slab lie on edges along x, y and z, and inside voxels."""
    return [*(len(owners) for owners in slab.edge_owners), slab.vertex_count - slab.edge_vertex_count]


def segment_ends(slab: Slab) -> list[int]:
    """Where the vertices along x, y, z and inside begin, and the end."""
    return [0, *np.cumsum(segment_counts(slab)).tolist()]


class Regrouping:
    """Parts grouped anew into ranges of layers.

    Parameters
    ----------
    ranges : list of (low, high)
        One after the other, from the first layer to the end of the last.
    """

    def __init__(self, ranges: list[tuple[int, int]]) -> None:
        self.ranges = deque(ranges)
        self.waiting: list[SlabPart] = []

    def add(self, part: SlabPart) -> list[SlabPart]:
        """Take the next part, and return the ranges that are complete by it."""
        complete = []
        rest: SlabPart | None = part
        while rest is not None:
            _, end = self.ranges[0]
            if rest.high < end:
                self.waiting.append(rest)
                break
            last, rest = (rest, None) if rest.high == end else split_at(rest, end)
            complete.append(joined([*self.waiting, last]))
            self.waiting = []
            self.ranges.popleft()
        return complete


def faces_of(part: SlabPart, following: SlabPart | None) -> NDArray[np.int32]:
    """The triangles of a part, (f, 3) int32; numbers from its own vertices on are the following part's."""
    faces = np.empty((part.slab.face_count, 3), np.int32)
    fill_faces(part.slab, None if following is None else following.slab, 0, faces)
    return faces
