# SPDX-License-Identifier: GPL-3.0-or-later
"""Enforce the maximum error: undo collapses that exceed it or make triangles cross."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Flags, Floats, Indices, Ints
from ...mesh.intersections import self_intersections_steps
from ...mesh.topology import compacted
from ...progress import Steps
from ..engine.collapse_log import CollapseLog
from ..engine.component_removal import without_components_steps
from ..engine.edge_collapse import CollapsingMesh
from ..engine.surface_rules import Surface
from .error_check import ErrorCheck
from .uncrossing import restored


def hold_bound_steps(mesh: CollapsingMesh) -> Steps[None]:
    """Undo collapses until the bound on the error, if there is one, holds everywhere."""
    if mesh.bound is None:
        return
    check, log, mesh.bound = mesh.bound.check, mesh.log, None  # the samples are not needed any more
    assert log is not None, "collapses within a bound are logged"
    surfaces = mesh.rules.surfaces(log.interface)
    if len(surfaces) == 1:
        checked = [_Checked(check, surfaces[0][0])]
    else:
        checked = []  # labels meet in creases, where a distance may grow at slope 1
        for surface in surfaces:
            checked.append(_Checked(ErrorCheck(check.limit, replace(check.policy, steep=1.0)), surface[0]))
            yield from checked[-1].check.prepare_steps(*_columns(check.original, check.original_faces, surface))
    mesh.crossing_count = yield from _undo_steps(mesh, log, checked)
    if len(surfaces) > 1:
        return
    of_face, of_original = mesh.component[mesh.faces[0]], log.component[check.original_faces[0]]
    removed = yield from without_components_steps(
        mesh.components, mesh.positions, mesh.faces, of_face, of_original, check
    )
    mesh.face_count -= int(removed.sum())
    mesh.faces[:, removed] = mesh.dummy
    if mesh.crossing_count and removed.any():
        crossing = yield from self_intersections_steps(mesh.positions.T, mesh.faces[:, ~removed].T)
        mesh.crossing_count = len(crossing)


@dataclass(eq=False)
class _Checked:
    """A surface, its original, and the parts still to be checked.

    check : ErrorCheck
    numbers : (f,) int64
        The log's numbers of the original's faces.
    whole : bool
        Whether all of the original is to be checked.
    """

    check: ErrorCheck
    numbers: Indices
    whole: bool = True

    def exceeding_steps(
        self, mesh: CollapsingMesh, log: CollapseLog, surface: Surface, to_check: Flags, compare: bool
    ) -> Steps[Ints]:
        """The last changes, (n,), wherever the surface or its original is too far from the other; -1 for none."""
        check, (faces, _) = self.check, surface
        if compare:
            yield from check.compare_with_steps(*_columns(mesh.positions, mesh.faces, surface))
        away = faces[(yield from check.faces_exceeding_steps(np.flatnonzero(to_check[faces])))]
        near = to_check[faces[check.nearest]][check.original_faces].any(axis=0)
        original = yield from check.original_exceeding_steps(np.flatnonzero(near | self.whole))
        # The last change that touched a face of the original, or a face nearest to one of its corners.
        corners = check.original_faces[:, original]
        nearest_changes = log.last_changes(log.face_number[faces[check.nearest[corners]]])
        nearest_changes[check.far[corners]] = -1
        own = log.last_changes(self.numbers[original])
        return np.concatenate([log.last_changes(log.face_number[away]), np.maximum(own, nearest_changes.max(axis=0))])


def _columns(positions: Floats, faces: Ints, surface: Surface) -> tuple[Floats, Ints]:
    """Return only the vertices and faces of a surface, facing outward."""
    numbers, turned = surface
    corners = np.take(faces, numbers, axis=1)
    corners[1:, turned] = corners[:0:-1, turned]
    if len(numbers) == faces.shape[1]:
        return positions, corners
    used, corners = compacted(corners, positions.shape[1])
    return np.compress(used, positions, axis=1), corners


def _undo_steps(mesh: CollapsingMesh, log: CollapseLog, checked: list[_Checked]) -> Steps[int]:
    """Undo the last change wherever the bound is exceeded or triangles cross, until neither occurs.

    Returns how many pairs of triangles cross that no change has touched, as in the original.

    After the first time only what was brought back is checked, of the original only what is near that: so all of the
    original is checked once more in the end. Crossings are looked for where the bound holds.
    """
    to_check = np.ones(mesh.faces.shape[1], bool)
    moved = np.zeros(len(mesh.locked), bool)
    compare = whole = True
    while True:
        last = [np.zeros(0, np.int32)]
        for each, surface in zip(checked, mesh.rules.surfaces(mesh.interface), strict=True):
            each.whole = whole
            last.append((yield from each.exceeding_steps(mesh, log, surface, to_check, compare)))
        changes = np.concatenate(last)
        crossing = np.zeros((0, 2), np.int64)
        if whole and not (changes >= 0).any():
            crossing = yield from self_intersections_steps(mesh.positions.T, mesh.faces.T)
            changes = log.last_changes(log.face_number[crossing.ravel()])
        changes = np.unique(changes[changes >= 0])  # untouched faces fail only by rounding
        compare = bool(len(changes))
        if len(changes):
            to_check, moved = restored(mesh, log, log.undo(changes), moved)
            whole = False
        elif whole:
            return len(crossing)
        else:
            whole = True
