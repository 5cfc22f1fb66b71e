# SPDX-License-Identifier: GPL-3.0-or-later
"""The arrays of a mesh while it is simplified, which its rules and the choice of its edges read."""

from __future__ import annotations

import numpy as np

from ...arrays import Flags, Floats, Ints
from ..bounds.error_bound import ErrorBound
from ..policy import Policy
from .component_removal import Components


class Columns:
    """Columns instead of rows, and every edge once.

    positions, normals : (3, V) float32
    quadrics : (6, V) float32
    faces : (3, F) int32, vertex numbers
    face_edges : (3, F) int32, the edge from corner i to corner i + 1
    edges : (2, E) int32, vertex numbers
    cost : (E,) float32, inf where the edge cannot be collapsed as things are
    interface : (F,) int32, number of the interface that each face is in; 0 of a surface by itself
    locked : (V,) bool, vertices that stay where they are
    component : (V,) int32
    original_vertex : (V,) int32, number in the mesh at first, -1 of a copy that a cut handle made
    doubtful : bool, by these numbers, vertices at which triangles have come to cross

    Faces and edges that are gone stand at the `dummy` vertex. Positions and the `limit` of the error are multiplied by
    `scale`. In a `batch` of a surface, components with a border go on beyond it: none of these is removed.
    """

    positions: Floats
    normals: Floats | None
    quadrics: Floats
    faces: Ints
    face_edges: Ints
    edges: Ints
    cost: Floats
    interface: Ints
    locked: Flags
    component: Ints
    original_vertex: Ints
    doubtful: Flags
    components: Components
    face_count: int
    face_cost: float
    dummy: int
    scale: np.float32
    limit: float | None
    batch: bool
    bound: ErrorBound | None
    policy: Policy
