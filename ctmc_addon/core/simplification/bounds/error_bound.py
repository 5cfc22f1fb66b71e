# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep a simplified surface within a distance of the original, both ways, while edges collapse.

Samples stand for the original: its vertices, and points spread over its edges and faces. Each has an assigned face of
the surface as it is now, no farther away than the bound. A collapse changes the faces round one edge; samples assigned
to these go to one of the faces that remain, and if all are too far for one of them the collapse is refused. So it is
if its new vertex, or a point spread over the incident edges and faces, is too far from the original.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np

from ...arrays import Flags, Floats, Indices, Ints
from ...mesh.distance.triangle_tree import squared_distances
from ...mesh.vectors import dot
from ...progress import PAUSE, Steps
from ..engine.collapses import Collapses
from ..policy import Policy
from .error_check import ErrorCheck

PAIRS = 1 << 13  # Measure so many distances together: they fit the cache.


class ErrorBound:
    """Samples of the original, and the face that each is assigned to.

    Parameters
    ----------
    limit : float
        In the unit of the positions.
    policy : Policy
    """

    def __init__(self, limit: float, policy: Policy) -> None:
        self.check, self.policy = ErrorCheck(limit, policy), policy
        self.limit = policy.safety_factor * limit
        self.limit_squared = np.float32(self.limit * self.limit)
        self.moving = self.new_assigned_face = np.empty(0, np.int64)  # what a round would change

    def prepare_steps(
        self, positions: Floats, faces: Ints, edges: Ints, face_edges: Ints, interface: Ints
    ) -> Steps[None]:
        """Take in the original, (3, P), (3, F), (2, E), (3, F), (F,), which is also the surface at first."""
        vertex_count, face_count = positions.shape[1], faces.shape[1]
        ends = [np.take(positions, end, axis=1) for end in edges]
        yield PAUSE
        along = ends[1] - ends[0]
        length = np.sqrt(dot(along, along))
        self.gap = max(2.0 * float(np.median(length)), self.check.limit)
        yield PAUSE
        long = np.flatnonzero(length > 2.0 * self.check.limit)  # between the ends of others little can go wrong
        on_edges, edge_of = _spread([np.take(end, long, axis=1) for end in ends], self.gap, self.policy.sample_parts)
        edge_of = long[edge_of]
        yield PAUSE
        corners = [np.take(positions, corner, axis=1) for corner in faces]
        in_faces, face_of = _spread(corners, self.gap, self.policy.sample_parts)
        yield PAUSE
        face_at = np.tile(np.arange(face_count), 3)
        face_at_vertex, face_at_edge = np.full(vertex_count, -1, np.int64), np.empty(edges.shape[1], np.int64)
        face_at_vertex[faces.ravel()] = face_at
        face_at_edge[face_edges.ravel()] = face_at
        # Where interfaces meet, each of them has a sample of its own.
        meeting, face_at_meeting = _meeting(faces, interface, face_at_vertex)
        yield PAUSE
        places = [positions, np.take(positions, meeting, axis=1), on_edges, in_faces]
        self.samples = np.concatenate(places, axis=1)
        self.assigned_face = np.concatenate([face_at_vertex, face_at_meeting, face_at_edge[edge_of], face_of])
        self.interface = np.take(interface, self.assigned_face)
        yield PAUSE
        yield from self.check.prepare_steps(positions.copy(), faces)
        number = np.empty(face_count, np.int64)
        number[self.check.to_original.tree.order] = np.arange(face_count)
        self.triangle_of = number[face_of]  # of the samples inside faces
        self.original_interface = interface[self.check.to_original.tree.order]

    def exceeded_steps(self, collapses: Collapses, faces: Ints, interface: Ints, moved: Floats) -> Steps[Flags]:
        """Return which of the n collapses take the surface too far from the original, (n,) bool.

        Parameters
        ----------
        collapses : Collapses
        faces, interface : (3, F) and (F,) int32
            The surface as it is, and the interface that each face is in: samples stay in theirs.
        moved : (3, V) float32
            Positions as they would be.
        """
        count = len(collapses.edges)
        collapse_at = np.full(faces.shape[1], -1, np.int32)
        collapse_at[collapses.faces] = collapses.owner
        moving = np.flatnonzero((np.take(collapse_at, self.assigned_face) >= 0) & (self.assigned_face >= 0))
        collapse = collapse_at[self.assigned_face[moving]]
        yield PAUSE

        left = np.flatnonzero(~collapses.vanishing)
        left = left[np.lexsort((interface[collapses.faces[left]], collapses.owner[left]))]
        owner, star = collapses.owner[left].astype(np.int64), collapses.faces[left]
        corners = np.take(faces, star, axis=1)
        middles = _middles(moved, corners)
        # The faces of one collapse in one interface follow one another.
        interfaces = int(self.original_interface.max(initial=0)) + 1
        keys, first, faces_of = np.unique(owner * interfaces + interface[star], return_index=True, return_counts=True)
        run_keys = collapse.astype(np.int64) * interfaces + self.interface[moving]
        run = np.minimum(np.searchsorted(keys, run_keys), max(0, len(keys) - 1))
        exceeded = np.zeros(count, bool)
        exceeded[collapse[keys[run] != run_keys] if len(keys) else collapse] = True
        column = np.full(faces.shape[1], -1)
        column[star] = np.arange(len(star))
        near = column[self.assigned_face[moving]]  # mostly the face assigned so far will do, if it remains
        for step in (self.policy.sample_first, 1):
            yield PAUSE
            rest = np.arange(0, len(moving), step)
            rest = rest[~exceeded[collapse[rest]]]
            points = np.take(self.samples, moving[rest], axis=1)
            stays = np.flatnonzero(near[rest] >= 0)
            face = np.take(corners, near[rest[stays]], axis=1)
            squared = squared_distances(points[:, stays], *(np.take(moved, corner, axis=1) for corner in face))
            moves = np.ones(len(rest), bool)
            moves[stays[squared <= self.limit_squared]] = False
            rest, points = rest[moves], points[:, moves]
            own, its_run = collapse[rest], run[rest]
            yield PAUSE
            near[rest], squared = _near_face(
                points, moved, corners, middles, first[its_run], faces_of[its_run], self.limit_squared
            )
            exceeded[own[squared > self.limit_squared]] = True

        kept = ~exceeded[collapse]
        moving, collapse, near = moving[kept], collapse[kept], near[kept]
        yield PAUSE
        refused = yield from self._far_from_original_steps(
            collapses, owner, corners, interface[star], moved, moving, near, exceeded
        )
        kept = ~refused[collapse]
        self.moving, self.new_assigned_face = moving[kept], star[near[kept]]
        return refused

    def _far_from_original_steps(
        self,
        collapses: Collapses,
        owner: Indices,
        corners: Ints,
        interface: Ints,
        moved: Floats,
        moving: Indices,
        near: Indices,
        refused: Flags,
    ) -> Steps[Flags]:
        """Return which collapses are refused or put a vertex, or a point of an edge or face, too far away."""
        count = len(refused)
        new_vertex = np.zeros(moved.shape[1], bool)
        new_vertex[collapses.kept] = new_vertex[collapses.dropped] = True
        column = np.flatnonzero(~refused[owner])
        corners = np.take(corners, column, axis=1)
        slot, each = np.argmax(np.take(new_vertex, corners), axis=0), np.arange(len(column))
        a, b, c = (np.take(moved, corners[(slot + k) % 3, each], axis=1) for k in range(3))  # a is the one that moves
        on_edges, edge = _spread([a, b], self.gap, self.policy.sample_parts)
        in_faces, face = _spread([a, b, c], self.gap, self.policy.sample_parts)
        once = np.flatnonzero(np.diff(owner[column], prepend=-1))  # of every collapse one face, for its new vertex
        points = np.concatenate([a[:, once], on_edges, in_faces], axis=1)
        yield PAUSE
        face_of = column[np.concatenate([each[once], edge, face])]
        of = owner[face_of]
        yield PAUSE

        # Mostly the original's face of the nearest sample assigned to the same face will do.
        inner = moving - (self.samples.shape[1] - len(self.triangle_of))
        inside = np.flatnonzero(inner >= 0)
        inside = inside[np.argsort(near[inside], kind="stable")]
        first, near_to = _runs(near[inside], len(owner))
        squared = np.full(len(of), np.inf)
        open_ = np.flatnonzero(near_to[face_of])
        samples = np.take(self.samples, moving[inside], axis=1)
        yield PAUSE
        nearest = _nearest_point(points[:, open_], samples, first[face_of[open_]], near_to[face_of[open_]])
        triangle = self.triangle_of[inner[inside][nearest]]
        to_original = self.check.to_original
        squared[open_] = to_original.squared_distances(points[:, open_], triangle)
        yield PAUSE
        for _ in range(self.policy.nearer_steps):
            far = np.flatnonzero(squared[open_] > self.limit_squared)
            open_, triangle = open_[far], to_original.across(points[:, open_[far]], triangle[far])
            other = to_original.squared_distances(points[:, open_], triangle)
            other[self.original_interface[triangle] != interface[face_of[open_]]] = np.inf
            squared[open_] = np.minimum(squared[open_], other)
        yield PAUSE

        # For the others the tree is asked, first for the farthest of each collapse: mostly that decides it.
        refused = refused.copy()
        far = np.flatnonzero(squared > self.limit_squared)
        far = far[np.argsort(squared[far], kind="stable")]
        farthest = np.full(count, -1)
        farthest[of[far]] = far
        ask = farthest[farthest >= 0]
        for _ in range(2):
            answer, _ = yield from to_original.nearest_steps(points[:, ask], np.full(len(ask), self.limit * self.limit))
            refused[of[ask[np.isinf(answer)]]] = True
            ask = far[~refused[of[far]] & (farthest[of[far]] != far)]
            yield PAUSE
        return refused

    def accept(self, face_left: Indices) -> None:
        """Assign samples again for the collapses that `exceeded_steps` let pass; faces `face_left`, (f,), remain."""
        self.assigned_face[self.moving] = self.new_assigned_face
        number = np.zeros(max(int(self.assigned_face.max()), int(face_left.max())) + 1, np.int64)
        number[face_left] = np.arange(len(face_left))
        self.assigned_face = np.where(self.assigned_face < 0, -1, number[self.assigned_face])


