# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the components of a full surface that are missing in a surface made from it.

A component of the other surface lies at the one it was made from: most of its vertices are nearest to that one's
triangles. Components of the full surface that none was made from are lost. Cavities are components of their own.
Positions of both surfaces in one space.
"""

from __future__ import annotations

import numpy as np

from ...arrays import Doubles, Flags, Indices, Ints
from ...progress import PAUSE, Steps
from ..topology import component_numbers_steps
from ..triangle_mesh import TriangleMesh
from .triangle_tree import TriangleTree

PROBES = 16  # Look at most at this many vertices of a component.
POINTS_AT_ONCE = 2048


def lost_components_steps(mesh: TriangleMesh, tree: TriangleTree, component: Ints) -> Steps[Flags]:
    """Return which components of the full surface are lost in `mesh`, (components,) bool.

    Parameters
    ----------
    mesh : TriangleMesh
    tree : TriangleTree
        The triangles of the full surface.
    component : (F,) int32
        The component of each of its faces.
    """
    count = int(component.max()) + 1
    own = yield from component_numbers_steps(mesh.faces, len(mesh.vertices))
    own_count = int(own.max()) + 1
    if count == 1 or own_count >= count:
        return np.zeros(count, bool)
    vertices, of = yield from _probes_steps(mesh.faces, own)
    nearest, squared = np.empty(len(of), np.int64), np.empty(len(of))
    for start in range(0, len(of), POINTS_AT_ONCE):
        block = slice(start, start + POINTS_AT_ONCE)
        points = np.ascontiguousarray(mesh.vertices[vertices[block]].T, np.float64)
        squared[block], triangle = tree.nearest(points, np.full(points.shape[1], np.inf))
        nearest[block] = component[tree.order[triangle]]
        yield PAUSE
    lost = np.ones(count, bool)
    lost[_most_frequent(of, nearest, squared)] = False
    return lost


def _probes_steps(faces: Ints, component: Ints) -> Steps[tuple[Indices, Indices]]:
    """Return up to `PROBES` vertices of every component, spread over it, and the component of each."""
    pairs = np.unique(np.stack([np.repeat(component, 3), faces.ravel()]), axis=1)
    yield PAUSE
    of, vertices = pairs.astype(np.int64)
    sizes = np.bincount(of)
    turn = np.arange(len(of)) - (np.cumsum(sizes) - sizes)[of]
    every = -(-sizes // PROBES)
    selected = turn % every[of] == 0
    return vertices[selected], of[selected]


def _most_frequent(of: Indices, values: Indices, squared: Doubles) -> Indices:
    """Return for each number in `of` the value that it has most often; of equally frequent ones the nearest."""
    keys, position = np.unique(np.stack([of, values]), axis=1, return_inverse=True)
    position = position.ravel()
    votes = np.bincount(position)
    least = np.full(len(votes), np.inf)
    np.minimum.at(least, position, squared)
    order = np.lexsort((least, -votes, keys[0]))
    first = np.flatnonzero(np.concatenate([[True], np.diff(keys[0][order]) != 0]))
    return keys[1][order[first]]
