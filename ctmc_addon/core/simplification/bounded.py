# SPDX-License-Identifier: GPL-3.0-or-later
"""The end of simplification within a maximum error: undo what exceeds it or crosses, as `uncrossing` does."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..mesh.intersections import self_intersections_steps
from ..progress import Steps
from .collapse_log import CollapseLog
from .component_removal import without_components_steps
from .edge_collapse import CollapsingMesh
from .error_check import ErrorCheck
from .uncrossing import restored

Ints = NDArray[np.int32]
Indices = NDArray[np.int64]


def hold_bound_steps(mesh: CollapsingMesh) -> Steps[None]:
    """Undo collapses until the bound on the error, if there is one, holds everywhere: last of all."""
    if mesh.bound is None:
        return
    check, log, mesh.bound = mesh.bound.check, mesh.log, None  # the samples are not needed any more
    assert log is not None, "collapses within a bound are logged"
    mesh.crossing_count = yield from _undo_steps(mesh, log, check)
    of_face, of_original = mesh.component[mesh.faces[0]], log.component[check.original_faces[0]]
    gone = yield from without_components_steps(mesh.components, mesh.positions, mesh.faces, of_face, of_original, check)
    mesh.face_count -= int(gone.sum())
    mesh.faces[:, gone] = mesh.dummy
    if mesh.crossing_count and gone.any():
        crossing = yield from self_intersections_steps(mesh.positions.T, mesh.faces[:, ~gone].T)
        mesh.crossing_count = len(crossing)


def _undo_steps(mesh: CollapsingMesh, log: CollapseLog, check: ErrorCheck) -> Steps[int]:
    """Undo the last change wherever the bound is exceeded or triangles cross, until neither is so anywhere.

    Returns how many pairs of triangles cross that no change has touched, as in the original.

    After the first time only what was brought back is checked, of the original only what is near that: so all of the
    original is checked once more in the end. Crossings are looked for where the bound holds.
    """
    corners = check.original_faces
    to_check = np.ones(mesh.faces.shape[1], bool)
    moved = np.zeros(len(mesh.locked), bool)
    every_original = True
    yield from check.compare_with_steps(mesh.positions, mesh.faces)
    while True:
        faces = yield from check.faces_exceeding_steps(np.flatnonzero(to_check))
        near = to_check[check.nearest][corners].any(axis=0)
        original = yield from check.original_exceeding_steps(np.flatnonzero(near | every_original))
        last = np.concatenate([log.last_changes(log.face_number[faces]), _last_near(log, check, original)])
        crossing = np.zeros((0, 2), np.int64)
        if every_original and not (last >= 0).any():
            crossing = yield from self_intersections_steps(mesh.positions.T, mesh.faces.T)
            last = log.last_changes(log.face_number[crossing.ravel()])
        last = np.unique(last[last >= 0])  # a face that no change has touched is away by the check's rounding alone
        if len(last):
            to_check, moved = restored(mesh, log, log.undo(last), moved)
            yield from check.compare_with_steps(mesh.positions, mesh.faces)
            every_original = False
        elif every_original:
            return len(crossing)
        else:
            every_original = True


def _last_near(log: CollapseLog, check: ErrorCheck, original: Indices) -> Ints:
    """The last change that touched each of these faces of the original, or a face nearest to one of its corners."""
    corners = check.original_faces[:, original]
    near = log.last_changes(log.face_number[check.nearest[corners]])
    near[check.far[corners]] = -1
    return np.concatenate([near, log.last_changes(original)[None]]).max(axis=0)
