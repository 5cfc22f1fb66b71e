# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut small handles: loops of three edges that are not a face, where collapses get no further.

Edge collapse keeps every handle, however small, and noise has thousands. The last loop round a handle, or through it,
has three edges, none of which may collapse (link condition). There the surface is cut: the loop becomes two, and each
is capped with a triangle. The surface stays closed, manifold and oriented, its Euler number grows by two, and with as
many vertices as before it has four triangles fewer. A loop that would separate a component is a neck, not a handle,
and stays. Each of the two loops is then pulled a little toward its own side, because a file that stores triangles by
position, such as STL, would join two loops at the same place again.

A cut moves the surface by no more than the loop is long, on an area of its square: its cost is the cube of the longest
edge, shared by the four triangles it saves, in the unit in which collapses and removals of components are compared. So
a hole stays open until its narrowest loop is as small as the errors made elsewhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...arithmetic import cube_root
from ...arrays import Flags, Floats, Indices, Ints
from ...mesh.topology import Groups, component_roots_steps
from ...mesh.vectors import cross, dot
from ...progress import PAUSE, Steps
from ..policy import POLICY, Policy

SAVED = 4  # Every cut saves this many triangles.


@dataclass(frozen=True, eq=False)
class Cuts:
    """Loops to cut, no two of which share a vertex, and the corners that go to the copies of their vertices.

    Copy `3 * n + i` is of vertex i of loop n.

    loops : (n, 3) int32
    slots, faces : (c,) int64
        Corners on the left of the loops.
    copy : (c,) int64
        The copy that each corner goes to.
    first : (c,) bool
        Whether the edge from this corner on is the loop's: the copy of vertex i to that of vertex i + 1.
    """

    loops: Ints
    slots: Indices
    faces: Indices
    copy: Indices
    first: Flags

    def select(self, selected: Flags) -> Cuts:
        """Return the selected loops, (n,) bool, renumbered."""
        loop, vertex = np.divmod(self.copy, 3)
        number = np.cumsum(selected) - 1
        corners = selected[loop]
        return Cuts(
            self.loops[selected],
            self.slots[corners],
            self.faces[corners],
            3 * number[loop[corners]] + vertex[corners],
            self.first[corners],
        )

    def apply(self, faces: Ints, face_edges: Ints, edges: Ints, vertex_count: int) -> tuple[Ints, Ints, Ints]:
        """Cut faces (3, F) with their edges (3, F) and ends of edges (2, E); returns them with two caps for each loop.

        Copies are numbered from `vertex_count` on, copies of edges from E on. The arrays given are written to.
        """
        count, edge_count = len(self.loops), edges.shape[1]
        on_loop = self.slots[self.first], self.faces[self.first]
        off_loop = self.slots[~self.first], self.faces[~self.first]
        right = np.empty(3 * count, np.int32)  # edges of the loops, from vertex i to i + 1; copies are for the left
        right[self.copy[self.first]] = face_edges[on_loop]
        left = np.arange(edge_count, edge_count + 3 * count, dtype=np.int32)
        sides, copy = face_edges[off_loop], self.copy[~self.first]
        original = self.loops.ravel()[copy]
        for row in edges:
            here = row[sides] == original
            row[sides[here]] = vertex_count + copy[here]
        face_edges[on_loop] = left[self.copy[self.first]]
        faces[self.slots, self.faces] = vertex_count + self.copy
        copies = np.arange(vertex_count, vertex_count + 3 * count, dtype=np.int32).reshape(-1, 3)
        ends = np.stack([copies.ravel(), copies[:, [1, 2, 0]].ravel()])
        return (
            np.concatenate([faces, self.loops.T, copies[:, [0, 2, 1]].T], axis=1),
            np.concatenate([face_edges, right.reshape(-1, 3).T, left.reshape(-1, 3)[:, [2, 1, 0]].T], axis=1),
            np.concatenate([edges, ends], axis=1),
        )


