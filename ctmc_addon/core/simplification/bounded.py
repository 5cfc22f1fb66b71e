# SPDX-License-Identifier: GPL-3.0-or-later
"""The end of simplification within a maximum error: what exceeds it is reverted."""

from __future__ import annotations

import numpy as np

from ..mesh.intersections import self_intersections_steps
from ..progress import Steps
from .component_removal import without_components_steps
from .edge_collapse import CollapsingMesh
from .rollback import roll_back_steps


def hold_bound_steps(mesh: CollapsingMesh) -> Steps[None]:
    """Revert collapses until the bound on the error, if there is one, holds everywhere: last of all."""
    if mesh.bound is None:
        return
    history, check, mesh.bound = mesh.history, mesh.bound.check, None  # the samples are not needed any more
    del mesh.quadrics, mesh.cost, mesh.edges, mesh.face_edges
    mesh.crossing_count = yield from roll_back_steps(history, check)
    mesh.positions, mesh.normals = history.positions, history.normals
    mesh.original_vertex = np.arange(mesh.positions.shape[1], dtype=np.int32)
    mesh.faces = yield from without_components_steps(mesh.components, history, check)
    mesh.face_count = mesh.faces.shape[1]
    if mesh.crossing_count:  # perhaps of components that are gone
        crossing = yield from self_intersections_steps(mesh.positions.T, mesh.faces.T)
        mesh.crossing_count = len(crossing)
