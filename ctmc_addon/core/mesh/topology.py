# SPDX-License-Identifier: GPL-3.0-or-later
"""Connectivity of triangles: their edges, and the components they form.

Only vertex numbers are looked at, no positions. Work is cut into blocks, so that steps are short.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arrays import Ints
from ..progress import PAUSE, Steps

FACES_PER_STEP = 1 << 17
BUCKET = 1 << 20  # Sort the edges of this many corners at once.

Edges = tuple[Ints, Ints]  # As `edges_steps` returns them.
EdgeKeys = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]  # As `edge_keys_steps` returns them.


class Topology(NamedTuple):
    """How the triangles of a mesh are connected, found once for all who need it.

    Parameters
    ----------
    edges : (2, E) and (3, F) int32
        As `edges_steps` returns them.
    components : (F,) int32
        As `component_numbers_steps` returns them.
    """

    edges: Edges
    components: Ints


def topology_steps(faces: Ints, vertex_count: int) -> Steps[Topology]:
    """Find edges and components of faces (F, 3)."""
    edges = yield from edges_steps(np.ascontiguousarray(faces.T), vertex_count)
    return Topology(edges, (yield from component_numbers_steps(faces, vertex_count)))


def edges_steps(faces: Ints, vertex_count: int) -> Steps[Edges]:
    """Return every edge once, and the edges of every face.

    Parameters
    ----------
    faces : (3, F) int32
        A row for each corner.
    vertex_count : int

    Returns
    -------
    edges : (2, E) int32
        The lower end first, in the order of their ends.
    face_edges : (3, F) int32
        Number of the edge from corner i to corner i + 1 of every face.
    """
    yield PAUSE
    start, end = faces.ravel(), faces[[1, 2, 0]].ravel()
    yield PAUSE
    low, high = np.minimum(start, end), np.maximum(start, end)
    yield PAUSE
    face_edges = np.empty(len(low), np.int32)
    edges, count = [np.empty((2, 0), np.int32)], 0
    for corners in _buckets(low, vertex_count):
        lower, higher = np.take(low, corners), np.take(high, corners)
        order = _order(lower, higher, vertex_count)
        lower, higher = np.take(lower, order), np.take(higher, order)
        new = np.ones(len(order), bool)
        new[1:] = (lower[1:] != lower[:-1]) | (higher[1:] != higher[:-1])
        face_edges[np.take(corners, order)] = np.cumsum(new, dtype=np.int32) + np.int32(count - 1)
        edges.append(np.stack([lower[new], higher[new]]))
        count += edges[-1].shape[1]
        yield PAUSE
    return np.concatenate(edges, axis=1), face_edges.reshape(faces.shape)


def _order(lower: Ints, higher: Ints, vertex_count: int) -> NDArray[np.int64]:
    """Return a stable order of pairs by the first number, and then by the second, which is below `vertex_count`."""
    lowest, highest = int(lower.min(initial=vertex_count)), int(lower.max(initial=0))
    bits = len(lower).bit_length()
    keys = (lower - np.int32(lowest)).astype(np.int64) * vertex_count + higher
    if (highest - lowest + 1) * vertex_count >= 1 << 63 - bits:
        return np.argsort(keys, kind="stable")
    # Numbers are sorted several times faster than their places; these are the last bits of them.
    keys = keys << bits | np.arange(len(keys))
    keys.sort(kind="stable")  # neighbors come one after the other: much is in order already
    return keys & (1 << bits) - 1


def edge_keys_steps(faces: Ints, vertex_count: int) -> Steps[EdgeKeys]:
    """Return every edge of `faces` (F, 3) once, as `edge_ends` takes it, rising; and those that are not closed.

    A triangle runs up an edge that it passes from the lower to the higher vertex number. A mesh is closed where
    every edge has two triangles, one of which runs up it.

    Returns
    -------
    keys : (E,) int64
    irregular : (n,) int64
        Edges without two triangles, one of which runs up; rising.
    counts : (2, n) int64
        Their triangles, and how many of these run up.
    """
    columns = np.ascontiguousarray(faces.T)
    start, end = columns.ravel(), columns[[1, 2, 0]].ravel()
    yield PAUSE
    low = np.minimum(start, end)
    yield PAUSE
    both = np.maximum(start, end).astype(np.int64)
    both <<= 1
    yield PAUSE
    both |= low == start  # the direction in the lowest bit
    yield PAUSE
    both |= low.astype(np.int64) << 32
    yield PAUSE
    parts, irregular, counts, edges = [np.empty(0, np.int64)], [np.empty(0, np.int64)], [np.empty((2, 0), np.int64)], 0
    for corners in _buckets(low, vertex_count):
        ways = both[corners]
        ways.sort(kind="stable")  # neighbors come one after the other: much is in order already
        yield PAUSE
        down, up = ways[::2], ways[1::2]
        keys = down >> 1
        if len(down) != len(up) or (down + 1 != up).any() or (keys[1:] == keys[:-1]).any():
            keys = ways >> 1
            first = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]]))
            its_counts = np.stack([np.diff(first, append=len(keys)), np.add.reduceat(ways & 1, first)])
            keys = keys[first]
            its_irregular = np.flatnonzero((its_counts[0] != 2) | (its_counts[1] != 1))
            irregular.append(its_irregular + edges)
            counts.append(its_counts[:, its_irregular])
        parts.append(keys)
        edges += len(keys)
        yield PAUSE
    return np.concatenate(parts), np.concatenate(irregular), np.concatenate(counts, axis=1)


def keys_of_edges_steps(faces: Ints, ends: Ints, face_edges: Ints) -> Steps[EdgeKeys]:
    """Return the result of `edge_keys_steps` for `faces` (F, 3) from their edges, without sorting again.

    Parameters
    ----------
    faces : (F, 3) int32
    ends, face_edges : (2, E) and (3, F) int32
        As `edges_steps` returns them.
    """
    yield PAUSE
    keys = ends[0].astype(np.int64)
    keys <<= 31
    keys |= ends[1]
    yield PAUSE
    count, upwards = np.zeros(len(keys), np.intp), np.zeros(len(keys), np.intp)
    for corner in range(3):
        edges = face_edges[corner]
        yield PAUSE
        count += np.bincount(edges, minlength=len(keys))
        yield PAUSE
        up = faces[:, corner] <= faces[:, (corner + 1) % 3]
        yield PAUSE
        upwards += np.bincount(edges[up], minlength=len(keys))
        yield PAUSE
    irregular = np.flatnonzero((count != 2) | (upwards != 1))
    yield PAUSE
    return keys, irregular, np.stack([count[irregular], upwards[irregular]]).astype(np.int64)


def edge_ends(keys: NDArray[np.int64]) -> Ints:
    """Return the vertices of edges, (2, E), the lower one first: as `edge_keys_steps` packs them."""
    return np.stack([keys >> 31, keys & 0x7FFFFFFF]).astype(np.int32)


def _buckets(low: Ints, vertex_count: int) -> Iterator[NDArray[np.intp]]:
    """Places of edges whose lower ends are in one range, range by range, so that nothing large is sorted at once."""
    width = max(1, vertex_count * BUCKET // max(1, len(low)))
    for first in range(0, vertex_count, width):
        places = np.flatnonzero((low >= first) & (low < first + width))
        if len(places):
            yield places


def compacted(faces: Ints, vertex_count: int) -> tuple[NDArray[np.bool_], Ints]:
    """Return which vertices are used, (vertex_count,) bool, and the faces renumbered to them.

    Examples
    --------
    >>> used, faces = compacted(np.array([[4, 1, 3]], np.int32), 6)
    >>> np.flatnonzero(used).tolist(), faces.tolist()
    ([1, 3, 4], [[2, 0, 1]])
    """
    used = np.zeros(vertex_count, bool)
    used[faces] = True
    number = np.cumsum(used, dtype=np.int32) - np.int32(1)
    return used, np.take(number, faces)


class Groups:
    """Union-find over 0..count-1; a group is named by its lowest number.

    Where all links are known at first, `component_roots_steps` finds the same faster.

    Examples
    --------
    >>> groups = Groups(5)
    >>> groups.join(4, 1), groups.join(1, 4), groups.root(4)
    (True, False, 1)
    >>> groups.lists()
    [[0], [1, 4], [2], [3]]
    """

    def __init__(self, count: int) -> None:
        self._above = list(range(count))

    def root(self, number: int) -> int:
        """Return the lowest number of the group that this one is in."""
        above = self._above
        while above[number] != number:
            above[number] = above[above[number]]
            number = above[number]
        return number

    def join(self, first: int, second: int) -> bool:
        """Join the groups of two numbers; returns whether they were two."""
        low, high = sorted((self.root(first), self.root(second)))
        self._above[high] = low
        return low != high

    def lists(self) -> list[list[int]]:
        """Return the numbers of every group, rising, in the order of their lowest."""
        members: dict[int, list[int]] = {}
        for number in range(len(self._above)):
            members.setdefault(self.root(number), []).append(number)
        return list(members.values())


def component_numbers_steps(faces: Ints, vertex_count: int) -> Steps[Ints]:
    """Return the number of the component of every face, (F,) int32; components are in the order of their first face.

    `faces` may also be links (n, 2).
    """
    roots = (yield from component_roots_steps(faces, vertex_count))[faces[:, 0]]  # (F,)
    yield PAUSE
    first = np.full(vertex_count, -1, np.int32)
    first[roots[::-1]] = np.arange(len(faces), dtype=np.int32)[::-1]  # of several faces the last to write is the first
    yield PAUSE
    used = np.flatnonzero(first >= 0)
    number = np.empty(vertex_count, np.int32)
    number[used[np.argsort(first[used], kind="stable")]] = np.arange(len(used), dtype=np.int32)
    return number[roots]


def components_of_vertices(faces: Ints, component: Ints, vertex_count: int) -> Ints:
    """Component of every vertex, (V,) int32, from that of every face, (F,); -1 for a vertex without faces."""
    of_vertex = np.full(vertex_count, -1, np.int32)
    for corner in faces.T:
        of_vertex[corner] = component
    return of_vertex


def component_roots_steps(faces: Ints, vertex_count: int) -> Steps[Ints]:
    """Lowest vertex of the component that every vertex is in, (V,) int32; a vertex without faces is its own.

    Faces (F, 3), or any other links (n, 2), connect the vertices of a row.

    Where the two ends of an edge have different numbers, the vertex of the higher number takes the lower one, and
    then that number's number (pointer jumping), until nothing changes; the rounds grow with the logarithm of the
    diameter.
    """
    lowest = np.arange(vertex_count, dtype=np.int32)
    starts = range(0, len(faces), FACES_PER_STEP)
    links = [
        (faces[start : start + FACES_PER_STEP, pair], faces[start : start + FACES_PER_STEP, pair + 1])
        for start in starts
        for pair in range(faces.shape[1] - 1)
    ]
    while links:
        open_links: list[tuple[Ints, Ints]] = []
        root = lowest.copy()  # a link is done with only when both its ends have had one root since the last round
        for first, second in links:
            a, b = np.take(root, first), np.take(root, second)
            differ = np.flatnonzero(a != b)
            if len(differ):
                a, b = a[differ], b[differ]
                open_links.append((a, b))
                lowest[np.maximum(a, b)] = np.minimum(a, b)  # Any of several works: the rest is tested again.
            yield PAUSE
        while True:
            shorter = np.take(lowest, lowest)
            yield PAUSE
            if (shorter == lowest).all():
                break
            lowest = shorter
        links = open_links
    return lowest