def _meeting(faces: Ints, interface: Ints, face_at_vertex: Indices) -> tuple[Indices, Indices]:
    """Vertices (n,) on several interfaces, and a face (n,) in each further one."""
    at = [np.flatnonzero(interface != np.take(interface, np.take(face_at_vertex, corner))) for corner in faces]
    face = np.concatenate(at)
    vertex = np.concatenate([corner[number] for corner, number in zip(faces, at, strict=True)]).astype(np.int64)
    _, first = np.unique(vertex * (int(interface.max(initial=0)) + 1) + interface[face], return_index=True)
    return vertex[first], face[first]


def _spread(corners: list[Floats], gap: float, most_parts: int) -> tuple[Floats, Indices]:
    """Points spread over edges (two corners, (3, m) each) or faces (three), and the edge or face of each.

    The longest side is cut into parts no longer than the gap, an odd number of at most `most_parts`; the points are the
    middles of the pieces that lie like the whole, among them that of the whole edge.
    """
    longest = np.zeros(corners[0].shape[1], np.float32)
    for start, end in itertools.combinations(corners, 2):
        along = end - start
        np.maximum(longest, dot(along, along), out=longest)
    parts = np.ceil(np.sqrt(longest) / np.float32(gap)).clip(1, most_parts)
    parts += 1 - parts % 2
    points, owners = [], []
    for count in range(1, int(parts.max(initial=1)) + 1, 2):
        numbers = np.flatnonzero(parts == count)
        of_these = [np.take(corner, numbers, axis=1) for corner in corners]
        for steps in itertools.product(range(count), repeat=len(corners)):
            if len(numbers) and sum(steps) == count - 1:
                shares = [np.float32((step + 1 / len(corners)) / count) for step in steps]
                points.append(sum(share * corner for share, corner in zip(shares, of_these, strict=True)))
                owners.append(numbers)
    if not points:
        return np.empty((3, 0), np.float32), np.empty(0, np.int64)
    return np.concatenate(points, axis=1), np.concatenate(owners)


