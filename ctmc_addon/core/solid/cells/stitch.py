# SPDX-License-Identifier: GPL-3.0-or-later
"""Join the triangles of rims to those of the cells around them.

On a face between both, Marching Cubes draws one segment. Tetrahedra split it at the diagonal of the face, and again
where a field crosses that changes no part. The triangle of the cell at that segment gets these vertices too.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags
from .rims import CutRims

AXIS_OF_CODE = np.array([-1, 0, 1, -1, 2, -1, -1, -1])


class Stitched(NamedTuple):
    """The joined triangles.

    Parameters
    ----------
    faces : (f, 3) int32
        Vertices of cells come first, then nodes.
    sides : (f, 2) unsigned
    chains : mapping of (int, int) to list of int
        Nodes on the segment between two vertices of cells, in order from the first to the second.
    """

    faces: NDArray[np.int32]
    sides: NDArray[Any]
    chains: dict[tuple[int, int], list[int]]


def stitched(
    faces: NDArray[np.int32], sides: NDArray[Any], cut: CutRims, keys: NDArray[np.int64], in_use: Flags
) -> Stitched:
    """Return the triangles of cells and of rims, which share vertices.

    Parameters
    ----------
    faces, sides
        Triangles of cells.
    cut : CutRims
    keys : (V,) int64
        The edge of every vertex of cells, `3 * sample + axis`.
    in_use : (V,) bool
        Whether a triangle of cells uses the vertex.
    """
    number = len(keys) + np.arange(len(cut.nodes.keys))
    axis = np.where((cut.nodes.codes[:, 1:] == 0).all(axis=1), AXIS_OF_CODE[cut.nodes.codes[:, 0]], -1)
    on_edge = np.flatnonzero(axis >= 0)
    edge = 3 * cut.nodes.lowest[on_edge].astype(np.int64) + axis[on_edge]
    shared = np.flatnonzero(in_use)
    order = shared[np.argsort(keys[shared], kind="stable")]
    place = np.minimum(np.searchsorted(keys[order], edge), max(len(order) - 1, 0))
    if len(order):
        same = keys[order[place]] == edge
        number[on_edge[same]] = order[place[same]]
    own = number[cut.faces]
    chains = _chains(own, len(keys))
    added_faces, added_sides, split = _split(faces, sides, chains, len(keys))
    every = np.ones(len(faces), bool)
    every[split] = False
    return Stitched(
        np.concatenate([faces[every], added_faces, own.astype(np.int32)]),
        np.concatenate([sides[every], added_sides, cut.sides]),
        chains,
    )


def _chains(faces: NDArray[np.intp], first_node: int) -> dict[tuple[int, int], list[int]]:
    """Return the nodes along open edges between two vertices of cells, by these two, the lower first."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    size = int(edges.max(initial=0)) + 1
    unique, count = np.unique(edges[:, 0] * size + edges[:, 1], return_counts=True)
    once = unique[count == 1]
    neighbors: dict[int, list[int]] = {}
    for low, high in zip((once // size).tolist(), (once % size).tolist(), strict=True):
        if high >= first_node:
            neighbors.setdefault(low, []).append(high)
            neighbors.setdefault(high, []).append(low)
    chains: dict[tuple[int, int], list[int]] = {}
    for start in sorted(vertex for vertex in neighbors if vertex < first_node):
        for following in neighbors[start]:
            chain, before, at = [], start, following
            while at >= first_node:
                chain.append(at)
                beyond = [each for each in neighbors[at] if each != before]
                if len(beyond) != 1:
                    break
                before, at = at, beyond[0]
            if at < first_node and start < at:
                chains[start, at] = chain
    return chains


def _split(
    faces: NDArray[np.int32], sides: NDArray[Any], chains: dict[tuple[int, int], list[int]], count: int
) -> tuple[NDArray[np.int32], NDArray[Any], list[int]]:
    """Split triangles of cells at chains; return the new triangles, their sides, and the numbers of those split."""
    at_end = np.zeros(count, bool)
    at_end[[vertex for ends in chains for vertex in ends]] = True
    near = np.flatnonzero(np.count_nonzero(at_end[faces], axis=1) > 1)
    new: list[tuple[int, int, int]] = []
    new_sides: list[NDArray[Any]] = []
    split = []
    for triangle, corners in zip(near.tolist(), faces[near].tolist(), strict=True):
        loop: list[int] = []
        runs = 0
        for at, vertex in enumerate(corners):
            following = corners[(at + 1) % 3]
            chain = chains.get((min(vertex, following), max(vertex, following)), [])
            runs += bool(chain)
            loop += [vertex, *(chain if vertex < following else reversed(chain))]
        if not runs:
            continue
        split.append(triangle)
        fans = _fans(loop, corners)
        new += fans
        new_sides += [sides[triangle]] * len(fans)
    return (np.array(new, np.int32).reshape(-1, 3), np.array(new_sides, sides.dtype).reshape(-1, 2), split)


def _fans(loop: list[int], corners: list[int]) -> list[tuple[int, int, int]]:
    """Cut a triangle with further vertices on its sides into triangles with an area.

    Examples
    --------
    >>> _fans([0, 9, 1, 2], [0, 1, 2])
    [(2, 0, 9), (9, 1, 2)]
    >>> _fans([0, 8, 1, 9, 2], [0, 1, 2])
    [(2, 0, 8), (8, 1, 9), (8, 9, 2)]
    """
    ears = []
    side_of = _sides_of(loop, corners)
    while len(loop) > 3:
        for at in range(len(loop)):
            before, vertex, after = loop[at - 1], loop[at], loop[(at + 1) % len(loop)]
            rest = [each for each in loop if each != vertex]
            if not _flat((before, vertex, after), side_of) and _has_area(rest, side_of):
                ears.append((before, vertex, after))
                loop = rest
                break
        else:
            break
    return [*ears, (loop[0], loop[1], loop[2])]


def _sides_of(loop: list[int], corners: list[int]) -> dict[int, set[int]]:
    """Return the sides of the triangle that each vertex of a loop lies on."""
    sides: dict[int, set[int]] = {}
    side = -1
    for vertex in loop:
        if vertex in corners:
            side += 1
            sides[vertex] = {side, (side - 1) % 3}
        else:
            sides[vertex] = {side}
    return sides


def _flat(triangle: tuple[int, int, int], sides: dict[int, set[int]]) -> bool:
    return bool(set.intersection(*(sides[vertex] for vertex in triangle)))


def _has_area(loop: list[int], sides: dict[int, set[int]]) -> bool:
    return not set.intersection(*(sides[vertex] for vertex in loop))
