# SPDX-License-Identifier: GPL-3.0-or-later
"""The order of vertices and triangles. It depends only on the samples, so no cut of a surface into slabs changes it.

Some layers of samples are a unit; how many depends on the size of a layer. Vertices come unit by unit, and in a unit

    1. those on edges along x, then along y, in its lowest layer, which the unit below has too,
    2. those on edges along x, then y, in its other layers, then all along z, then those inside voxels,

each list in the order of its voxels. Triangles come unit by unit, in a unit by the kind of their voxel. A slab is any
run of layers: part of a unit where the surface is dense, many units where it is sparse. The numbers in the lowest layer
of the unit above are known from that layer alone, so pieces of whole units need no look ahead.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .active_voxels import Slab

INSIDE = 5  # The last list of vertices: those inside voxels.
Pieces: TypeAlias = list[tuple[slice, slice]]  # Some items of a list, and the rows where they stand.


class Runs(NamedTuple):
    """Positions of a list's items in an array, a few runs of them one after the other.

    Parameters
    ----------
    ends : list of int
        First item of each run, and the end.
    starts : list of int
        Start of each run in the array.
    size : int
        Rows of the array for each item.
    """

    ends: list[int]
    starts: list[int]
    size: int = 1

    def places(self) -> NDArray[np.int32]:
        """Return the position of every item in the array, (items,)."""
        places = np.empty(self.ends[-1], np.int32)
        for (begin, end), start in zip(pairwise(self.ends), self.starts, strict=True):
            places[begin:end] = np.arange(start, start + end - begin, dtype=np.int32)
        return places

    def pieces(self, low: int, count: int) -> Pieces:
        """Return the runs of `count` items from `low` on: their numbers, counted from `low`, and their rows.

        Examples
        --------
        >>> Runs([0, 5, 20], [100, 300], 2).pieces(3, 6)
        [(slice(0, 2, None), slice(106, 110, None)), (slice(2, 6, None), slice(300, 308, None))]
        """
        pieces, done = [], 0
        run = bisect_right(self.ends, low) - 1
        while done < count:
            end = min(count, self.ends[run + 1] - low)
            row = self.starts[run] + (low + done - self.ends[run]) * self.size
            pieces.append((slice(done, end), slice(row, row + (end - done) * self.size)))
            done = end
            run += 1
        return pieces


@dataclass(frozen=True, eq=False)
class SlabPositions:
    """Positions of a slab's vertices and triangles.

    Parameters
    ----------
    vertices : four Runs
        Runs of the vertices on edges along x, y and z, and of those inside voxels.
    faces : tuple of Runs
        Runs of the voxels of each kind, from kind 1 on.
    """

    vertices: tuple[Runs, ...]
    faces: tuple[Runs, ...]


@dataclass(frozen=True, eq=False)
class Order:
    """The positions of all slabs, and the numbers of all vertices and triangles."""

    places: list[SlabPositions]
    vertex_count: int
    face_count: int


def order_of(slabs: Sequence[Slab], top: Slab | None = None) -> Order:
    """Return the position of everything, from the lowest layer of the first slab on, which starts a unit.

    Parameters
    ----------
    top : Slab, optional
        The layer above the last slab, alone: the lowest of the next unit. It gets places too, the last, and is not
        counted.
    """
    segments = [slab.segments for slab in (*slabs, *([] if top is None else [top]))]
    if not segments:
        return Order([], 0, 0)
    slab = np.repeat(np.arange(len(segments)), [len(each.unit) for each in segments])
    unit = np.concatenate([each.unit for each in segments])
    lowest = np.concatenate([each.lowest for each in segments])
    axis = np.arange(INSIDE + 1 - 2)[:, None]
    group = np.where(lowest & (axis < 2), axis, axis + 2)  # of the lists along x, y, z and inside
    vertex_counts = np.concatenate([each.vertices for each in segments], axis=1)
    kinds = max(len(each.voxels) for each in segments)
    voxels = np.zeros((kinds, len(unit)), np.intp)
    for number, each in enumerate(segments):
        voxels[: len(each.voxels), slab == number] = each.voxels
    sizes = [(kind + 1) // 2 for kind in range(1, kinds)]
    vertices = _runs(vertex_counts, group, unit, slab, [1] * 4)
    faces = _runs(voxels[1:], np.arange(1, kinds)[:, None], unit, slab, sizes)
    counted = slab < len(slabs)
    return Order(
        [SlabPositions(*both) for both in zip(vertices, faces, strict=True)],
        int(vertex_counts[:, counted].sum()),
        int((voxels[1:, counted].sum(axis=1) * sizes).sum()),
    )


def _runs(
    counts: NDArray[np.intp], group: NDArray[Any], unit: NDArray[np.intp], slab: NDArray[np.intp], sizes: list[int]
) -> list[tuple[Runs, ...]]:
    """Return the runs of every slab's lists, which stand by unit, then by group, then in the order of the segments.

    Parameters
    ----------
    counts : (lists, segments) intp
        Items of each list in each segment.
    group : (lists, segments) or (lists, 1)
    unit, slab : (segments,) intp
    sizes : list of int
        Rows of an item of each list.
    """
    rows = counts * np.array(sizes, np.intp)[:, None]
    # No two lists have a group in common, so a stable order of both keys leaves segments as they come.
    keys = unit * (int(group.max(initial=0)) + 1) + group  # (lists, segments)
    order = np.argsort(keys, axis=None, kind="stable")
    start = np.empty(counts.size, np.intp)
    in_order = rows.ravel()[order]
    start[order] = np.cumsum(in_order) - in_order
    start = start.reshape(counts.shape)
    lists = list(zip(counts.tolist(), start.tolist(), sizes, strict=True))
    bounds = np.searchsorted(slab, np.arange(slab[-1] + 2)).tolist()
    return [
        tuple(_joined(count[low:high], first[low:high], size) for count, first, size in lists)
        for low, high in pairwise(bounds)
    ]


def _joined(counts: list[int], starts: list[int], size: int) -> Runs:
    """Return runs with these numbers of items; runs that follow one another in the array become one; at least one."""
    ends, firsts, follows = [0], [], -1
    for count, start in zip(counts, starts, strict=True):
        if not count:
            continue
        if start == follows:
            ends[-1] += count
        else:
            ends.append(ends[-1] + count)
            firsts.append(start)
        follows = start + count * size
    return Runs(ends, firsts, size) if firsts else Runs([0, 0], starts[:1], size)