def _runs(owner: Indices, count: int) -> tuple[Indices, Indices]:
    """Return the start and length of the run of each of `count` numbers in the sorted `owner`."""
    counts = np.bincount(owner, minlength=count)
    return np.cumsum(counts) - counts, counts


def _middles(positions: Floats, faces: Ints) -> Floats:
    """Middle of every face, (3, f)."""
    a, b, c = (np.take(positions, corner, axis=1) for corner in faces)
    return (a + b + c) / np.float32(3.0)


def _near_face(
    points: Floats, positions: Floats, faces: Ints, middles: Floats, start: Indices, count: Indices, limit_squared: Any
) -> tuple[Indices, Floats]:
    """Return for every point (3, n) a face from start to start + count within the limit, or the nearest.

    Mostly the one with the nearest middle will do.
    """
    near = _nearest_point(points, middles, start, count)
    squared = squared_distances(points, *(np.take(positions, np.take(corner, near), axis=1) for corner in faces))
    far = np.flatnonzero(squared > limit_squared)
    if len(far):
        near[far], squared[far] = _nearest_face(points[:, far], positions, faces, start[far], count[far])
    return near, squared


def _nearest_face(
    points: Floats, positions: Floats, faces: Ints, start: Indices, count: Indices
) -> tuple[Indices, Floats]:
    """Return for every point (3, n) the nearest face from start to start + count, and its squared distance."""
    nearest = np.empty(len(start), np.int64)
    least = np.empty(len(start), np.float32)
    for block, counts, face in _pairs(start, count):
        corners = (np.take(positions, np.take(corner, face), axis=1) for corner in faces)
        squared = squared_distances(np.repeat(points[:, block], counts, axis=1), *corners)
        hit, least[block] = _least(squared, counts)
        nearest[block] = face[hit]
    return nearest, least


