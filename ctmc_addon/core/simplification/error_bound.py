"""Hold a simplified surface within a distance of the original, both ways, while edges collapse.

The original is held by samples: its vertices, and points spread over its edges and faces. Each has a
home, a face of the surface as it is now that is no farther than the bound. A collapse changes the faces
round one edge; samples at home there move to one of the faces that remain, and if all are too far for
one of them the collapse is refused. So it is if its new vertex, or a point spread over the new edges
and faces, is too far from the original.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..mesh.triangle_tree import squared_distances
from ..mesh.vectors import dot
from ..progress import Pauses
from .error_check import STEPS, ErrorCheck

if TYPE_CHECKING:
    from .edge_collapse import Collapses

Ints = NDArray[np.int32]
Places = NDArray[np.int64]
Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]

BLOCK = 1024  # points whose distances are measured together: their pairs fit the cache
MOST_PARTS = 15  # that a side is cut into for samples
SAMPLE = 8  # of so many samples one is looked at first: most refusals need no more


class ErrorBound:
    """Samples of the original, and the face where each is at home.

    Parameters
    ----------
    limit : float
        In the unit of the positions.
    held : float
        Share of the limit that samples are held to: between them a surface swings out a little farther.
    """

    def __init__(self, limit: float, held: float) -> None:
        self.check = ErrorCheck(limit)
        self.limit = held * limit
        self.limit_squared = np.float32(self.limit * self.limit)
        self.moving = self.new_home = np.empty(0, np.int64)  # what a round would change

    def prepare(self, positions: Floats, faces: Ints, edges: Ints, face_edges: Ints) -> Pauses[None]:
        """Take in the original, (3, P), (3, F), (2, E), (3, F), which is also the surface at first."""
        vertex_count, face_count = positions.shape[1], faces.shape[1]
        ends = [np.take(positions, end, axis=1) for end in edges]
        yield
        along = ends[1] - ends[0]
        length = np.sqrt(dot(along, along))
        self.gap = max(2.0 * float(np.median(length)), self.check.limit)
        yield
        long = np.flatnonzero(length > 2.0 * self.check.limit)  # between the ends of others little can go wrong
        on_edges, edge_of = _spread([np.take(end, long, axis=1) for end in ends], self.gap)
        edge_of = long[edge_of]
        yield
        corners = [np.take(positions, corner, axis=1) for corner in faces]
        in_faces, face_of = _spread(corners, self.gap)
        yield
        self.samples = np.concatenate([positions, on_edges, in_faces], axis=1)

        face_at = np.tile(np.arange(face_count), 3)
        face_at_vertex, face_at_edge = np.full(vertex_count, -1, np.int64), np.empty(edges.shape[1], np.int64)
        face_at_vertex[faces.ravel()] = face_at
        face_at_edge[face_edges.ravel()] = face_at
        self.home = np.concatenate([face_at_vertex, face_at_edge[edge_of], face_of])
        yield
        yield from self.check.prepare(positions.copy(), faces)
        number = np.empty(face_count, np.int64)
        number[self.check.to_original.tree.order] = np.arange(face_count)
        self.triangle_of = number[face_of]  # of the samples inside faces

    def exceeded(self, collapses: Collapses, faces: Ints, moved: Floats) -> Pauses[Flags]:
        """Which of the n collapses take the surface too far from the original, (n,) bool.

        Parameters
        ----------
        collapses : Collapses
        faces : (3, F) int32
            The surface as it is.
        moved : (3, V) float32
            Positions as they would be.
        """
        count = len(collapses.edges)
        collapse_at = np.full(faces.shape[1], -1, np.int32)
        collapse_at[collapses.faces] = collapses.owner
        moving = np.flatnonzero((np.take(collapse_at, self.home) >= 0) & (self.home >= 0))
        collapse = collapse_at[self.home[moving]]
        yield

        left = np.flatnonzero(~collapses.gone)
        left = left[np.argsort(collapses.owner[left], kind="stable")]
        owner, star = collapses.owner[left].astype(np.int64), collapses.faces[left]
        corners = np.take(faces, star, axis=1)
        middles = _middles(moved, corners)
        first, faces_of = _runs(owner, count)
        exceeded = np.zeros(count, bool)
        column = np.full(faces.shape[1], -1)
        column[star] = np.arange(len(star))
        near = column[self.home[moving]]  # mostly the face where a sample is at home will do, if it remains
        for step in (SAMPLE, 1):
            yield
            rest = np.arange(0, len(moving), step)
            rest = rest[~exceeded[collapse[rest]]]
            places = np.take(self.samples, moving[rest], axis=1)
            stays = np.flatnonzero(near[rest] >= 0)
            home = np.take(corners, near[rest[stays]], axis=1)
            squared = squared_distances(places[:, stays], *(np.take(moved, corner, axis=1) for corner in home))
            moves = np.ones(len(rest), bool)
            moves[stays[squared <= self.limit_squared]] = False
            rest, places = rest[moves], places[:, moves]
            own = collapse[rest]
            yield
            near[rest], squared = _near_face(
                places, moved, corners, middles, first[own], faces_of[own], self.limit_squared
            )
            exceeded[own[squared > self.limit_squared]] = True

        chosen = ~exceeded[collapse]
        moving, collapse, near = moving[chosen], collapse[chosen], near[chosen]
        yield
        refused = yield from self._away_from_original(collapses, owner, corners, moved, moving, near, exceeded)
        chosen = ~refused[collapse]
        self.moving, self.new_home = moving[chosen], star[near[chosen]]
        return refused

    def _away_from_original(
        self,
        collapses: Collapses,
        owner: Places,
        corners: Ints,
        moved: Floats,
        moving: Places,
        near: Places,
        refused: Flags,
    ) -> Pauses[Flags]:
        """Which collapses are refused or put a vertex, or a point of a spoke or face, too far from the original."""
        count = len(refused)
        hub = np.zeros(moved.shape[1], bool)
        hub[collapses.kept] = hub[collapses.dropped] = True
        column = np.flatnonzero(~refused[owner])
        corners = np.take(corners, column, axis=1)
        slot, each = np.argmax(np.take(hub, corners), axis=0), np.arange(len(column))
        a, b, c = (np.take(moved, corners[(slot + k) % 3, each], axis=1) for k in range(3))  # a is the one that moves
        on_spokes, spoke = _spread([a, b], self.gap)
        in_faces, face = _spread([a, b, c], self.gap)
        once = np.flatnonzero(np.diff(owner[column], prepend=-1))  # of every collapse one face, for its new vertex
        places = np.concatenate([a[:, once], on_spokes, in_faces], axis=1)
        yield
        face_of = column[np.concatenate([each[once], spoke, face])]
        of = owner[face_of]
        yield

        # Mostly the original's face of the nearest sample at home in the same face will do.
        inner = moving - (self.samples.shape[1] - len(self.triangle_of))
        inside = np.flatnonzero(inner >= 0)
        inside = inside[np.argsort(near[inside], kind="stable")]
        first, near_to = _runs(near[inside], len(owner))
        squared = np.full(len(of), np.inf)
        some = np.flatnonzero(near_to[face_of])
        samples = np.take(self.samples, moving[inside], axis=1)
        yield
        nearest = _nearest_point(places[:, some], samples, first[face_of[some]], near_to[face_of[some]])
        triangle = self.triangle_of[inner[inside][nearest]]
        to_original = self.check.to_original
        squared[some] = squared_distances(places[:, some], *to_original.triangles(triangle))
        yield
        for _ in range(STEPS):
            far = np.flatnonzero(squared[some] > self.limit_squared)
            some, triangle = some[far], to_original.across(places[:, some[far]], triangle[far])
            found = squared_distances(places[:, some], *to_original.triangles(triangle))
            squared[some] = np.minimum(squared[some], found)
        yield

        # For the others the tree is asked, first for the farthest of each collapse: mostly that decides it.
        refused = refused.copy()
        far = np.flatnonzero(squared > self.limit_squared)
        far = far[np.argsort(squared[far], kind="stable")]
        farthest = np.full(count, -1)
        farthest[of[far]] = far
        ask = farthest[farthest >= 0]
        for _ in range(2):
            asked, _ = yield from to_original.nearest(places[:, ask], np.full(len(ask), self.limit * self.limit))
            refused[of[ask[np.isinf(asked)]]] = True
            ask = far[~refused[of[far]] & (farthest[of[far]] != far)]
            yield
        return refused

    def accept(self, face_left: Places) -> None:
        """Take over the homes for the collapses that `exceeded` let pass; (f,) are the faces that are left."""
        self.home[self.moving] = self.new_home
        number = np.zeros(max(int(self.home.max()), int(face_left.max())) + 1, np.int64)
        number[face_left] = np.arange(len(face_left))
        self.home = np.where(self.home < 0, -1, number[self.home])


def _spread(corners: list[Floats], gap: float) -> tuple[Floats, Places]:
    """Points spread over edges (two corners, (3, m) each) or faces (three), and the edge or face of each.

    The longest side is cut into parts no longer than the gap, an odd number of them; the points are the
    middles of the pieces that lie like the whole, among them that of the whole edge.
    """
    longest = np.zeros(corners[0].shape[1], np.float32)
    for start, end in itertools.combinations(corners, 2):
        along = end - start
        np.maximum(longest, dot(along, along), out=longest)
    parts = np.ceil(np.sqrt(longest) / np.float32(gap)).clip(1, MOST_PARTS)
    parts += 1 - parts % 2
    places, owners = [], []
    for count in range(1, int(parts.max(initial=1)) + 1, 2):
        chosen = np.flatnonzero(parts == count)
        some = [np.take(corner, chosen, axis=1) for corner in corners]
        for steps in itertools.product(range(count), repeat=len(corners)):
            if len(chosen) and sum(steps) == count - 1:
                shares = [np.float32((step + 1 / len(corners)) / count) for step in steps]
                places.append(sum(share * corner for share, corner in zip(shares, some, strict=True)))
                owners.append(chosen)
    if not places:
        return np.empty((3, 0), np.float32), np.empty(0, np.int64)
    return np.concatenate(places, axis=1), np.concatenate(owners)


def _runs(owner: Places, count: int) -> tuple[Places, Places]:
    """Where each of `count` numbers begins in the sorted `owner`, and how often it is there."""
    counts = np.bincount(owner, minlength=count)
    return np.cumsum(counts) - counts, counts


def _middles(positions: Floats, faces: Ints) -> Floats:
    """Middle of every face, (3, f)."""
    a, b, c = (np.take(positions, corner, axis=1) for corner in faces)
    return (a + b + c) / np.float32(3.0)


def _near_face(
    points: Floats, positions: Floats, faces: Ints, middles: Floats, start: Places, count: Places, limit_squared: Any
) -> tuple[Places, Floats]:
    """For every point (3, n) one of the faces start to start + count within the limit, or the nearest of them.

    Mostly the one with the nearest middle will do.
    """
    near = _nearest_point(points, middles, start, count)
    squared = squared_distances(points, *(np.take(positions, np.take(corner, near), axis=1) for corner in faces))
    far = np.flatnonzero(squared > limit_squared)
    if len(far):
        near[far], squared[far] = _nearest_face(points[:, far], positions, faces, start[far], count[far])
    return near, squared


def _nearest_face(
    points: Floats, positions: Floats, faces: Ints, start: Places, count: Places
) -> tuple[Places, Floats]:
    """For every point (3, n) the nearest of the faces start to start + count, and its squared distance."""
    nearest = np.empty(len(start), np.int64)
    least = np.empty(len(start), np.float32)
    for block, some, face in _pairs(start, count):
        corners = (np.take(positions, np.take(corner, face), axis=1) for corner in faces)
        squared = squared_distances(np.repeat(points[:, block], some, axis=1), *corners)
        hit, least[block] = _least(squared, some)
        nearest[block] = face[hit]
    return nearest, least


def _nearest_point(points: Floats, others: Floats, start: Places, count: Places) -> Places:
    """For every point (3, n) the nearest of others[:, start:start + count]."""
    nearest = np.empty(len(start), np.int64)
    for block, some, other in _pairs(start, count):
        away: Floats = np.repeat(points[:, block], some, axis=1) - np.take(others, other, axis=1)
        nearest[block] = other[_least(dot(away, away), some)[0]]
    return nearest


def _pairs(start: Places, count: Places) -> Iterator[tuple[slice, Places, Places]]:
    """Some of the n at a time: which, the counts of those, and all their numbers from start to start + count."""
    for low in range(0, len(start), BLOCK):
        block = slice(low, low + BLOCK)
        some = count[block]
        before = np.cumsum(some) - some
        yield block, some, np.arange(some.sum()) + np.repeat(start[block] - before, some)


def _least(values: Floats, count: Places) -> tuple[Places, Floats]:
    """Of every `count` values in turn: where the least is, the first of equals, and what it is."""
    least = np.minimum.reduceat(values, np.cumsum(count) - count)
    hits = np.flatnonzero(values == np.repeat(least, count))
    group = np.repeat(np.arange(len(count)), count)[hits]
    return hits[np.diff(group, prepend=-1) > 0], least