def longest_loop_edge(face_cost: float) -> float:
    """Length up to which the edges of a loop may be cut when collapses cost so much for every triangle."""
    return float(cube_root(SAVED * face_cost))


def least_face_cost(positions: Floats, edges: Ints, policy: Policy = POLICY) -> float:
    """Cost of collapses for every triangle from which on it is worth looking for handles: few have shorter loops."""
    first, second = edges[:, :: policy.sampled_edges]
    along = np.take(positions, first, axis=1) - np.take(positions, second, axis=1)
    squared = dot(along, along)
    if not len(squared):
        return math.inf
    middle = len(squared) // 2
    longest = policy.least_loop * float(np.sqrt(np.partition(squared, middle)[middle]))
    return longest * longest * longest / SAVED


def handle_cuts_steps(
    positions: Floats,
    faces: Ints,
    edges: Ints,
    locked: Flags,
    longest: float,
    parting: Flags | None = None,
    policy: Policy = POLICY,
) -> Steps[Cuts | None]:
    """Cuts of handles at loops whose edges are no longer than `longest`; None if there are none.

    Parameters
    ----------
    positions : (3, V) float32
    faces : (3, F) int32
    edges : (2, E) int32
        Every edge once; those that are gone have two equal ends, like the faces.
    locked : (V,) bool
        Vertices that no loop may have.
    parting : (V,) bool, optional
        Vertices that connect no faces: where walls of a complex meet, what is cut must stay connected within its wall.
    policy : Policy, optional
    """
    loops, length = yield from _loops_steps(positions, faces, edges, locked, longest)
    if not len(loops):
        return None
    loops = _independent(loops, length, len(locked))
    yield PAUSE
    cuts, right = yield from _sides_steps(loops, faces, len(locked), policy.most_loop_faces)
    if not len(cuts.loops):
        return None
    handle = yield from _handles_steps(cuts, right, faces, len(locked), parting)
    return cuts.select(handle) if handle.any() else None


def pull_apart_steps(positions: Floats, faces: Ints, edges: Ints, loops: Ints, policy: Policy = POLICY) -> Steps[None]:
    """Move loops (n, 3) that were cut and their copies, the last `3 * n` vertices, each toward its own side.

    A vertex moves toward the mean of its neighbors that are not in its loop, by a share of the loop's longest edge at
    most. Where a triangle would turn over, its vertices move less. The positions given, (3, V), are written to.
    """
    vertex_count, count = positions.shape[1], len(loops)
    vertices = np.append(loops, np.arange(vertex_count - 3 * count, vertex_count))
    loop = np.full(vertex_count, -1)
    loop[vertices] = np.tile(np.repeat(np.arange(count), 3), 2)
    first, second = edges
    leaving = np.take(loop, first) != np.take(loop, second)
    first, second = first[leaving], second[leaving]
    inner, outer = np.concatenate([first, second]), np.concatenate([second, first])
    neighbors = np.bincount(inner, minlength=vertex_count)[vertices]
    yield PAUSE
    way = np.empty((3, len(vertices)), np.float32)
    for row, along in zip(way, positions, strict=True):
        row[:] = np.bincount(inner, along[outer] - along[inner], vertex_count)[vertices] / np.maximum(neighbors, 1)
    corners = positions[:, loops]  # (3, n, 3)
    sides = corners - corners[:, :, [1, 2, 0]]
    longest = np.sqrt(dot(sides, sides)).max(axis=1)[loop[vertices]]
    length = np.sqrt(dot(way, way))
    way *= longest / np.maximum(np.maximum(length, longest), np.finfo(np.float32).tiny)
    yield PAUSE
    around = faces[:, (np.take(loop, faces) >= 0).any(axis=0)]
    before = _normals(positions, around)
    start = positions[:, vertices]
    share = np.full(vertex_count, policy.pull, np.float32)
    for _ in range(policy.pull_halvings):
        positions[:, vertices] = start + share[vertices] * way
        after = _normals(positions, around)
        turned = (dot(before, after) <= 0) & (dot(before, before) > 0)
        if not turned.any():
            return
        halved = np.zeros(vertex_count, bool)
        halved[around[:, turned]] = True
        share[halved] /= 2
        yield PAUSE


