# SPDX-License-Identifier: GPL-3.0-or-later
"""A record of what each round has changed, from which single collapses and cuts can be undone exactly.

A change is a collapse or the cut of a handle. It depends on every earlier change that touched one of its triangles.
Where a change is undone with all that depend on it, all that is left met the triangles that it meets now, for which it
was checked; so what is left is sound too. Faces, edges and vertices have the numbers that they had when the log began,
or got when they were made later: numbers of the log, which compacting the mesh does not change.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags, Floats, Indices, Ints
from ...mesh.topology import component_roots_steps
from ...progress import finish
from .collapses import Collapses


@dataclass(frozen=True, eq=False)
class Round:
    """State before a round of changes, no two of which touch one face.

    count, first : int
        Number of changes, and of those in rounds before.
    start : int
        Number of faces touched in rounds before, once for each time.
    faces, owner : (s,) int32
        The faces touched, or made by a cut, and by which change.
    before : (s,) int32
        When each was last touched, counted as in `start`; -1 for never.
    corners, face_edges : (3, s) int32
        Their corners and edges; -1 of those that a cut makes.
    moved, moved_owner : (m,) int32
        Vertices moved or dropped, and by which change.
    positions, normals : (3, m) float32
        Former positions and normals; normals may be None.
    new_edges, new_owner : (3, k) and (k,) int32
        Made by k cuts, and by which change.
    """

    count: int
    first: int
    start: int
    faces: Ints
    owner: Ints
    before: Ints
    corners: Ints
    face_edges: Ints
    moved: Ints
    moved_owner: Ints
    positions: Floats
    normals: Floats | None
    new_edges: Ints
    new_owner: Ints


@dataclass(frozen=True, eq=False)
class Undone:
    """Parts of a round that are undone.

    faces, moved, cuts : (n,) int64
        Places in the round's arrays of faces, of moved vertices and of cuts.
    """

    round: Round
    faces: Indices
    moved: Indices
    cuts: Indices


class Places(NamedTuple):
    """Positions in the mesh of the log's faces, edges and vertices, -1 for absent ones; int32."""

    faces: Ints
    edges: Ints
    vertices: Ints


