# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the lattice edges that the vertices of an extracted mesh lie on, and from them the samples inside.

An extracted vertex lies on an edge between two neighboring samples, one inside and one outside. Along a row of
samples, every such edge is a way in or out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...arrays import Doubles, Flags, Floats, Indices
from ...errors import MeshError
from ...machine.budget import Budget
from ...machine.parallel import map_steps, parts_of
from ...mesh.distance.triangle_tree import order_steps
from ...mesh.triangle_mesh import TriangleMesh
from ...progress import PAUSE, Steps, equal_part
from ...volume.affine import to_index
from .lattice import Lattice

ON_EDGE = 2.0**-9  # A vertex is on an edge if it is off by at most this share of a step.
VERTICES_PER_STEP = 1 << 17
SAMPLES_PER_STEP = 1 << 23


def edge_vertices_steps(
    mesh: TriangleMesh, lattice: Lattice, budget: Budget | None = None
) -> Steps[tuple[Indices, Indices]]:
    """Return the lattice edges that have a vertex, and that vertex.

    Parameters
    ----------
    mesh : TriangleMesh
        RAS+ mm, extracted on this lattice. Vertices that are not on an edge are left out.
    lattice : Lattice
    budget : Budget, optional

    Returns
    -------
    keys : (n,) int64
        Rising: 3 * flat index of the edge's low end + axis, 0 to 2 for x to z.
    vertices : (n,) int64
        Number of the vertex; the first where several lie on one edge.
    """
    keys_of_vertices = yield from equal_part(_keys_steps(mesh.vertices, lattice, budget), 0, 2)
    vertex = np.flatnonzero(keys_of_vertices >= 0)
    keys_of_vertices = keys_of_vertices[vertex]
    order = yield from equal_part(order_steps(keys_of_vertices.astype(np.uint64)), 1, 2)
    keys = keys_of_vertices[order]
    first = np.ones(len(keys), bool)
    np.not_equal(keys[1:], keys[:-1], out=first[1:])
    return keys[first], vertex[order[first]]


def inside_steps(mesh: TriangleMesh, lattice: Lattice, budget: Budget | None = None) -> Steps[Flags]:
    """Return whether each sample is inside a closed mesh that was extracted on this lattice.

    Parameters
    ----------
    mesh : TriangleMesh
        RAS+ mm.
    lattice : Lattice
    budget : Budget, optional

    Returns
    -------
    (z, y, x) bool

    Raises
    ------
    MeshError
        If the vertices do not decide it, because the mesh is open or was not extracted on this lattice.
    """
    keys = yield from equal_part(_keys_steps(mesh.vertices, lattice, budget), 0, 2)
    keys = keys[keys >= 0]
    low, axis = np.divmod(keys, 3)
    inside = np.zeros(lattice.shape, bool)
    inside.reshape(-1)[low[axis == 0] + 1] = True
    yield PAUSE
    flags = inside.view(np.uint8)

    def accumulate(layers: slice) -> int:
        np.bitwise_xor.accumulate(flags[layers], axis=2, out=flags[layers])
        return int(np.count_nonzero(flags[layers, :, -1]))

    depth, height, width = lattice.shape
    layers = parts_of(depth, max(1, SAMPLES_PER_STEP // (height * width)))
    threads = (budget or Budget()).thread_count
    odd = sum((yield from equal_part(map_steps(accumulate, layers, threads, "", len(layers)), 1, 2)))
    samples = inside.reshape(-1)
    same = 0
    for number, step in ((1, width), (2, height * width)):
        ends = low[axis == number]
        same += int(np.count_nonzero(samples[ends] == samples[ends + step]))
        yield PAUSE
    if odd or same or 2 * len(keys) < len(mesh.vertices):
        raise MeshError(
            f"{len(mesh.vertices) - len(keys)} of {len(mesh.vertices)} vertices are off the edges between samples, and "
            f"{odd + same} edges contradict others: close the border, and do not smooth, shrink or simplify the surface"
        )
    return inside


def _keys_steps(vertices: Floats, lattice: Lattice, budget: Budget | None) -> Steps[Indices]:
    """Return the key of every vertex's edge, -1 for a vertex that is not on an edge."""
    keys = np.empty(len(vertices), np.int64)

    def locate(block: slice) -> None:
        keys[block] = _keys(to_index(lattice.affine, vertices[block].astype(np.float64)), lattice)

    blocks = parts_of(len(vertices), VERTICES_PER_STEP)
    yield from map_steps(locate, blocks, (budget or Budget()).thread_count, "", max(1, len(blocks)))
    return keys


def _keys(index: Doubles, lattice: Lattice) -> Indices:
    """Return the keys of positions (n, 3) in index space."""
    low = np.empty((3, len(index)), np.int64)  # The sample before the position.
    share = np.empty((3, len(index)))  # The share of the step from that sample.
    for axis, positions in enumerate((lattice.x, lattice.y, lattice.z)):
        low[axis], share[axis] = _steps_along(np.ascontiguousarray(index[:, axis]), positions)
    upper = share > 0.5
    off = np.abs(share - upper)
    axis = off.argmax(axis=0)
    each = np.arange(len(index))
    along = share[axis, each]
    upper[axis, each] = False
    off[axis, each] = 0.0
    low += upper
    _, height, width = lattice.shape
    keys = 3 * ((low[2] * height + low[1]) * width + low[0]) + axis
    keys[(off.max(axis=0) > ON_EDGE) | (along <= 0.0) | (along >= 1.0)] = -1
    return keys


def _steps_along(values: Doubles, positions: Doubles) -> tuple[NDArray[np.intp], Doubles]:
    """Return the index of the last position before each value, except the final one, and the share of its step."""
    low = np.searchsorted(positions, values, side="right") - 1
    np.clip(low, 0, len(positions) - 2, out=low)
    return low, (values - positions.take(low)) / np.diff(positions).take(low)