def _normals(positions: Floats, faces: Ints) -> Floats:
    """Normals of faces (3, f), (3, f), as long as twice their areas."""
    a, b, c = (np.take(positions, corner, axis=1) for corner in faces)
    return cross(b - a, c - a)


def _loops_steps(
    positions: Floats, faces: Ints, edges: Ints, locked: Flags, longest: float
) -> Steps[tuple[Ints, Floats]]:
    """Loops of three edges that are not faces, (n, 3), and their longest edges, (n,)."""
    count = len(locked)
    first, second = edges
    along = np.take(positions, first, axis=1) - np.take(positions, second, axis=1)
    length = np.sqrt(dot(along, along))
    yield PAUSE
    short = np.flatnonzero((length <= longest) & (first != second) & ~np.take(locked, first) & ~np.take(locked, second))
    low, high = np.minimum(first[short], second[short]), np.maximum(first[short], second[short])
    keys = low.astype(np.int64) * count + high
    order = np.argsort(keys, kind="stable")
    keys, low, high, length = keys[order], low[order], high[order], length[short[order]]
    yield PAUSE
    # Every pair of edges with the same lowest end, and the third edge between their other ends.
    number = np.arange(len(keys))
    pairs = np.searchsorted(low, low, side="right") - 1 - number
    side_a = np.repeat(number, pairs)
    side_b = side_a + 1 + np.arange(len(side_a)) - np.repeat(np.cumsum(pairs) - pairs, pairs)
    third, present = _find(keys, high[side_a].astype(np.int64) * count + high[side_b])
    side_a, side_b, third = side_a[present], side_b[present], third[present]
    at_triangle = np.zeros(count, bool)
    at_triangle[low[side_a]] = at_triangle[high[side_a]] = at_triangle[high[side_b]] = True
    yield PAUSE
    a, b, c = (np.take(at_triangle, corner) for corner in faces)
    corners = np.sort(faces[:, a & b & c], axis=0).astype(np.int64)
    yield PAUSE
    edge, present = _find(keys, corners[0] * count + corners[1])
    triangles = side_a * count + high[side_b]
    spans = [edge[present] * count + corners[2, present]]
    yield PAUSE
    # Round a vertex with three faces: that vertex can collapse.
    lonely = np.bincount(edges.ravel(), minlength=count) == 3
    inner, outer = np.concatenate([first, second]), np.concatenate([second, first])
    at = np.flatnonzero(np.take(lonely, inner))
    ring = np.sort(outer[at[np.argsort(inner[at], kind="stable")]].reshape(-1, 3), axis=1).astype(np.int64)
    edge, present = _find(keys, ring[:, 0] * count + ring[:, 1])
    spans.append(edge[present] * count + ring[present, 2])
    loop = ~np.isin(triangles, np.concatenate(spans))
    side_a, side_b, third = side_a[loop], side_b[loop], third[loop]
    loops = np.stack([low[side_a], high[side_a], high[side_b]], axis=1)
    return loops, np.maximum(np.maximum(length[side_a], length[side_b]), length[third])


def _find(keys: Indices, sought: Indices) -> tuple[Indices, Flags]:
    """Return the position of each of `sought` in the sorted `keys`, and whether it is in them."""
    if not len(keys):
        return np.zeros(len(sought), np.int64), np.zeros(len(sought), bool)
    at = np.minimum(np.searchsorted(keys, sought), len(keys) - 1)
    return at, keys[at] == sought


def _independent(loops: Ints, length: Floats, vertex_count: int) -> Ints:
    """Loops that share no vertex, the shortest first."""
    loops = loops[np.argsort(length, kind="stable")]
    free = np.ones(vertex_count, bool)
    independent = []
    while len(loops):
        rank = np.arange(len(loops))
        best = np.full(vertex_count, len(loops))
        np.minimum.at(best, loops.ravel(), np.repeat(rank, 3))
        won = (best[loops] == rank[:, None]).all(axis=1)
        independent.append(loops[won])
        free[loops[won]] = False
        loops = loops[free[loops].all(axis=1)]
    return np.concatenate(independent)


