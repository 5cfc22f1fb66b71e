# SPDX-License-Identifier: GPL-3.0-or-later
"""A first, quick reduction of a dense surface: vertices join one of their neighbors, all in one round.

A cluster is a seed, a vertex no neighbor of which is a seed, with the vertices beside it that join it: every other
vertex joins the nearest seed beside it. Each cluster becomes one vertex where its quadrics are least. A round leaves a
bit more than a third of the triangles, in the time of a few rounds of edge collapse. In the last round the cheapest
clusters alone are made, as many as the goal needs. What does not keep the surface's topology is taken back, cluster by
cluster: a cluster must be a disk (Euler number 1), an edge must have two triangles, and no triangle may turn over.
After the last round so are clusters whose triangles cross others: few are, so one test for all rounds is enough. The
border stays. Clusters: Rossignac and Borrel 1993, doi:10.1007/978-3-642-78114-8_29; their quadrics: Lindstrom 2000,
doi:10.1145/344779.344912.

The quadric of a cluster is the sum of those of its vertices, from round to round, so it remembers the planes of all
triangles at first: that keeps the volume, and they are worked out once. No list of edges is made, which would take as
long as all else: triangles alone tell which vertices are neighbors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Doubles, Flags, Floats, Indices, Ints
from ..mesh.measures import component_volumes_steps
from ..mesh.topology import component_numbers_steps, components_of_vertices
from ..mesh.triangle_mesh import TriangleMesh
from ..mesh.vectors import dot
from ..progress import PAUSE, Steps
from .batches.pieces import Batch
from .engine.collapses import shuffled
from .engine.quadrics import EdgeQuadric, best_step, error, face_quadrics, times
from .merged_clusters import ID_BITS, Merged
from .policy import POLICY, Policy

BLOCK = 1 << 15  # Work out the quadrics of this many faces at once: they fit the cache.


@dataclass(eq=False)
class ColumnSurface:
    """A surface as columns.

    positions : (3, V) float32
    faces : (3, F) int64
    locked : (V,) bool, vertices that stay
    original : (V,) int64, their numbers at first
    quadrics : EdgeQuadric of each vertex about itself: of all faces that it had a corner of, at first and before
    """

    positions: Floats
    faces: Indices
    locked: Flags
    original: Indices
    quadrics: EdgeQuadric


@dataclass(frozen=True, eq=False)
class Clusters:
    """Vertices that may become one.

    roots : (C,) int64, the seed of each
    size : (C,) int64, vertices
    disk : (C,) bool, whether it may become one
    places : (3, C) float32, where that goes
    cost : (C,) float32, its error there
    quadrics : EdgeQuadric, about that place
    """

    roots: Indices
    size: Indices
    disk: Flags
    places: Floats
    cost: Floats
    quadrics: EdgeQuadric

    def cheap(self, most: int, expensive: float) -> Indices:
        """Numbers of those to be made: the cheapest for each triangle that goes, `most` of which may.

        None costs more than `expensive` times the median.
        """
        number = np.flatnonzero(self.disk)
        if not len(number):
            return number
        number = number[self.cost[number] <= expensive * np.median(self.cost[number])]
        going = 2 * (self.size[number] - 1)
        if going.sum() <= most:
            return number
        order = np.argsort(self.cost[number] / going, kind="stable")
        return np.sort(number[order[np.cumsum(going[order]) <= most]])


@dataclass(frozen=True, eq=False)
class Unclustered:
    """Components before clusters were made, which shrink small ones.

    component : (V,) int32
        The component of each vertex left.
    volumes : (components,) float64
        Volume that each enclosed; 0 where there is only one, which never goes.
    """

    component: Ints
    volumes: Doubles


def clustered_steps(
    batch: Batch, target: int, policy: Policy = POLICY, component: Ints | None = None
) -> Steps[tuple[Batch, Unclustered]]:
    """The batch with no fewer than `target` triangles, and not many more where it is smooth; its border stays.

    `component` is the component of every face, if it is known.
    """
    mesh = batch.mesh
    if component is None:
        component = yield from component_numbers_steps(mesh.faces, len(mesh.vertices))
    volumes = np.zeros(1)
    if component.any():
        volumes = yield from component_volumes_steps(mesh.vertices, mesh.faces, component)
    extent = float((mesh.vertices.max(axis=0) - mesh.vertices.min(axis=0)).max())
    scale = np.float32(2.0 ** -np.frexp(extent)[1])
    faces = np.array(mesh.faces.T, np.int64, order="C")
    positions = np.ascontiguousarray(mesh.vertices.T) * scale
    joins = original = np.arange(len(mesh.vertices))
    locked = _border(faces, len(joins))
    quadrics = yield from _quadrics_steps(positions, faces)
    shape = ColumnSurface(positions, faces, locked, original, quadrics)
    while (before := shape.faces.shape[1]) > policy.enough_clusters * target and len(shape.locked) >> ID_BITS == 0:
        yield PAUSE
        becomes = original.copy()
        at = shape.original
        shape, joined = yield from _round_steps(shape, target, policy)
        becomes[at] = at[joined]
        joins = becomes[joins]
        if shape.faces.shape[1] > policy.least_cluster_gain * before:
            break
    placed = positions.copy()
    placed[:, shape.original] = shape.positions
    merged = Merged(positions, faces, joins, placed, np.bincount(joins, minlength=len(joins)) > 1)
    yield from merged.uncross_steps()
    used, faces = merged.used()
    normals = None
    if mesh.normals is not None:
        normals = np.stack([np.bincount(merged.joins, row, len(joins))[used] for row in mesh.normals.T])
        length = np.sqrt(dot(normals, normals))
        normals = np.ascontiguousarray((normals / np.where(length > 0, length, 1.0)).T.astype(np.float32))
    vertices = np.ascontiguousarray((np.compress(used, merged.placed, axis=1) / scale).T)
    triangles = np.ascontiguousarray(faces.T.astype(np.int32))
    left = Batch(TriangleMesh(vertices, triangles, normals), batch.numbers[used])
    return left, Unclustered(components_of_vertices(mesh.faces, component, len(mesh.vertices))[used], volumes)


def _quadrics_steps(positions: Floats, faces: Indices) -> Steps[EdgeQuadric]:
    """Return the quadric of every vertex from the planes of its faces, which all go through it."""
    vertex_count, face_count = positions.shape[1], faces.shape[1]
    rows = np.empty((6, face_count), np.float32)
    for start in range(0, face_count, BLOCK):
        block = slice(start, start + BLOCK)
        rows[:, block] = face_quadrics(positions, faces[:, block])
        yield PAUSE
    matrix = np.empty((6, vertex_count), np.float32)
    for total, row in zip(matrix, rows, strict=True):
        weights = row.astype(np.float64)
        total[:] = sum(np.bincount(corner, weights, vertex_count) for corner in faces)
        yield PAUSE
    return EdgeQuadric(matrix, np.zeros((3, vertex_count), np.float32), np.zeros(vertex_count, np.float32))


def _moved(quadrics: EdgeQuadric, offset: Floats) -> EdgeQuadric:
    """The same quadrics about places that lie so far away, (3, n)."""
    slope = times(quadrics.matrix, offset)
    constant = dot(offset, slope + quadrics.gradient + quadrics.gradient) + quadrics.constant
    return EdgeQuadric(quadrics.matrix, slope + quadrics.gradient, constant)


def _border(faces: Indices, vertex_count: int) -> Flags:
    """Return which vertices, (V,) bool, have triangles that are not a fan all around them.

    Around a whole fan every neighbor comes once before and once after the vertex, so sums over both are equal; around
    an open one they differ by its ends. Sums of a few numbers below 2^32 are exact.
    """
    number = shuffled(np.arange(vertex_count)).astype(np.float64)
    at = [np.take(number, corner) for corner in faces]
    sums = np.zeros(vertex_count)
    for corner in range(3):
        sums += np.bincount(faces[corner], at[(corner + 1) % 3] - at[(corner + 2) % 3], vertex_count)
    return sums != 0


def _round_steps(shape: ColumnSurface, target: int, policy: Policy) -> Steps[tuple[ColumnSurface, Indices]]:
    """One round: no fewer than `target` triangles are left; also which of the vertices each has joined."""
    positions, faces = shape.positions, shape.faces
    joins = yield from _seeds_steps(shape, policy.cluster_passes)
    new = np.take(joins, faces)
    yield PAUSE
    clusters = yield from _clusters_steps(shape, joins, new)
    cheapest = clusters.roots[clusters.cheap(faces.shape[1] - target, policy.expensive_cluster)]
    placed = positions.copy()
    placed[:, clusters.roots] = clusters.places
    multiple, reverted = np.zeros((2, len(joins)), bool)
    multiple[clusters.roots] = reverted[clusters.roots] = True
    reverted[cheapest] = False
    merged = Merged(positions, faces, joins, placed, multiple, policy)
    merged.take_apart(reverted)
    yield from merged.settle_steps()
    used, left = merged.used()
    still = multiple[clusters.roots]
    for rows, summed in zip(shape.quadrics, clusters.quadrics, strict=True):
        rows[..., clusters.roots[still]] = summed[..., still]
    quadrics = EdgeQuadric(*(np.compress(used, rows, axis=-1) for rows in shape.quadrics))
    placed = np.compress(used, placed, axis=1)
    return ColumnSurface(placed, left, shape.locked[used], shape.original[used], quadrics), joins


def _seeds_steps(shape: ColumnSurface, passes: int) -> Steps[Indices]:
    """The seed that every vertex joins, or itself, (V,)."""
    positions, faces, free = shape.positions, shape.faces, ~shape.locked
    worst = np.uint32(0xFFFFFFFF)
    rank = np.where(free, shuffled(np.arange(len(free))), worst)
    seed = np.zeros(len(free), bool)
    around = faces  # triangles with a corner that is neither a seed nor beside one
    for _ in range(passes):
        ranks = [np.take(rank, corner) for corner in around]
        best = np.minimum(np.minimum(ranks[0], ranks[1]), ranks[2])
        lost = rank == worst
        for corner, own in zip(around, ranks, strict=True):
            lost[corner[own > best]] = True
        yield PAUSE
        new_seeds = ~lost
        seed |= new_seeds
        near = np.take(new_seeds, around[0]) | np.take(new_seeds, around[1]) | np.take(new_seeds, around[2])
        done = np.flatnonzero(near)
        for corner in around:
            rank[corner[done]] = worst
        rest = np.flatnonzero(~near)
        around = np.take(around, rest, axis=1)
        yield PAUSE
    joining, seeds = [], []
    for corner, following in ((0, 1), (1, 2), (2, 0)):
        at = np.flatnonzero(np.take(seed, faces[corner]))
        vertex = faces[following, at]
        may = np.take(free, vertex)
        seeds.append(faces[corner, at][may])
        joining.append(vertex[may])
        yield PAUSE
    to, vertex = np.concatenate(seeds), np.concatenate(joining)
    along = np.take(positions, to, axis=1) - np.take(positions, vertex, axis=1)
    squared = dot(along, along)
    far = np.float32(0xFFFF / max(float(squared.max(initial=0.0)), 1e-30))
    nearness = np.uint16(0xFFFF) - (squared * far).astype(np.uint16)
    order = np.argsort(nearness, kind="stable")  # the nearest is written last
    yield PAUSE
    joins = np.arange(len(free))
    joins[vertex[order]] = to[order]
    return joins


def _clusters_steps(shape: ColumnSurface, joins: Indices, new: Indices) -> Steps[Clusters]:
    """Return the clusters, and the cost of each."""
    positions, vertex_count = shape.positions, len(joins)
    size = np.bincount(joins, minlength=vertex_count)
    roots = np.flatnonzero(size > 1)
    count = len(roots)
    slot = np.full(vertex_count, count)  # the last is for all others
    slot[roots] = np.arange(count)
    size = size[roots]
    # Triangles with two corners or more in one cluster. A disk has as many vertices as edges less triangles, and one
    # more. An edge within it has two sides: a triangle with two corners there has one of them; one with all three has
    # three, and is itself a triangle of it.
    ends = new[1] == new[2]
    within = np.flatnonzero(ends | (new[0] == new[1]) | (new[2] == new[0]))
    owner = slot[np.where(ends[within], new[1, within], new[0, within])]
    disk = 2 * size - np.bincount(owner, minlength=count + 1)[:count] == 2
    yield PAUSE
    inner = slot[joins]
    member = np.flatnonzero(inner < count)
    inner = inner[member]
    places = np.take(positions, member, axis=1)
    middle = _sums(inner, places, count)
    middle /= size.astype(np.float32)
    yield PAUSE
    own = EdgeQuadric(*(np.take(rows, member, axis=-1) for rows in shape.quadrics))
    own = _moved(own, np.take(middle, inner, axis=1) - places)
    yield PAUSE
    quadrics = EdgeQuadric(
        _sums(inner, own.matrix, count), _sums(inner, own.gradient, count), _sums(inner, own.constant[None], count)[0]
    )
    yield PAUSE
    step = best_step(quadrics)
    return Clusters(roots, size, disk, middle + step, error(quadrics, step), _moved(quadrics, step))


def _sums(owner: Indices, rows: Floats, count: int) -> Floats:
    """Sums of each row by owner, (rows, count)."""
    return np.stack([np.bincount(owner, row, count) for row in rows]).astype(np.float32)
