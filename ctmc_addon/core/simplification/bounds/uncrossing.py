# SPDX-License-Identifier: GPL-3.0-or-later
"""Undo collapses, and cuts of handles, after which triangles of a surface cross each other, until none do.

The surface is tested when a quarter of its triangles is left, and at the end. Of two triangles that cross, the last
change that touched either is undone, with all that depend on it; then what that brought back is tested. In the
worst case a place is as it was at the last test. After the test at the end the triangles that are then too many go
elsewhere, by collapses that are tested before they are done (`crossing_check`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags, Indices, Ints
from ...mesh.intersections import self_intersections_steps
from ...progress import PAUSE, Steps
from ..engine.collapse_log import CollapseLog, Undone
from ..engine.edge_collapse import CollapsingMesh
from ..engine.quadrics import renew_quadrics_steps


def uncross_steps(mesh: CollapsingMesh, hold: bool) -> Steps[bool]:
    """Undo changes since the last call that made triangles cross which did not cross in the original mesh.

    Parameters
    ----------
    mesh : CollapsingMesh
        Its `crossing_count` then tells how many pairs still cross.
    hold : bool
        Test collapses from now on if something is undone because of a crossing; lock the vertices of what is undone
        for the second time.

    Returns
    -------
    bool
        Whether anything was undone.
    """
    log = mesh.log
    if log is None or not (log.untested or _may_have_separated(log)):
        return False
    crossing, undone = yield from _uncross_steps(mesh, log, hold)
    mesh.begin_log(crossing)
    mesh.crossing_count = crossing.shape[1]
    if undone:
        mesh.poor_rounds = 0
    return undone


def _may_have_separated(log: CollapseLog) -> bool:
    """Return whether tested changes may have separated triangles that crossed before, so that they must be counted."""
    return log.crossing is not None and bool(log.crossing.shape[1]) and bool(log.rounds)


def _uncross_steps(mesh: CollapsingMesh, log: CollapseLog, hold: bool) -> Steps[tuple[Ints, bool]]:
    """Undo crossings; return the faces that cross as before, (2, n), and whether anything was undone."""
    left, selected = [np.zeros((2, 0), np.int32)], None
    if log.crossing is not None:
        touched = log.touched()
        left = [log.crossing[:, ~touched[log.crossing].any(axis=0)]]
        selected = np.take(touched, log.face_number)
    asked: list[Ints] = []
    moved = np.zeros(len(mesh.locked), bool)
    while True:
        pairs = log.face_number[(yield from _crossing_steps(mesh, selected))]
        last = log.last_changes(pairs)
        yield PAUSE
        left.append(pairs[:, (last < 0).all(axis=0)])
        last = np.unique(last[last >= 0])
        if not len(last):
            break
        asked.append(log.vertices_of(last))
        selected, moved = restored(mesh, log, log.undo(last), moved)
        yield PAUSE
    if asked:
        held = log.places.vertices[np.concatenate(asked)]
        if hold:
            mesh.doubt(held[held >= 0])
        yield from _settle_steps(mesh, moved)
    crossing = log.places.faces[np.unique(np.concatenate(left, axis=1), axis=1)]
    present = (crossing >= 0).all(axis=0) & (mesh.faces[0, crossing] != mesh.dummy).all(axis=0)
    return crossing[:, present], bool(asked)


def _crossing_steps(mesh: CollapsingMesh, selected: Flags | None) -> Steps[Indices]:
    """Pairs of faces that cross, (2, n), with at least one of the selected."""
    alive = np.flatnonzero(mesh.faces[0] != mesh.dummy)
    of_alive = None if selected is None else selected[alive]
    pairs = yield from self_intersections_steps(mesh.positions.T, mesh.faces[:, alive].T, of_alive)
    return alive[pairs.T]


def restored(mesh: CollapsingMesh, log: CollapseLog, undone: list[Undone], moved: Flags) -> tuple[Flags, Flags]:
    """Restore what these changes changed; return which faces are as before, and which vertices moved."""
    corners, sides = np.empty((3, log.faces), np.int32), np.empty((3, log.faces), np.int32)
    positions = np.empty((3, log.vertices), np.float32)
    normals = None if mesh.normals is None else np.empty((3, log.vertices), np.float32)
    back, placed = np.zeros(log.faces, bool), np.zeros(log.vertices, bool)
    cap_edges = [np.zeros(0, np.int32)]
    for each in reversed(undone):  # the last first: what was before the first stays
        before = each.round
        faces, vertices = before.faces[each.faces], before.moved[each.moved]
        for to, of in zip((*corners, *sides), (*before.corners, *before.face_edges), strict=True):
            to[faces] = of[each.faces]
        back[faces], placed[vertices] = True, True
        positions[:, vertices] = before.positions[:, each.moved]
        if normals is not None and before.normals is not None:
            normals[:, vertices] = before.normals[:, each.moved]
        cap_edges.append(before.new_edges[:, each.cuts].ravel())
        mesh.handles_cut -= len(each.cuts)
    faces, vertices = np.flatnonzero(back), np.flatnonzero(placed)
    corners, sides = corners[:, faces], sides[:, faces]
    is_cap = corners[0] < 0
    removed, faces = faces[is_cap], faces[~is_cap]
    corners, sides = corners[:, ~is_cap], sides[:, ~is_cap]
    _append(mesh, log, faces, np.unique(sides), vertices)
    moved = np.append(moved, np.zeros(len(mesh.locked) - len(moved), bool))

    at_face, at_edge, at_vertex = log.places
    here = at_vertex[vertices]
    mesh.positions[:, here], moved[here] = positions[:, vertices], True
    if mesh.normals is not None and normals is not None:
        mesh.normals[:, here] = normals[:, vertices]
    removed = at_face[removed]
    removed = removed[removed >= 0]
    mesh.face_count -= int((mesh.faces[0, removed] != mesh.dummy).sum())
    mesh.faces[:, removed] = mesh.dummy
    removed = at_edge[np.concatenate(cap_edges)]
    removed = removed[removed >= 0]
    mesh.edges[:, removed], mesh.cost[removed] = mesh.dummy, np.inf
    corners, sides, faces = np.take(at_vertex, corners), np.take(at_edge, sides), at_face[faces]
    mesh.face_count += int((mesh.faces[0, faces] == mesh.dummy).sum())
    mesh.faces[:, faces], mesh.face_edges[:, faces] = corners, sides
    for start in range(3):
        mesh.edges[0, sides[start]], mesh.edges[1, sides[start]] = corners[start], corners[start - 2]
    selected = np.zeros(mesh.faces.shape[1], bool)
    selected[faces] = True
    return selected, moved


def _append(
    mesh: CollapsingMesh, log: CollapseLog, faces: NDArray[Any], edges: NDArray[Any], vertices: NDArray[Any]
) -> None:
    """Bring back room for those of these faces, edges and vertices of the log that the mesh no longer has."""
    at_face, at_edge, at_vertex = log.places
    faces, edges, vertices = faces[at_face[faces] < 0], edges[at_edge[edges] < 0], vertices[at_vertex[vertices] < 0]
    if not len(faces) + len(edges) + len(vertices):
        return
    mesh.faces = np.append(mesh.faces, np.full((3, len(faces)), mesh.dummy, np.int32), axis=1)
    mesh.face_edges = np.append(mesh.face_edges, np.zeros((3, len(faces)), np.int32), axis=1)
    mesh.interface = np.append(mesh.interface, log.interface[faces])
    mesh.edges = np.append(mesh.edges, np.full((2, len(edges)), mesh.dummy, np.int32), axis=1)
    mesh.cost = np.append(mesh.cost, np.full(len(edges), np.inf, np.float32))
    space = np.zeros((3, len(vertices)), np.float32)
    mesh.positions = np.append(mesh.positions, space, axis=1)
    mesh.quadrics = np.append(mesh.quadrics, np.zeros((6, len(vertices)), np.float32), axis=1)
    if mesh.normals is not None:
        mesh.normals = np.append(mesh.normals, space, axis=1)
    mesh.locked = np.append(mesh.locked, log.locked[vertices])
    mesh.component = np.append(mesh.component, log.component[vertices])
    mesh.original_vertex = np.append(mesh.original_vertex, log.original_vertex[vertices])
    mesh.vertex_becomes = np.arange(len(mesh.locked), dtype=np.int32)
    mesh.edge_becomes = np.arange(len(mesh.cost), dtype=np.int32)
    mesh.rules.brought_back(faces, edges, vertices)
    log.append(faces.astype(np.int32), edges.astype(np.int32), vertices.astype(np.int32))


def _settle_steps(mesh: CollapsingMesh, moved: Flags) -> Steps[None]:
    """Recompute everything that depends on the positions of vertices that moved back."""
    mesh.rules.was_undone(mesh)
    yield from renew_quadrics_steps(mesh.quadrics, mesh.positions, mesh.faces, moved)
    yield from mesh.update_costs_steps(np.flatnonzero(np.take(moved, mesh.edges).any(axis=0)))