def _sides_steps(loops: Ints, faces: Ints, vertex_count: int, most_faces: int) -> Steps[tuple[Cuts, Indices]]:
    """The corners on the left of every loop, and for each of the loops a face on its right.

    Round a vertex, the corner whose face runs to the neighbor n is followed by the one that runs to the neighbor from
    which this one comes. From the loop's next vertex on, those up to its previous one are on the left.
    """
    at_loop = np.zeros(vertex_count, bool)
    at_loop[loops] = True
    slots, corner_faces = np.nonzero(np.take(at_loop, faces))
    vertex = faces[slots, corner_faces].astype(np.int64)
    keys = vertex * vertex_count + faces[(slots + 1) % 3, corner_faces]
    order = np.argsort(keys, kind="stable")
    slots, corner_faces, vertex, keys = slots[order], corner_faces[order], vertex[order], keys[order]
    back = faces[(slots + 2) % 3, corner_faces]
    yield PAUSE
    following, sound = _find(keys, vertex * vertex_count + back)
    twice = keys[1:] == keys[:-1]  # two faces run the same way along an edge
    sound[1:] &= ~twice
    sound[:-1] &= ~twice
    of = loops.ravel().astype(np.int64)
    to, last = loops[:, [1, 2, 0]].ravel(), loops[:, [2, 0, 1]].ravel()
    now, exists = _find(keys, of * vertex_count + to)
    right, exists_right = _find(keys, of * vertex_count + last)
    good = exists & exists_right
    copy = np.flatnonzero(good)
    now = now[copy]
    places, copies, firsts = [], [], []
    for turn in range(most_faces):
        places.append(now)
        copies.append(copy)
        firsts.append(np.full(len(now), turn == 0))
        good[copy[~sound[now]]] = False
        on = sound[now] & (back[now] != last[copy])
        now, copy = following[now[on]], copy[on]
        if not len(now):
            break
    good[copy] = False
    place = np.concatenate(places)
    cuts = Cuts(loops, slots[place], corner_faces[place], np.concatenate(copies), np.concatenate(firsts))
    whole = good.reshape(-1, 3).all(axis=1)
    return cuts.select(whole), corner_faces[right[::3]][whole]


def _handles_steps(cuts: Cuts, right: Indices, faces: Ints, vertex_count: int, parting: Flags | None) -> Steps[Flags]:
    """Return which loops, (n,) bool, can all be cut without splitting a component; the shortest come first."""
    count = len(cuts.loops)
    cut = faces.copy()
    cut[cuts.slots, cuts.faces] = vertex_count + cuts.copy
    yield PAUSE
    if parting is not None:
        parts = np.append(parting, np.zeros(3 * count, bool))
        connecting = cut[np.argmin(np.take(parts, cut), axis=0), np.arange(cut.shape[1])]
        cut = np.where(np.take(parts, cut), connecting, cut)
    roots = yield from component_roots_steps(np.ascontiguousarray(cut.T), vertex_count + 3 * count)
    left_piece, right_piece = roots[vertex_count + 3 * np.arange(count)], roots[cut[0, right]]
    handle = left_piece == right_piece
    necks = np.flatnonzero(~handle)[::-1]
    pieces, number = np.unique([left_piece[necks], right_piece[necks]], return_inverse=True)
    joined = Groups(len(pieces))
    # The longest keep the pieces together.
    for loop, first, second in zip(necks.tolist(), *number.reshape(2, -1).tolist(), strict=True):
        handle[loop] = not joined.join(first, second)
    return handle


def handles_text(count: int) -> str:
    """Return how many small handles were cut and capped.

    Examples
    --------
    >>> handles_text(897), handles_text(1)
    ('897 small handles removed', '1 small handle removed')
    """
    return "1 small handle removed" if count == 1 else f"{count:,} small handles removed"
