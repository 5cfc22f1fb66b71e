# SPDX-License-Identifier: GPL-3.0-or-later
"""The collapses of one round: edges whose triangles do not meet, and the faces round them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags, Floats, Indices, Ints
from ...mesh.vectors import cross, dot
from ...progress import PAUSE, Steps
from ..policy import POLICY, Policy


@dataclass(frozen=True, eq=False)
class Collapses:
    """Edges about to collapse, no two with an end at the same triangle, and the faces round them.

    edges : (n,) int64
    kept, dropped : (n,) int32
        The ends: the vertex that stays, and moves to the target, and the one that goes.
    target : (3, n) float32
    faces : (s,) int64
        Faces with a corner in a collapse.
    owner : (s,) int32
        Collapse of each of those faces.
    vanishing : (s,) bool
        Whether the face vanishes: it has two corners there.
    normals : two of (3, f) float32, or None
        Normals of the faces that stay, before and after, as long as twice their areas.
    """

    edges: Indices
    kept: Ints
    dropped: Ints
    target: Floats
    faces: Indices
    owner: Ints
    vanishing: Flags
    normals: tuple[Floats, Floats] | None = None

    def select(self, selected: Flags) -> Collapses:
        """Return the selected collapses, (n,) bool, renumbered."""
        if selected.all():
            return self
        number = np.cumsum(selected, dtype=np.int32) - np.int32(1)
        faces = selected[self.owner]
        normals = None
        if self.normals is not None:
            left = faces[~self.vanishing]
            normals = np.compress(left, self.normals[0], axis=1), np.compress(left, self.normals[1], axis=1)
        return Collapses(
            self.edges[selected],
            self.kept[selected],
            self.dropped[selected],
            np.compress(selected, self.target, axis=1),
            self.faces[faces],
            number[self.owner[faces]],
            self.vanishing[faces],
            normals,
        )

    def at_vertices(self, vertices: Flags, faces: Ints) -> Flags:
        """Return which collapses have one of the vertices (V,) bool at one of their faces, (n,) bool."""
        touched = np.zeros(len(self.edges), bool)
        touched[self.owner[np.take(vertices, np.take(faces, self.faces, axis=1)).any(axis=0)]] = True
        return touched

    def slots(self, corners: Ints, vertex_count: int) -> tuple[Flags, Flags]:
        """Return of which faces that stay (3, f) the second corner is in a collapse, and of which the third."""
        is_end = np.zeros(vertex_count, bool)
        is_end[self.kept] = is_end[self.dropped] = True
        return np.take(is_end, corners[1]), np.take(is_end, corners[2])

    def apexes(self, corners: Ints, owner: Ints) -> Ints:
        """Return the corners of vanishing faces (3, f) that are in none of these collapses, (f,)."""
        return corners.sum(axis=0, dtype=np.int32) - (self.kept[owner] + self.dropped[owner])

    def moved(self, positions: Floats) -> Floats:
        """Positions (3, V) with both ends of every edge at its target."""
        moved = positions.copy()
        for row, target in zip(moved, self.target, strict=True):
            row[self.kept] = row[self.dropped] = target
        return moved


def turned(rows: Ints, slots: tuple[Flags, Flags], by: int) -> Ints:
    """Return of every column (3, f) the value that many rows after its slot (see `Collapses.slots`), (f,)."""
    second, third = slots
    return np.where(second, rows[(by + 1) % 3], np.where(third, rows[(by + 2) % 3], rows[by]))


def locked_vertices_steps(faces: Ints, edges: Ints, face_edges: Ints) -> Steps[tuple[Ints, Ints]]:
    """Vertices that stay where they are: those on a border, and those of faces at an edge with three faces or more."""
    faces_at = np.bincount(face_edges.ravel(), minlength=edges.shape[1])
    yield PAUSE
    non_manifold = (faces_at > 2) | (edges[0] == edges[1])
    return edges[:, faces_at == 1].ravel(), faces[:, non_manifold[face_edges].any(axis=0)].ravel()


def independent_set_steps(
    candidates: Indices, edges: Ints, vertex_count: int, policy: Policy = POLICY
) -> Steps[Indices]:
    """Return candidates, no two of which have an end at the same triangle; the first ones win."""
    a, b = np.take(edges, candidates, axis=1).astype(np.intp)
    waiting = np.zeros(vertex_count, bool)  # ends of candidates
    waiting[a] = waiting[b] = True
    yield PAUSE
    first, second = edges  # only edges between two ends of candidates can part them
    independent: list[Indices] = []
    for _ in range(policy.passes):
        between = np.flatnonzero(np.take(waiting, first) & np.take(waiting, second))
        first, second = np.take(first, between).astype(np.intp), np.take(second, between).astype(np.intp)
        yield PAUSE
        count = len(candidates)
        rank = np.arange(count, dtype=np.int32)
        # The best rank at every vertex: written from the worst to the best, the last stays.
        best = np.full(vertex_count, count, np.int32)
        best[np.stack([a[::-1], b[::-1]], axis=1).ravel()] = np.repeat(rank[::-1], 2)
        best_at_first, best_at_second = np.take(best, first), np.take(best, second)
        lost = np.zeros(vertex_count, bool)
        lost[np.compress(best_at_first > best_at_second, first)] = True
        lost[np.compress(best_at_second > best_at_first, second)] = True
        won = (np.take(best, a) == rank) & (np.take(best, b) == rank) & ~(np.take(lost, a) | np.take(lost, b))
        independent.append(candidates[won])
        yield PAUSE

        near = np.zeros(vertex_count, bool)
        near[a[won]] = near[b[won]] = True
        free = ~near
        free[np.compress(np.take(near, second), first)] = False
        free[np.compress(np.take(near, first), second)] = False
        left = np.flatnonzero(np.take(free, a) & np.take(free, b))
        candidates, a, b = candidates[left], a[left], b[left]
        waiting = np.zeros(vertex_count, bool)
        waiting[a] = waiting[b] = True
        yield PAUSE
    return np.concatenate(independent)


def violates_link_condition_steps(
    collapses: Collapses, faces: Ints, face_edges: Ints, counts: tuple[int, int]
) -> Steps[Flags]:
    """Return which collapses violate the link condition, (n,) bool: the ends must share exactly two neighbors.

    And neither of the two may have only one neighbor beside them, or a tetrahedron would fold flat. `faces` and
    `face_edges` are (3, F), `counts` the numbers of vertices and edges.
    """
    vertex_count, edge_count = counts
    vanishing, left = np.flatnonzero(collapses.vanishing), np.flatnonzero(~collapses.vanishing)
    # The third corners of the two faces that vanish: the first of them is the last to be written.
    owner = collapses.owner[vanishing]
    apex = collapses.apexes(np.take(faces, collapses.faces[vanishing], axis=1), owner)
    first, last = np.full((2, len(collapses.edges)), -1, np.int32)
    last[owner] = apex
    first[owner[::-1]] = apex[::-1]
    refused = (np.bincount(owner, minlength=len(collapses.edges)) != 2) | (first == last)
    yield PAUSE

    owner, number = collapses.owner[left], collapses.faces[left]
    corners = np.take(faces, number, axis=1)
    slots = collapses.slots(corners, vertex_count)
    inner, *outer = (turned(corners, slots, by) for by in range(3))
    at_kept = inner == np.take(collapses.kept, owner)
    yield PAUSE
    kept_sides, dropped_sides = np.flatnonzero(at_kept), np.flatnonzero(~at_kept)
    (near_kept, kept_owner), (near_dropped, dropped_owner) = (
        (np.concatenate([np.take(vertex, side) for vertex in outer]), np.tile(np.take(owner, side), 2))
        for side in (kept_sides, dropped_sides)
    )
    yield PAUSE
    of_vertex = np.full(vertex_count, -1, np.int32)
    while len(near_kept):  # a vertex has room for one collapse: the others come next
        of_vertex[near_kept] = kept_owner
        shared = np.flatnonzero(np.take(of_vertex, near_dropped) == dropped_owner)
        vertex, of = np.take(near_dropped, shared), np.take(dropped_owner, shared)
        refused[of[(vertex != np.take(first, of)) & (vertex != np.take(last, of))]] = True
        waiting = np.flatnonzero(np.take(of_vertex, near_kept) != kept_owner)
        near_kept, kept_owner = np.take(near_kept, waiting), np.take(kept_owner, waiting)
    yield PAUSE
    opposite = turned(np.take(face_edges, number, axis=1), slots, 1)
    here = np.arange(len(left), dtype=np.int32)
    seen = np.empty(edge_count, np.int32)
    seen[opposite] = here
    twice = np.take(seen, opposite)
    refused[owner[(twice != here) & (np.take(owner, twice) == owner)]] = True
    return refused


def shared_neighbors_steps(collapses: Collapses, edges: Ints, vertex_count: int) -> Steps[tuple[Indices, Indices]]:
    """Vertices that these edges connect to both ends of a collapse: the number of the collapse, and the vertex."""
    count = len(collapses.edges)
    owner = np.full(vertex_count, -1, np.int32)
    owner[collapses.kept] = owner[collapses.dropped] = np.arange(count, dtype=np.int32)
    first, second = edges
    owner_first, owner_second = np.take(owner, first), np.take(owner, second)
    pairs = []
    for inside, outside, end in ((owner_first, owner_second, second), (owner_second, owner_first, first)):
        across = np.flatnonzero((inside >= 0) & (inside != outside))
        pairs.append(inside[across].astype(np.int64) * vertex_count + end[across])
        yield PAUSE
    keys = np.sort(np.concatenate(pairs))
    return np.divmod(keys[1:][keys[1:] == keys[:-1]], vertex_count)


def crosses_border_steps(collapses: Collapses, faces: Ints, edges: Ints, locked: Flags) -> Steps[Flags]:
    """Return which collapses would make an edge or face between border vertices only, (n,) bool.

    Beyond the border there may be the same one, and in a batch of a surface nobody would see it.
    """
    refused = np.zeros(len(collapses.edges), bool)
    onto = np.flatnonzero(locked[collapses.kept])  # the vertex that goes is not locked
    if not len(onto):
        return refused
    keys = []
    for ends in (collapses.dropped, collapses.kept):
        owner = np.full(len(locked), -1, np.int32)
        owner[ends[onto]] = onto
        pairs = []
        for inner, outer in (edges, edges[::-1]):
            at = np.flatnonzero((np.take(owner, inner) >= 0) & np.take(locked, outer))
            pairs.append(np.take(owner, inner[at]).astype(np.int64) * len(locked) + outer[at])
            yield PAUSE
        keys.append(np.concatenate(pairs))
    itself = onto.astype(np.int64) * len(locked) + collapses.kept[onto]
    new = keys[0][~np.isin(keys[0], np.append(keys[1], itself))]
    refused[new // len(locked)] = True
    left = np.flatnonzero(~collapses.vanishing & locked[collapses.kept[collapses.owner]])
    at_border = np.take(locked, np.take(faces, collapses.faces[left], axis=1)).sum(axis=0)
    at_dropped = (np.take(faces, collapses.faces[left], axis=1) == collapses.dropped[collapses.owner[left]]).any(axis=0)
    refused[collapses.owner[left][at_dropped & (at_border == 2)]] = True
    return refused


def with_normals_steps(collapses: Collapses, positions: Floats, faces: Ints) -> Steps[Collapses]:
    """Return the collapses with the normals of the faces that stay."""
    corners = np.take(faces, collapses.faces[~collapses.vanishing], axis=1)
    normals = []
    for places in (positions, collapses.moved(positions)):
        a, b, c = (np.take(places, corner, axis=1) for corner in corners)
        normals.append(cross(b - a, c - a))
        yield PAUSE
    return replace(collapses, normals=(normals[0], normals[1]))


def flips_normal(collapses: Collapses, least_turn: float) -> Flags:
    """Return which collapses, with normals, turn a face too far or leave it without area, (n,) bool."""
    assert collapses.normals is not None
    bad = turns_too_far(*collapses.normals, least_turn)
    refused = np.zeros(len(collapses.edges), bool)
    refused[collapses.owner[~collapses.vanishing][bad]] = True
    return refused


def turns_too_far(before: Floats, after: Floats, least_turn: float) -> Flags:
    """Return which normals, (3, n), turn by more than the angle with this cosine or have no length after."""
    along, size, turn = dot(before, after), dot(after, after), np.float32(least_turn)
    return (along < 0) | (along * along < turn * turn * dot(before, before) * size) | (size == 0)


def makes_thin(collapses: Collapses, positions: Floats, faces: Ints, thinnest: float) -> Flags:
    """Return which collapses, with normals, make a face thinner than `thinnest` and than it was, (n,) bool.

    In a plane no error tells such faces from others, and three vertices of a grid's line have no area.
    """
    assert collapses.normals is not None
    left = ~collapses.vanishing
    corners = np.take(faces, collapses.faces[left], axis=1)
    before, after = collapses.normals
    share = _height_share(np.take(collapses.moved(positions), corners, axis=1), after)
    thin = np.flatnonzero(share < np.float32(thinnest))
    thin = thin[share[thin] <= _height_share(np.take(positions, corners[:, thin], axis=1), before[:, thin])]
    refused = np.zeros(len(collapses.edges), bool)
    refused[collapses.owner[left][thin]] = True
    return refused


def _height_share(corners: Floats, normals: Floats) -> Floats:
    """Return the heights of triangles (3, 3, n) over their longest sides, (n,), from normals of twice their areas."""
    a, b, c = corners.transpose(1, 0, 2)
    longest = np.maximum(np.maximum(dot(b - a, b - a), dot(c - b, c - b)), dot(a - c, a - c))
    return np.asarray(np.sqrt(dot(normals, normals)) / longest)


def shuffled(numbers: Indices) -> NDArray[np.uint32]:
    """Return a different number below 2^32 for each number, in no visible order."""
    mixed = numbers.astype(np.uint32)
    for factor in (0x85EBCA6B, 0xC2B2AE35):  # the odd factors of MurmurHash3's last mixing
        mixed ^= mixed >> np.uint32(15)
        mixed *= np.uint32(factor)
    mixed ^= mixed >> np.uint32(16)
    return mixed