class Numbered(Protocol):
    """Arrays of a mesh whose edges collapse that the log reads: see `CollapsingMesh`."""

    positions: Floats
    normals: Floats | None
    faces: Ints
    face_edges: Ints
    edges: Ints
    interface: Ints
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
        self._index: _Index | None = None  # of all rounds, once something is undone
        self._places: Places | None = None
        self.untested = crossing is None  # whether something that stands here may have made triangles cross
        self.face_number = np.arange(mesh.faces.shape[1], dtype=np.int32)
        self.edge_number = np.arange(mesh.edges.shape[1], dtype=np.int32)
        self.vertex_number = np.arange(len(mesh.locked), dtype=np.int32)
        self.faces, self.edges, self.vertices = mesh.faces.shape[1], mesh.edges.shape[1], len(mesh.locked)
        self.last = np.full(self.faces, -1, np.int32)  # when each face was last touched by a change that stands
        self.interface = mesh.interface  # of each face, by the log's numbers, as what follows of each vertex
        self.locked, self.component, self.original_vertex = mesh.locked, mesh.component, mesh.original_vertex

    def compact(self, faces: Indices, edges: Indices, vertices: Indices) -> None:
        """Take in the faces, edges and vertices that are left."""
        self.face_number = self.face_number[faces]
        self.edge_number = self.edge_number[edges]
        self.vertex_number = self.vertex_number[vertices]
        self._places = None

    def append(self, faces: Ints, edges: Ints, vertices: Ints) -> None:
        """Take in the numbers of faces, edges and vertices that come after those of the mesh."""
        self.face_number = np.append(self.face_number, faces)
        self.edge_number = np.append(self.edge_number, edges)
        self.vertex_number = np.append(self.vertex_number, vertices)
        self._places = None

    @property
    def places(self) -> Places:
        """Return the positions of the log's faces, edges and vertices in the present mesh."""
        if self._places is None:
            self._places = Places(
                _inverse(self.face_number, self.faces),
                _inverse(self.edge_number, self.edges),
                _inverse(self.vertex_number, self.vertices),
            )
        return self._places

    def add_collapses(self, mesh: Numbered, collapses: Collapses, tested: bool) -> None:
        """Record a round of collapses before it is done; whether it was tested that they make nothing cross."""
        self.untested |= not tested
        count = len(collapses.kept)
        moved = np.concatenate([collapses.kept, collapses.dropped])
        owner = np.tile(np.arange(count, dtype=np.int32), 2)
        self._add(mesh, count, (collapses.faces, collapses.owner), (moved, owner), np.zeros(0, np.int32))

    def add_cuts(self, mesh: Numbered, loops: Ints, caps: Ints) -> None:
        """Record the cuts of handles at loops (n, 3) before they are done. Those that meet one face are one change.

        `caps` are the interfaces, (2 n,), of the triangles that close them.
        """
        self.untested = True
        count = len(loops)
        loop = np.full(len(mesh.locked), -1, np.int32)
        loop[loops] = np.arange(count, dtype=np.int32)[:, None]
        of_corner = np.take(loop, mesh.faces)
        faces = np.flatnonzero((of_corner >= 0).any(axis=0))
        of_corner = of_corner[:, faces]
        met = np.where(of_corner >= 0, of_corner, of_corner.max(axis=0))
        change = finish(component_roots_steps(met.T, count))
        self._add(mesh, count, (faces, change[met[0]]), (loops.ravel(), np.repeat(change, 3)), change)
        copies = np.arange(3 * count, dtype=np.int32)
        self.append(self.faces + copies[: 2 * count], self.edges + copies, (self.vertices + copies))
        self.faces, self.edges, self.vertices = (
            self.faces + 2 * count,
            self.edges + 3 * count,
            self.vertices + 3 * count,
        )
        original = self.vertex_number[loops.ravel()]
        self.interface = np.append(self.interface, caps)
        self.locked = np.append(self.locked, self.locked[original])
        self.component = np.append(self.component, self.component[original])
        self.original_vertex = np.append(self.original_vertex, np.full(3 * count, -1, np.int32))

    def _add(
        self, mesh: Numbered, count: int, touched: tuple[NDArray[Any], Ints], moved: tuple[Ints, Ints], cuts: Ints
    ) -> None:
        """Record changes: the faces they touch, the vertices they move, and which changes cut how often."""
        faces, owner = touched
        vertices, moved_owner = moved
        numbers = np.take(self.face_number, faces)
        corners = np.take(self.vertex_number, np.take(mesh.faces, faces, axis=1))
        face_edges = np.take(self.edge_number, np.take(mesh.face_edges, faces, axis=1))
        new = len(cuts)
        if new:
            caps = np.arange(self.faces, self.faces + 2 * new, dtype=np.int32)
            nothing = np.full((3, len(caps)), -1, np.int32)
            numbers, owner = np.append(numbers, caps), np.concatenate([owner, cuts, cuts])
            corners, face_edges = np.append(corners, nothing, axis=1), np.append(face_edges, nothing, axis=1)
            self.last = np.append(self.last, nothing[0])
        first, start = (0, 0) if not self.rounds else self._ends()
        before = np.take(self.last, numbers)
        self.last[numbers] = np.arange(start, start + len(numbers), dtype=np.int32)
        self._index = None
        self.rounds.append(
            Round(
                count,
                first,
                start,
                numbers,
                owner,
                before,
                corners,
                face_edges,
                np.take(self.vertex_number, vertices),
                moved_owner,
                np.take(mesh.positions, vertices, axis=1),
                None if mesh.normals is None else np.take(mesh.normals, vertices, axis=1),
                np.arange(self.edges, self.edges + 3 * new, dtype=np.int32).reshape(-1, 3).T,
                cuts,
            )
        )

    def _ends(self) -> tuple[int, int]:
        """Return the number of changes, and of touches of faces."""
        last = self.rounds[-1]
        return last.first + last.count, last.start + len(last.faces)

    def touched(self) -> Flags:
        """Return which faces a change that is not undone has touched, by the log's numbers."""
        return self.last >= 0

    def last_changes(self, faces: NDArray[Any]) -> Ints:
        """Return the last change still in effect that touched each of these faces, in all rounds; -1 for none."""
        when = np.take(self.last, faces)
        if not self.rounds:
            return when
        return np.where(when >= 0, np.take(self._indexed().change, when), np.int32(-1))

    def undo(self, changes: NDArray[Any]) -> list[Undone]:
        """Mark these changes and all that depend on them as undone, and return the undone parts of each round."""
        index = self._indexed()
        undone = np.zeros(self._ends()[0], bool)
        touches = [np.zeros(0, np.int32)]
        asked = np.unique(changes)
        while len(asked):
            undone[asked] = True
            now = index.touches_of(asked)
            touches.append(now)
            # All changes that touched these faces later, back from the last.
            when, depending = np.take(self.last, np.take(index.faces, now)), [np.zeros(0, np.int32)]
            while len(later := np.flatnonzero(when > now)):
                when, now = when[later], now[later]
                depending.append(np.take(index.change, when))
                when = np.take(index.before, when)
            asked = np.unique(np.concatenate(depending))
            asked = asked[~undone[asked]]
        at = np.sort(np.concatenate(touches))
        self.last[index.faces[at[::-1]]] = index.before[at[::-1]]  # of several the first, which is written last
        ends = np.searchsorted(at, [each.start for each in self.rounds[1:]])
        out = []
        for each, places in zip(self.rounds, np.split(at, ends), strict=True):
            if len(places):
                here = undone[each.first : each.first + each.count]
                moved, cuts = np.flatnonzero(here[each.moved_owner]), np.flatnonzero(here[each.new_owner])
                out.append(Undone(each, places - each.start, moved, cuts))
        return out

    def vertices_of(self, changes: Ints) -> Ints:
        """Numbers of the vertices that these changes move, (m,)."""
        selected = np.zeros(self._ends()[0], bool)
        selected[changes] = True
        return np.concatenate([each.moved[selected[each.first + each.moved_owner]] for each in self.rounds])

    def _indexed(self) -> _Index:
        if self._index is None:
            self._index = _Index(self.rounds)
        return self._index


