# SPDX-License-Identifier: GPL-3.0-or-later
"""A record of what each round has changed, from which single collapses and cuts can be undone exactly.

A change is a collapse or the cut of a handle. It depends on every earlier change that touched one of its triangles.
Where a change is undone with all that depend on it, all that is left met the triangles that it meets now, for which it
was checked; so what is left is sound too. Faces, edges and vertices have the numbers that they had when the log began,
or got when they were made later: numbers of the log, which compacting the mesh does not change.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .collapses import Collapses

Ints = NDArray[np.int32]
Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Round:
    """What some changes, no two of which touch one face, found before them.

    count : int
        Number of changes.
    faces, owner : (s,) int32
        The faces touched, and by which change.
    corners, face_edges : (3, s) int32
        Their corners and edges.
    moved, moved_owner : (m,) int32
        Vertices moved or dropped, and by which change.
    positions, normals : (3, m) float32
        Where they were; normals may be None.
    new_faces, new_edges, new_owner : (2, k), (3, k) and (k,) int32
        Made by k cuts, and by which change.
    undone : (count,) bool
    """

    count: int
    faces: Ints
    owner: Ints
    corners: Ints
    face_edges: Ints
    moved: Ints
    moved_owner: Ints
    positions: Floats
    normals: Floats | None
    new_faces: Ints
    new_edges: Ints
    new_owner: Ints
    undone: Flags


class Numbered(Protocol):
    """What the log reads of a mesh whose edges collapse: see `CollapsingMesh`."""

    positions: Floats
    normals: Floats | None
    faces: Ints
    face_edges: Ints
    edges: Ints
    locked: Flags
    component: Ints
    original_vertex: Ints
    face_count: int


class CollapseLog:
    """The rounds since the log began, and the log's numbers of the faces, edges and vertices that the mesh has now.

    Parameters
    ----------
    mesh : Numbered
    crossing : (2, n) int32, optional
        Faces that cross each other as the log begins; None where that was not tested.
    """

    def __init__(self, mesh: Numbered, crossing: Ints | None = None) -> None:
        self.crossing, self.face_count = crossing, mesh.face_count
        self.rounds: list[Round] = []
        self.face_number = np.arange(mesh.faces.shape[1], dtype=np.int32)
        self.edge_number = np.arange(mesh.edges.shape[1], dtype=np.int32)
        self.vertex_number = np.arange(len(mesh.locked), dtype=np.int32)
        self.faces, self.edges, self.vertices = mesh.faces.shape[1], mesh.edges.shape[1], len(mesh.locked)
        # Of each vertex, by the log's numbers.
        self.locked, self.component, self.original_vertex = mesh.locked, mesh.component, mesh.original_vertex

    def compact(self, faces: Indices, edges: Indices, vertices: Indices) -> None:
        """Take in which faces, edges and vertices are left."""
        self.face_number = self.face_number[faces]
        self.edge_number = self.edge_number[edges]
        self.vertex_number = self.vertex_number[vertices]

    def append(self, faces: Ints, edges: Ints, vertices: Ints) -> None:
        """Take in the numbers of faces, edges and vertices that come after those of the mesh."""
        self.face_number = np.append(self.face_number, faces)
        self.edge_number = np.append(self.edge_number, edges)
        self.vertex_number = np.append(self.vertex_number, vertices)

    def add_collapses(self, mesh: Numbered, collapses: Collapses) -> None:
        """Record a round of collapses before it is done."""
        count = len(collapses.kept)
        moved = np.concatenate([collapses.kept, collapses.dropped])
        owner = np.tile(np.arange(count, dtype=np.int32), 2)
        self._add(mesh, count, (collapses.faces, collapses.owner), (moved, owner), 0, np.zeros(0, np.int32))

    def add_cuts(self, mesh: Numbered, loops: Ints) -> None:
        """Record the cuts of handles at loops (n, 3) before they are done. Those that meet one face are one change."""
        count = len(loops)
        loop = np.full(len(mesh.locked), -1, np.int32)
        loop[loops] = np.arange(count, dtype=np.int32)[:, None]
        of_corner = np.take(loop, mesh.faces)
        faces = np.flatnonzero((of_corner >= 0).any(axis=0))
        of_corner = of_corner[:, faces]
        change = np.arange(count + 1, dtype=np.int32)  # the last for corners in no loop
        before = None
        while before is None or (before != change).any():
            before = change.copy()
            lowest = change[of_corner].min(axis=0)
            for corner in of_corner:
                np.minimum.at(change, corner[corner >= 0], lowest[corner >= 0])
        owner = change[of_corner].min(axis=0)
        self._add(mesh, count, (faces, owner), (loops.ravel(), np.repeat(change[:-1], 3)), count, change[:-1])
        copies = np.arange(3 * count, dtype=np.int32)
        self.append(self.faces + copies[: 2 * count], self.edges + copies, (self.vertices + copies))
        self.faces, self.edges, self.vertices = (
            self.faces + 2 * count,
            self.edges + 3 * count,
            self.vertices + 3 * count,
        )
        original = self.vertex_number[loops.ravel()]
        self.locked = np.append(self.locked, self.locked[original])
        self.component = np.append(self.component, self.component[original])
        self.original_vertex = np.append(self.original_vertex, np.full(3 * count, -1, np.int32))

    def _add(
        self,
        mesh: Numbered,
        count: int,
        touched: tuple[NDArray[Any], Ints],
        moved: tuple[Ints, Ints],
        cuts: int,
        new_owner: Ints,
    ) -> None:
        faces, owner = touched
        vertices, moved_owner = moved
        self.rounds.append(
            Round(
                count,
                np.take(self.face_number, faces),
                owner,
                np.take(self.vertex_number, np.take(mesh.faces, faces, axis=1)),
                np.take(self.edge_number, np.take(mesh.face_edges, faces, axis=1)),
                np.take(self.vertex_number, vertices),
                moved_owner,
                np.take(mesh.positions, vertices, axis=1),
                None if mesh.normals is None else np.take(mesh.normals, vertices, axis=1),
                np.arange(self.faces, self.faces + 2 * cuts, dtype=np.int32).reshape(2, -1),
                np.arange(self.edges, self.edges + 3 * cuts, dtype=np.int32).reshape(-1, 3).T,
                new_owner,
                np.zeros(count, bool),
            )
        )

    def touched(self) -> Flags:
        """Which faces a change has touched, by the log's numbers; undone or not."""
        touched = np.zeros(self.faces, bool)
        for each in self.rounds:
            touched[each.faces] = touched[each.new_faces] = True
        return touched

    def last_changes(self) -> Ints:
        """The last change that stands, numbered through all rounds, that touched each face; -1 for none."""
        last = np.full(self.faces, -1, np.int32)
        for first, each in self._numbered():
            stands = np.flatnonzero(~np.take(each.undone, each.owner))
            last[each.faces[stands]] = each.owner[stands] + np.int32(first)
            last[each.new_faces] = np.where(each.undone[each.new_owner], -1, each.new_owner + np.int32(first))
        return last

    def undo(self, changes: Ints) -> list[tuple[Round, Flags]]:
        """Mark these changes, and all that depend on them, as undone; which of each round, (count,) bool."""
        wanted = np.zeros(sum(each.count for each in self.rounds), bool)
        wanted[changes] = True
        tainted = np.zeros(self.faces, bool)
        undone = []
        for first, each in self._numbered():
            asked = wanted[first : first + each.count]
            asked[each.owner[np.take(tainted, each.faces)]] = True
            asked &= ~each.undone
            if asked.any():
                each.undone[asked] = True
                tainted[each.faces[asked[each.owner]]] = True
                tainted[each.new_faces[:, asked[each.new_owner]]] = True
                undone.append((each, asked))
        return undone

    def vertices_of(self, changes: Ints) -> Ints:
        """Numbers of the vertices that these changes move, (m,)."""
        wanted = np.zeros(sum(each.count for each in self.rounds), bool)
        wanted[changes] = True
        moved = [each.moved[wanted[first + each.moved_owner]] for first, each in self._numbered()]
        return np.concatenate(moved)

    def _numbered(self) -> Iterator[tuple[int, Round]]:
        first = 0
        for each in self.rounds:
            yield first, each
            first += each.count