def _nearest_point(points: Floats, candidates: Floats, start: Indices, count: Indices) -> Indices:
    """Return for every point (3, n) the nearest of candidates[:, start:start + count]."""
    nearest = np.empty(len(start), np.int64)
    for block, counts, other in _pairs(start, count):
        away: Floats = np.repeat(points[:, block], counts, axis=1) - np.take(candidates, other, axis=1)
        nearest[block] = other[_least(dot(away, away), counts)[0]]
    return nearest


def _pairs(start: Indices, count: Indices) -> Iterator[tuple[slice, Indices, Indices]]:
    """Yield some of the n at a time: their indices, counts, and all numbers from start to start + count.

    Their pairs are no more than `PAIRS`, unless one alone has more.
    """
    ends = np.cumsum(count)
    low = 0
    while low < len(start):
        most = PAIRS + (int(ends[low - 1]) if low else 0)
        high = max(low + 1, int(np.searchsorted(ends, most, side="right")))
        counts = count[low:high]
        before = np.cumsum(counts) - counts
        yield slice(low, high), counts, np.arange(counts.sum()) + np.repeat(start[low:high] - before, counts)
        low = high


def _least(values: Floats, count: Indices) -> tuple[Indices, Floats]:
    """Return for each run of `count` values the position of the least, the first of equals, and its value."""
    least = np.minimum.reduceat(values, np.cumsum(count) - count)
    hits = np.flatnonzero(values == np.repeat(least, count))
    group = np.repeat(np.arange(len(count)), count)[hits]
    return hits[np.diff(group, prepend=-1) > 0], least