class _Index:
    """All rounds as one, to find a few changes in: each time that a face was touched is a touch, in their order.

    faces, change, before : (n,) int32
        Face and change of each touch, and the touch of the face before it.
    """

    def __init__(self, rounds: list[Round]) -> None:
        self.faces = np.concatenate([each.faces for each in rounds])
        self.change = np.concatenate([each.owner + np.int32(each.first) for each in rounds])
        self.before = np.concatenate([each.before for each in rounds])
        # The touches of each change follow one another. Numbers of 16 bits are sorted several times faster.
        sorts = [each.owner.astype(np.uint16 if each.count <= 1 << 16 else np.uint32) for each in rounds]
        self._touches = np.empty(len(self.change), np.int32)
        for owner, each in zip(sorts, rounds, strict=True):
            self._touches[each.start : each.start + len(owner)] = np.argsort(owner, kind="stable") + each.start
        self._counts = np.bincount(self.change, minlength=rounds[-1].first + rounds[-1].count)
        self._ends = np.cumsum(self._counts)

    def touches_of(self, changes: NDArray[Any]) -> Ints:
        """The touches of these changes."""
        counts = self._counts[changes]
        ends = np.cumsum(counts)
        return self._touches[np.arange(counts.sum()) + np.repeat(self._ends[changes] - ends, counts)]


def _inverse(numbers: Ints, count: int) -> Ints:
    """Return the position of each of `count` numbers, (count,), -1 for absent ones."""
    places = np.full(count, -1, np.int32)
    places[numbers] = np.arange(len(numbers), dtype=np.int32)
    return places
