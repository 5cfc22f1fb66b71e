"""A mesh whose edges collapse in rounds, all edges of a round at once.

A round takes the cheapest share of the edges, picks among them edges whose triangles do not meet, and
collapses those that may. Edges keep their cost from round to round until one of their ends moves, and
no list is ever sorted again: a collapse of ab removes the triangles abc and abd, and there the edges
ac and bc become one.

On millions of triangles a round takes a second. What takes long is a generator that yields now and then, so that the
work can be left there; what it returns is its result.

Garland and Heckbert 1997, doi:10.1145/258734.258849; link condition by Dey et al. 1999.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..mesh.topology import edges_steps
from ..mesh.triangle_mesh import TriangleMesh
from ..mesh.vectors import cross, dot
from ..progress import Pauses
from .error_bound import ErrorBound
from .quadrics import EdgeQuadric, best_step, edge_quadric, error, quadrics_rows
from .rollback import History, keep_bound

Ints = NDArray[np.int32]
Places = NDArray[np.int64]
Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]

SHARE = 0.04  # of the edges are looked at in a round: fewer come closer to one heap, and take more rounds
PASSES = 2  # of picking edges whose triangles do not meet
BLOCK = 8192  # edges whose costs are worked out together: what fits the cache
FEW = 0.05  # of the edges tried could collapse: the round was poor
POOR_ROUNDS = 24  # in a row: give up, or give refused edges another chance
TURN = np.float32(0.2)  # a triangle may turn by at most the angle with this cosine


@dataclass(frozen=True, eq=False)
class Collapses:
    """Edges about to collapse, no two with an end at the same triangle, and the faces round them.

    edges : (n,) int64
    kept, dropped : (n,) int32
        The ends: the vertex that stays, and moves to the target, and the one that goes.
    target : (3, n) float32
    faces : (s,) int64
        With a corner in a collapse.
    owner : (s,) int32
        In which.
    gone : (s,) bool
        Whether the face vanishes: it has two corners there.
    """

    edges: Places
    kept: Ints
    dropped: Ints
    target: Floats
    faces: Places
    owner: Ints
    gone: Flags

    def only(self, chosen: Flags) -> Collapses:
        """Some of them, (n,) bool, numbered anew."""
        if chosen.all():
            return self
        number = np.cumsum(chosen, dtype=np.int32) - np.int32(1)
        faces = chosen[self.owner]
        return Collapses(
            self.edges[chosen],
            self.kept[chosen],
            self.dropped[chosen],
            np.compress(chosen, self.target, axis=1),
            self.faces[faces],
            number[self.owner[faces]],
            self.gone[faces],
        )

    def moved(self, positions: Floats) -> Floats:
        """Positions (3, V) with both ends of every edge at its target."""
        moved = positions.copy()
        moved[:, self.kept] = self.target
        moved[:, self.dropped] = self.target
        return moved


class CollapsingMesh:
    """The mesh while it is simplified: columns instead of rows, and every edge once.

    positions, normals : (3, V) float32
    quadrics : (6, V) float32
    faces : (3, F) int32, vertex numbers
    face_edges : (3, F) int32, the edge from corner i to corner i + 1
    edges : (2, E) int32, vertex numbers
    cost : (E,) float32, inf where the edge cannot be collapsed as things are
    fixed : (V,) bool, vertices that stay where they are
    """

    def __init__(self, mesh: TriangleMesh, max_error: float | None = None, held: float = 1.0) -> None:
        vertices = mesh.vertices
        extent = float((vertices.max(axis=0) - vertices.min(axis=0)).max())
        # A power of two: nothing is rounded, and float32 neither over- nor underflows in any unit.
        self.scale = np.float32(2.0 ** -np.frexp(extent)[1])
        self.positions = np.ascontiguousarray(vertices.T) * self.scale
        self.normals = None if mesh.normals is None else np.ascontiguousarray(mesh.normals.T)
        self.faces = np.ascontiguousarray(mesh.faces.T)
        self.limit, self.held = None if max_error is None else max_error * float(self.scale), held
        self.bound: ErrorBound | None = None
        self.accepted = 1.0  # share of the edges tried in the last round that could collapse
        self.poor_rounds = 0  # in a row, with hardly a collapse
        self.collapsed = 0  # since refused edges were last given another chance

    @property
    def face_count(self) -> int:
        """Number of faces left."""
        return self.faces.shape[1]

    def prepare(self) -> Pauses[None]:
        """Find the edges and what they cost: before anything else."""
        vertex_count = self.positions.shape[1]
        self.edges, self.face_edges = yield from edges_steps(self.faces, vertex_count)
        self.fixed = yield from _fixed(self.faces, self.edges, self.face_edges, vertex_count)
        self.quadrics = yield from quadrics_rows(self.positions, self.faces)
        self.cost = np.full(self.edges.shape[1], np.inf, np.float32)
        if self.limit is not None:
            self.name = np.arange(vertex_count, dtype=np.int32)
            self.history = History(self.positions.copy(), self.normals, self.faces, self.fixed)
            self.bound = ErrorBound(self.limit, self.held)
            yield from self.bound.prepare(self.positions, self.faces, self.edges, self.face_edges)
        yield from self.price()

    def price(self, edges: Places | None = None) -> Pauses[None]:
        """Work out the cost of these edges, or of all."""
        edges = np.arange(len(self.cost)) if edges is None else edges
        for number, start in enumerate(range(0, len(edges), BLOCK)):
            block = edges[start : start + BLOCK]
            first, second = np.take(self.edges, block, axis=1)
            quadric, step, _ = self.merged(first, second)
            cost = error(quadric, step)
            cost[self.fixed[first] & self.fixed[second]] = np.inf
            self.cost[block] = cost
            if number % 16 == 15:
                yield

    def merged(self, first: Ints, second: Ints) -> tuple[EdgeQuadric, Floats, Floats]:
        """Quadric of the edges between these vertices, step from the middle to the new vertex, the new vertex."""
        start, end = np.take(self.positions, first, axis=1), np.take(self.positions, second, axis=1)
        half = (end - start) * np.float32(0.5)
        quadric = edge_quadric(np.take(self.quadrics, first, axis=1), np.take(self.quadrics, second, axis=1), half)
        step = best_step(quadric)
        target = start + half + step
        for vertex, place, way in ((first, start, -half), (second, end, half)):
            fixed = self.fixed[vertex]
            if fixed.any():
                np.copyto(step, way, where=fixed)
                np.copyto(target, place, where=fixed)
        return quadric, step, target

    def can_collapse(self) -> Pauses[bool]:
        """Whether it is worth trying; refused edges are tried again where enough others have gone since."""
        if self.poor_rounds < POOR_ROUNDS and np.isfinite(self.cost).any():
            return True
        if self.collapsed <= len(self.cost) // 1000:
            return False
        self.poor_rounds = self.collapsed = 0
        yield from self.price()
        return bool(np.isfinite(self.cost).any())

    def collapse(self, budget: int) -> Pauses[None]:
        """One round: collapse at most `budget` of the cheapest edges that do not get in each other's way."""
        count = int(min(SHARE * len(self.cost), 8 * budget) / self.accepted)
        candidates = self.cheapest(min(count, len(self.cost) - 1))
        yield
        edges = yield from self.apart(candidates)
        collapses = self.collapses(edges)
        yield
        tried = len(collapses.edges)
        checks = [self.unlinked, self.turned]
        if self.bound is not None:
            checks.append(self.too_far)
        for check in checks:
            refused = yield from check(collapses)
            self.cost[collapses.edges[refused]] = np.inf
            collapses = collapses.only(~refused)
            yield
        left = len(collapses.edges)
        self.accepted = max(left / tried, FEW)
        self.poor_rounds = self.poor_rounds + 1 if self.accepted == FEW else 0
        if left > budget:
            cheapest = np.zeros(left, bool)
            cheapest[np.argsort(self.cost[collapses.edges], kind="stable")[:budget]] = True
            collapses = collapses.only(cheapest)
        if left:
            yield from self.merge(collapses)

    def cheapest(self, count: int) -> Places:
        """The `count` cheapest edges and those that cost the same as the last of them."""
        limit = np.partition(self.cost, count)[count]
        if np.isfinite(limit):
            return np.flatnonzero(self.cost <= limit)
        return np.flatnonzero(np.isfinite(self.cost))

    def apart(self, candidates: Places) -> Pauses[Places]:
        """Some of the candidates, no two of which have an end at the same triangle (Luby 1986)."""
        candidates = candidates[np.argsort(_shuffled(candidates))]
        first, second = self.edges
        free = np.ones(self.positions.shape[1], bool)
        chosen: list[Places] = []
        for _ in range(PASSES):
            a, b = np.take(self.edges, candidates, axis=1)
            count = len(candidates)
            rank = np.arange(count, dtype=np.int32)
            # The best rank at every vertex: written from the worst to the best, the last stays.
            best = np.full(len(free), count, np.int32)
            best[np.stack([a[::-1], b[::-1]], axis=1).ravel()] = np.repeat(rank[::-1], 2)
            beside_first, beside_second = np.take(best, first), np.take(best, second)
            lost = np.zeros(len(free), bool)
            lost[np.compress(beside_first > beside_second, first)] = True
            lost[np.compress(beside_second > beside_first, second)] = True
            won = (best[a] == rank) & (best[b] == rank) & ~(lost[a] | lost[b])
            chosen.append(candidates[won])
            yield

            near = np.zeros(len(free), bool)
            near[a[won]] = near[b[won]] = True
            free[near] = False
            free[np.compress(np.take(near, second), first)] = False
            free[np.compress(np.take(near, first), second)] = False
            candidates = candidates[free[a] & free[b]]
            yield
        return np.concatenate(chosen)

    def collapses(self, edges: Places) -> Collapses:
        """What collapsing these edges would do; no two have an end at the same triangle."""
        first, second = np.take(self.edges, edges, axis=1)
        _, _, target = self.merged(first, second)
        swap = self.fixed[second]
        ends = np.where(swap, second, first), np.where(swap, first, second)
        owner = np.full(self.positions.shape[1], -1, np.int32)
        owner[ends[0]] = owner[ends[1]] = np.arange(len(edges), dtype=np.int32)
        owners = np.take(owner, self.faces)  # (3, F)
        highest = owners.max(axis=0)
        star = np.flatnonzero(highest >= 0)
        a, b, c = np.take(owners, star, axis=1) >= 0
        return Collapses(edges, *ends, target, star, highest[star], (a & (b | c)) | (b & c))

    def unlinked(self, collapses: Collapses) -> Pauses[Flags]:
        """Which collapses fail the link condition: the ends must share two neighbours, no more.

        And neither of the two may have only one neighbour beside them, or a tetrahedron would fold flat.
        """
        count = len(collapses.edges)
        owner = np.full(self.positions.shape[1], -1, np.int32)
        owner[collapses.kept] = owner[collapses.dropped] = np.arange(count, dtype=np.int32)
        first, second = self.edges
        owner_first, owner_second = np.take(owner, first), np.take(owner, second)
        pairs = []
        for inside, outside, end in ((owner_first, owner_second, second), (owner_second, owner_first, first)):
            across = np.flatnonzero((inside >= 0) & (inside != outside))
            pairs.append(inside[across].astype(np.int64) * len(owner) + end[across])
            yield
        keys = np.sort(np.concatenate(pairs))
        shared, neighbour = np.divmod(keys[1:][keys[1:] == keys[:-1]], len(owner))
        refused = np.bincount(shared, minlength=count) != 2
        neighbours = np.bincount(self.edges.ravel(), minlength=len(owner))
        refused[shared[(neighbours[neighbour] == 3) & ~self.fixed[neighbour]]] = True
        return refused

    def turned(self, collapses: Collapses) -> Pauses[Flags]:
        """Which collapses turn a face too far, or leave it without area."""
        corners = np.take(self.faces, collapses.faces[~collapses.gone], axis=1)
        normals = []
        for positions in (self.positions, collapses.moved(self.positions)):
            a, b, c = (np.take(positions, corner, axis=1) for corner in corners)
            normals.append(cross(b - a, c - a))
            yield
        before, after = normals
        straight, size = dot(before, after), dot(after, after)
        bad = (straight < 0) | (straight * straight < TURN * TURN * dot(before, before) * size) | (size == 0)
        refused = np.zeros(len(collapses.edges), bool)
        refused[collapses.owner[~collapses.gone][bad]] = True
        return refused

    def too_far(self, collapses: Collapses) -> Pauses[Flags]:
        """Which collapses take the surface too far from the original."""
        assert self.bound is not None
        moved = collapses.moved(self.positions)
        yield
        return (yield from self.bound.exceeded(collapses, self.faces, moved))

    def merge(self, collapses: Collapses) -> Pauses[None]:
        """Do it."""
        keep, drop, gone = collapses.kept, collapses.dropped, collapses.faces[collapses.gone]
        self.collapsed += len(keep)
        self.positions[:, keep] = collapses.target
        if self.normals is not None:
            self.normals[:, keep] += self.normals[:, drop]

        # In every face that vanishes the other two edges become one.
        collapsed = np.zeros(len(self.cost), bool)
        collapsed[collapses.edges] = True
        sides = np.take(self.face_edges, gone, axis=1)
        slot = np.argmax(collapsed[sides], axis=0)
        column = np.arange(len(gone))
        lost, stays = sides[(slot + 1) % 3, column], sides[(slot + 2) % 3, column]
        collapsed[lost] = True
        edge_left = np.flatnonzero(~collapsed)
        edge_number = np.empty(len(collapsed), np.int32)
        edge_number[edge_left] = np.arange(len(edge_left), dtype=np.int32)
        edge_number[lost] = edge_number[stays]

        yield

        face_left = np.ones(self.face_count, bool)
        face_left[gone] = False
        face_left = np.flatnonzero(face_left)
        vertex_left = np.ones(self.positions.shape[1], bool)
        vertex_left[drop] = False
        vertex_left = np.flatnonzero(vertex_left)
        vertex_number = np.empty(self.positions.shape[1], np.int32)
        vertex_number[vertex_left] = np.arange(len(vertex_left), dtype=np.int32)
        vertex_number[drop] = vertex_number[keep]

        yield

        if self.bound is not None:
            self.bound.accept(face_left)
            self.history.add(self.name[keep], self.name[drop], collapses.target)
            self.name = self.name[vertex_left]
        self.faces = np.take(vertex_number, np.take(self.faces, face_left, axis=1))
        self.face_edges = np.take(edge_number, np.take(self.face_edges, face_left, axis=1))
        yield
        self.edges = np.take(vertex_number, np.take(self.edges, edge_left, axis=1))
        self.cost = self.cost[edge_left]
        self.positions = np.take(self.positions, vertex_left, axis=1)
        self.fixed = self.fixed[vertex_left]
        if self.normals is not None:
            self.normals = np.take(self.normals, vertex_left, axis=1)
        yield
        self.quadrics = yield from quadrics_rows(self.positions, self.faces)

        changed = np.zeros(len(vertex_left), bool)
        changed[vertex_number[keep]] = True
        yield from self.price(np.flatnonzero(np.take(changed, self.edges).any(axis=0)))

    def keep_bound(self) -> Pauses[None]:
        """Take collapses back until the bound on the error, if there is one, is kept everywhere: last of all."""
        if self.bound is not None:
            history, check, self.bound = self.history, self.bound.check, None  # the samples are not needed any more
            del self.quadrics, self.cost, self.edges, self.face_edges
            yield from keep_bound(history, check)
            self.positions, self.normals, self.faces = history.positions, history.normals, history.faces

    def mesh(self) -> TriangleMesh:
        """The mesh as it is now, without the vertices that are not used any more."""
        used = np.zeros(self.positions.shape[1], bool)
        used[self.faces] = True
        number = np.cumsum(used, dtype=np.int32) - np.int32(1)
        vertices = np.ascontiguousarray((self.positions[:, used] / self.scale).T)
        normals = None
        if self.normals is not None:
            normals = self.normals[:, used]
            length = np.sqrt(dot(normals, normals))
            length[length == 0] = 1.0
            normals = np.ascontiguousarray((normals / length).T)
        return TriangleMesh(vertices, np.ascontiguousarray(number[self.faces].T), normals)


def _fixed(faces: Ints, edges: Ints, face_edges: Ints, vertex_count: int) -> Pauses[Flags]:
    """Vertices that must stay: those on a border, and those of faces at an edge with other than two faces."""
    faces_at = np.bincount(face_edges.ravel(), minlength=edges.shape[1])
    yield
    fixed = np.zeros(vertex_count, bool)
    fixed[edges[:, faces_at == 1]] = True
    odd = (faces_at > 2) | (edges[0] == edges[1])
    fixed[faces[:, odd[face_edges].any(axis=0)]] = True
    return fixed


def _shuffled(numbers: Places) -> NDArray[np.uint32]:
    """Another number for every number below 2^32, none twice, in no visible order."""
    mixed = numbers.astype(np.uint32)
    for factor in (0x85EBCA6B, 0xC2B2AE35):  # the odd factors of MurmurHash3's last mixing
        mixed ^= mixed >> np.uint32(15)
        mixed *= np.uint32(factor)
    mixed ^= mixed >> np.uint32(16)
    return mixed
