# SPDX-License-Identifier: GPL-3.0-or-later
"""A first, quick reduction of a dense surface: vertices join one of their neighbors, all in one round.

Seeds are vertices no two of which are neighbors. Every other vertex joins the nearest seed beside it, and each cluster
becomes one vertex where its quadrics are least. That leaves a bit more than a third of the triangles, in the time of a
few rounds of edge collapse. What does not keep the surface's topology is taken back, cluster by cluster: a cluster must
be a disk (Euler number 1), an edge must have two triangles, and no triangle may turn over. Clusters do not touch the
border. Clusters: Rossignac and Borrel 1993, doi:10.1007/978-3-642-78114-8_29; their quadrics: Lindstrom 2000,
doi:10.1145/344779.344912.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...mesh.topology import edges_steps
from ...mesh.triangle_mesh import TriangleMesh
from ...mesh.vectors import cross, dot
from ...progress import PAUSE, Steps
from ..collapses import TURN, locked_vertices_steps, shuffled
from ..quadrics import EdgeQuadric, best_step, error, times, vertex_quadrics_steps
from .parts import Part, compacted

PASSES = 3  # of choosing seeds
EXPENSIVE = 8.0  # times the median error of clusters: such a cluster is not made

Ints = NDArray[np.int32]
Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]


class Shape(NamedTuple):
    """A surface as columns: positions (3, V), faces (3, F) and edges (2, E)."""

    positions: Floats
    faces: Ints
    edges: Ints


def clustered_steps(part: Part) -> Steps[Part]:
    """The part with a bit more than a third of its triangles where it is smooth; its border stays."""
    mesh = part.mesh
    extent = float((mesh.vertices.max(axis=0) - mesh.vertices.min(axis=0)).max())
    scale = np.float32(2.0 ** -np.frexp(extent)[1])
    positions = np.ascontiguousarray(mesh.vertices.T) * scale
    faces = np.ascontiguousarray(mesh.faces.T)
    edges, face_edges = yield from edges_steps(faces, len(mesh.vertices))
    border, non_manifold = yield from locked_vertices_steps(faces, edges, face_edges)
    locked = np.zeros(len(mesh.vertices), bool)
    locked[border] = locked[non_manifold] = True
    shape = Shape(positions, faces, edges)
    cluster = yield from _clusters_steps(shape, locked)
    quadrics = yield from vertex_quadrics_steps(positions, faces)
    placed, cost = _placed(positions, quadrics, cluster)
    multiple = np.bincount(cluster, minlength=len(cluster)) > 1
    if not multiple.any():
        return part
    yield PAUSE
    bad = multiple & (cost > EXPENSIVE * np.median(cost[multiple]))
    bad |= _no_disk(shape, cluster) & multiple
    while True:
        apart = bad[cluster]
        cluster = np.where(apart, np.arange(len(cluster), dtype=np.int32), cluster)
        placed[:, apart] = positions[:, apart]
        multiple &= ~bad
        new = np.take(cluster, faces)
        left = np.flatnonzero((new[0] != new[1]) & (new[1] != new[2]) & (new[2] != new[0]))
        yield PAUSE
        new = np.take(new, left, axis=1)
        bad = _torn(new, multiple)
        yield PAUSE
        bad |= _turned(np.take(faces, left, axis=1), new, positions, placed, multiple)
        yield PAUSE
        if not bad.any():
            break
    used, rows = compacted(np.ascontiguousarray(new.T), len(cluster))
    vertices = np.where(multiple[:, None], (placed / scale).T, mesh.vertices)[used]
    normals = None
    if mesh.normals is not None:
        sums = np.stack([np.bincount(cluster, row.astype(np.float64), len(cluster))[used] for row in mesh.normals.T])
        length = np.sqrt(dot(sums, sums))
        normals = (sums / np.where(length > 0, length, 1.0)).T.astype(np.float32)
    return Part(TriangleMesh(np.ascontiguousarray(vertices), rows, normals), part.numbers[used])


def _clusters_steps(shape: Shape, locked: Flags) -> Steps[Ints]:
    """The seed that every vertex joins, or itself, (V,)."""
    positions, _, (first, second) = shape
    free = ~locked
    free[first[np.take(locked, second)]] = free[second[np.take(locked, first)]] = False
    rank = shuffled(np.arange(len(locked)))
    seed = np.zeros(len(locked), bool)
    open_ = free.copy()
    for _ in range(PASSES):
        yield PAUSE
        both = np.flatnonzero(np.take(open_, first) & np.take(open_, second))
        one, other = first[both], second[both]
        lower = np.take(rank, one) < np.take(rank, other)
        lost = np.zeros(len(locked), bool)
        lost[one[~lower]] = lost[other[lower]] = True
        new = open_ & ~lost
        seed |= new
        open_ &= ~new
        open_[second[np.take(new, first)]] = open_[first[np.take(new, second)]] = False
    yield PAUSE
    seeds, joining = [], []
    for start, end in ((first, second), (second, first)):
        at = np.flatnonzero(np.take(seed, start) & np.take(free, end) & ~np.take(seed, end))
        seeds.append(start[at])
        joining.append(end[at])
    to, vertex = np.concatenate(seeds), np.concatenate(joining)
    along = np.take(positions, to, axis=1) - np.take(positions, vertex, axis=1)
    yield PAUSE
    order = np.argsort(-dot(along, along), kind="stable")  # the nearest is written last
    yield PAUSE
    cluster = np.arange(len(locked), dtype=np.int32)
    cluster[vertex[order]] = to[order]
    return cluster


def _placed(positions: Floats, quadrics: Floats, cluster: Ints) -> tuple[Floats, Floats]:
    """Where the vertex of each cluster goes, (3, V), and the error there, (V,)."""
    count = len(cluster)
    size = np.maximum(np.bincount(cluster, minlength=count), 1).astype(np.float32)
    middle = np.stack([np.bincount(cluster, row.astype(np.float64), count) for row in positions]).astype(np.float32)
    middle /= size
    offset = np.take(middle, cluster, axis=1) - positions
    slope = times(quadrics, offset)

    def summed(rows: Floats) -> Floats:
        return np.stack([np.bincount(cluster, row.astype(np.float64), count) for row in rows]).astype(np.float32)

    quadric = EdgeQuadric(summed(quadrics), summed(slope), summed(dot(offset, slope)[None])[0])
    step = best_step(quadric)
    return middle + step, error(quadric, step)


def _no_disk(shape: Shape, cluster: Ints) -> Flags:
    """Which clusters are no disks, (V,) bool: vertices less edges plus triangles are not one."""
    count = len(cluster)
    euler = np.bincount(cluster, minlength=count)
    first, second = (np.take(cluster, end) for end in shape.edges)
    euler -= np.bincount(first[first == second], minlength=count)
    a, b, c = (np.take(cluster, corner) for corner in shape.faces)
    euler += np.bincount(a[(a == b) & (b == c)], minlength=count)
    return euler != 1


def _torn(faces: Ints, multiple: Flags) -> Flags:
    """Which clusters, (V,) bool, have an edge twice the same way, two triangles back to back, or too few triangles."""
    count = len(multiple)
    bad = multiple & (np.bincount(faces.ravel(), minlength=count) < 3)
    at = np.flatnonzero(np.take(multiple, faces).any(axis=0))
    corners = np.take(faces, at, axis=1).astype(np.int64)
    start, end, third = corners.ravel(), corners[[1, 2, 0]].ravel(), corners[[2, 0, 1]].ravel()
    keys = np.minimum(start, end) * count + np.maximum(start, end)
    order = np.argsort(keys, kind="stable")
    keys, third, upward = keys[order], third[order], (start < end)[order]
    same = keys[1:] == keys[:-1]
    wrong = same & ((upward[1:] == upward[:-1]) | (third[1:] == third[:-1]))
    wrong[1:] |= same[1:] & same[:-1]
    low, high = np.divmod(keys[1:][wrong], count)
    bad[low] = bad[high] = True
    bad[third[1:][wrong]] = True
    return bad & multiple


def _turned(before: Ints, after: Ints, positions: Floats, placed: Floats, multiple: Flags) -> Flags:
    """Which clusters, (V,) bool, have a triangle that turns too far or loses its area."""
    moved = np.flatnonzero(np.take(multiple, after).any(axis=0))
    normals = []
    for corners, places in ((before, positions), (after, np.where(multiple, placed, positions))):
        a, b, c = (np.take(places, corner[moved], axis=1) for corner in corners)
        normals.append(cross(b - a, c - a))
    old, new = normals
    along, size = dot(old, new), dot(new, new)
    turned = (along < 0) | (along * along < TURN * TURN * dot(old, old) * size) | (size == 0)
    bad = np.zeros(len(multiple), bool)
    bad[after[:, moved[turned]]] = True
    return bad & multiple
