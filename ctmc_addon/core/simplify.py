"""Fewer triangles for nearly the same surface: edge collapse by quadric error, in rounds.

A round takes the cheapest share of the edges, picks among them edges whose triangles do not meet, and
collapses all of them at once. Edges keep their cost from round to round until one of their ends moves,
and no list is ever sorted again: a collapse of ab removes the triangles abc and abd, and there the
edges ac and bc become one.

What never changes: closed stays closed and manifold stays manifold (link condition, Dey et al. 1999),
no triangle turns over, vertices on a border stay where they are and border edges are not collapsed.
Triangles at edges with three triangles or more are left alone.
Garland and Heckbert 1997, doi:10.1145/258734.258849.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .errors import SettingsError
from .mesh import TriangleMesh
from .progress import Step, Steps, finish
from .quadrics import EdgeQuadric, best_step, cross, dot, edge_quadric, error, vertex_quadrics

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


def simplify(
    mesh: TriangleMesh,
    reduction: float | None = None,
    target_faces: int | None = None,
    max_error: float | None = None,
) -> TriangleMesh:
    """The surface with fewer triangles. Exactly one of the three goals is given.

    Parameters
    ----------
    mesh : TriangleMesh
        In any unit; normals are carried along.
    reduction : float in [0, 1)
        Share of the triangles to remove.
    target_faces : int, 1 or more
        Triangles to keep at most.
    max_error : float above 0
        Bound on the distance to the input, both ways, in the mesh's unit.

    Returns
    -------
    TriangleMesh
        No more triangles than asked, and at most one fewer, unless collapsing more edges would break
        what is promised above (`simplify_steps` says so in its last step).

    Raises
    ------
    SettingsError
        Without exactly one goal, or with one outside its limits.

    Examples
    --------
    >>> corners = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [1, 1, 0]], np.float32)
    >>> square = TriangleMesh(corners, np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]], np.int32))
    >>> len(simplify(square, reduction=0.5).faces)
    2
    """
    return finish(simplify_steps(mesh, reduction, target_faces, max_error))


def simplify_steps(
    mesh: TriangleMesh,
    reduction: float | None = None,
    target_faces: int | None = None,
    max_error: float | None = None,
) -> Steps[TriangleMesh]:
    """`simplify` as steps; the last message says how many triangles there are, and why if that is more than asked."""
    target = _target(len(mesh.faces), reduction, target_faces, max_error)
    start = len(mesh.faces)
    if target >= start:
        return mesh
    yield Step(0.0, "Simplifying")
    work = _Work(mesh)
    yield from work.price(np.arange(work.edges.shape[1]))
    while work.face_count > target and work.can_collapse():
        work.collapse(-(-(work.face_count - target) // 2))
        yield Step(min(1.0, (start - work.face_count) / (start - target)), "Simplifying")
    message = f"{work.face_count} triangles"
    if work.face_count > target:
        message += f" instead of {target}: no edge is left that can go without moving a border or tearing the surface"
    yield Step(1.0, message)
    return work.mesh()


def _target(face_count: int, reduction: float | None, target_faces: int | None, max_error: float | None) -> int:
    goals = {"reduction": reduction, "target_faces": target_faces, "max_error": max_error}
    given = [name for name, value in goals.items() if value is not None]
    if len(given) != 1:
        what = " and ".join(given) if given else "none"
        raise SettingsError(f"give exactly one of reduction, target_faces and max_error to simplify; given: {what}")
    if reduction is not None:
        if not 0 <= reduction < 1:
            raise SettingsError(f"reduction {reduction:g} is outside [0, 1); 0.9 removes 90 % of the triangles")
        return max(1, round(face_count * (1 - reduction)))
    if target_faces is not None:
        if target_faces < 1:
            raise SettingsError(f"target_faces {target_faces} is below 1; give the number of triangles to keep")
        return target_faces
    raise SettingsError("max_error is not available yet; give reduction or target_faces")


class _Work:
    """The mesh while it is simplified: columns instead of rows, and every edge once.

    positions, normals : (3, V) float32
    quadrics : (6, V) float32
    faces : (3, F) int32, vertex numbers
    face_edges : (3, F) int32, the edge from corner i to corner i + 1
    edges : (2, E) int32, vertex numbers
    cost : (E,) float32, inf where the edge cannot be collapsed as things are
    fixed : (V,) bool, vertices that stay where they are
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        vertices = mesh.vertices
        extent = float((vertices.max(axis=0) - vertices.min(axis=0)).max())
        # A power of two: nothing is rounded, and float32 neither over- nor underflows in any unit.
        self.scale = np.float32(2.0 ** -np.frexp(extent)[1])
        self.positions = np.ascontiguousarray(vertices.T) * self.scale
        self.normals = None if mesh.normals is None else np.ascontiguousarray(mesh.normals.T)
        self.faces = np.ascontiguousarray(mesh.faces.T)
        self.edges, self.face_edges = _edges(self.faces, len(vertices))
        self.fixed = _fixed(self.faces, self.edges, self.face_edges, len(vertices))
        self.quadrics = vertex_quadrics(self.positions, self.faces)
        self.cost = np.full(self.edges.shape[1], np.inf, np.float32)
        self.accepted = 1.0  # share of the edges tried in the last round that could collapse
        self.poor_rounds = 0  # in a row, with hardly a collapse
        self.collapsed = 0  # since refused edges were last given another chance

    @property
    def face_count(self) -> int:
        return self.faces.shape[1]

    def price(self, edges: Places) -> Steps[None]:
        """Work out the cost of these edges."""
        for number, start in enumerate(range(0, len(edges), BLOCK)):
            block = edges[start : start + BLOCK]
            first, second = np.take(self.edges, block, axis=1)
            quadric, step, _ = self.merged(first, second)
            cost = error(quadric, step)
            cost[self.fixed[first] & self.fixed[second]] = np.inf
            self.cost[block] = cost
            if number % 64 == 63:
                yield Step(0.0, "Simplifying")

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

    def can_collapse(self) -> bool:
        """Whether it is worth trying; refused edges are tried again where enough others have gone since."""
        if self.poor_rounds < POOR_ROUNDS and np.isfinite(self.cost).any():
            return True
        if self.collapsed <= len(self.cost) // 1000:
            return False
        self.poor_rounds = self.collapsed = 0
        finish(self.price(np.arange(len(self.cost))))
        return bool(np.isfinite(self.cost).any())

    def collapse(self, budget: int) -> None:
        """One round: collapse at most `budget` of the cheapest edges that do not get in each other's way."""
        count = min(SHARE * len(self.cost), 8 * budget) / self.accepted
        chosen = self.apart(self.cheapest(min(int(count), len(self.cost) - 1)))
        first, second = np.take(self.edges, chosen, axis=1)
        _, _, target = self.merged(first, second)
        owner = np.full(self.positions.shape[1], -1, np.int32)  # which collapse a vertex belongs to
        owner[first] = owner[second] = np.arange(len(chosen), dtype=np.int32)

        star, star_owner, gone = self.stars(owner)
        refused = self.unlinked(owner, len(chosen))
        moved = self.positions.copy()
        moved[:, first] = target
        moved[:, second] = target
        refused[star_owner[~gone][self.turned(star[~gone], moved)]] = True
        self.cost[chosen[refused]] = np.inf

        kept = np.flatnonzero(~refused)
        self.accepted = max(len(kept) / len(chosen), FEW)
        self.poor_rounds = self.poor_rounds + 1 if self.accepted == FEW else 0
        if len(kept) > budget:
            kept = np.sort(kept[np.argsort(self.cost[chosen[kept]], kind="stable")[:budget]])
        if len(kept):
            self.collapsed += len(kept)
            accepted = np.zeros(len(chosen), bool)
            accepted[kept] = True
            self.merge(chosen[kept], target[:, kept], star[gone & accepted[star_owner]])

    def cheapest(self, count: int) -> Places:
        """The `count` cheapest edges and those that cost the same as the last of them."""
        limit = np.partition(self.cost, count)[count]
        if np.isfinite(limit):
            return np.flatnonzero(self.cost <= limit)
        return np.flatnonzero(np.isfinite(self.cost))

    def apart(self, candidates: Places) -> Places:
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

            near = np.zeros(len(free), bool)
            near[a[won]] = near[b[won]] = True
            free[near] = False
            free[np.compress(np.take(near, second), first)] = False
            free[np.compress(np.take(near, first), second)] = False
            candidates = candidates[free[a] & free[b]]
        return np.concatenate(chosen)

    def stars(self, owner: Ints) -> tuple[Places, Ints, Flags]:
        """Faces with a corner in a collapse, the collapse, and whether they vanish (two corners in it)."""
        owners = np.take(owner, self.faces)  # (3, F)
        highest = owners.max(axis=0)
        star = np.flatnonzero(highest >= 0)
        inside = np.take(owners, star, axis=1) >= 0
        return star, highest[star], (inside[0] & (inside[1] | inside[2])) | (inside[1] & inside[2])

    def unlinked(self, owner: Ints, count: int) -> Flags:
        """Which collapses fail the link condition: the ends must share two neighbours, no more.

        And neither of the two may have only one neighbour beside them, or a tetrahedron would fold flat.
        """
        first, second = self.edges
        owner_first, owner_second = np.take(owner, first), np.take(owner, second)
        pairs = []
        for inside, outside, end in ((owner_first, owner_second, second), (owner_second, owner_first, first)):
            across = np.flatnonzero((inside >= 0) & (inside != outside))
            pairs.append(inside[across].astype(np.int64) * len(owner) + end[across])
        keys = np.sort(np.concatenate(pairs))
        shared, neighbour = np.divmod(keys[1:][keys[1:] == keys[:-1]], len(owner))
        refused = np.bincount(shared, minlength=count) != 2
        neighbours = np.bincount(self.edges.ravel(), minlength=len(owner))
        refused[shared[(neighbours[neighbour] == 3) & ~self.fixed[neighbour]]] = True
        return refused

    def turned(self, faces: Places, moved: Floats) -> Flags:
        """Which of the faces turn too far, or lose their area, when the vertices move to (3, V)."""
        corners = np.take(self.faces, faces, axis=1)
        normals = []
        for positions in (self.positions, moved):
            a, b, c = (np.take(positions, corner, axis=1) for corner in corners)
            normals.append(cross(b - a, c - a))
        before, after = normals
        straight, size = dot(before, after), dot(after, after)
        return (straight < 0) | (straight * straight < TURN * TURN * dot(before, before) * size) | (size == 0)

    def merge(self, chosen: Places, target: Floats, gone: Places) -> None:
        """Collapse the chosen edges into the target positions; `gone` are the faces that vanish."""
        first, second = np.take(self.edges, chosen, axis=1)
        swap = self.fixed[second]
        keep, drop = np.where(swap, second, first), np.where(swap, first, second)
        self.positions[:, keep] = target
        if self.normals is not None:
            self.normals[:, keep] += self.normals[:, drop]

        # In every face that vanishes the other two edges become one.
        collapsed = np.zeros(len(self.cost), bool)
        collapsed[chosen] = True
        sides = np.take(self.face_edges, gone, axis=1)
        slot = np.argmax(collapsed[sides], axis=0)
        column = np.arange(len(gone))
        lost, stays = sides[(slot + 1) % 3, column], sides[(slot + 2) % 3, column]
        collapsed[lost] = True
        edge_left = np.flatnonzero(~collapsed)
        edge_number = np.empty(len(collapsed), np.int32)
        edge_number[edge_left] = np.arange(len(edge_left), dtype=np.int32)
        edge_number[lost] = edge_number[stays]

        face_left = np.ones(self.face_count, bool)
        face_left[gone] = False
        face_left = np.flatnonzero(face_left)
        vertex_left = np.ones(self.positions.shape[1], bool)
        vertex_left[drop] = False
        vertex_left = np.flatnonzero(vertex_left)
        vertex_number = np.empty(self.positions.shape[1], np.int32)
        vertex_number[vertex_left] = np.arange(len(vertex_left), dtype=np.int32)
        vertex_number[drop] = vertex_number[keep]

        self.faces = np.take(vertex_number, np.take(self.faces, face_left, axis=1))
        self.face_edges = np.take(edge_number, np.take(self.face_edges, face_left, axis=1))
        self.edges = np.take(vertex_number, np.take(self.edges, edge_left, axis=1))
        self.cost = self.cost[edge_left]
        self.positions = np.take(self.positions, vertex_left, axis=1)
        self.fixed = self.fixed[vertex_left]
        if self.normals is not None:
            self.normals = np.take(self.normals, vertex_left, axis=1)
        self.quadrics = vertex_quadrics(self.positions, self.faces)

        changed = np.zeros(len(vertex_left), bool)
        changed[vertex_number[keep]] = True
        finish(self.price(np.flatnonzero(np.take(changed, self.edges).any(axis=0))))

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


def _edges(faces: Ints, vertex_count: int) -> tuple[Ints, Ints]:
    """Every edge once, (2, E), and the edges of every face, (3, F)."""
    start, end = faces, faces[[1, 2, 0]]
    keys = np.minimum(start, end).astype(np.int64) * vertex_count + np.maximum(start, end)
    keys = keys.ravel()
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    new = np.ones(len(keys), bool)
    new[1:] = keys[1:] != keys[:-1]
    face_edges = np.empty(len(keys), np.int32)
    face_edges[order] = np.cumsum(new, dtype=np.int32) - np.int32(1)
    edges = np.array(np.divmod(keys[new], vertex_count), np.int32)
    return edges, face_edges.reshape(faces.shape)


def _fixed(faces: Ints, edges: Ints, face_edges: Ints, vertex_count: int) -> Flags:
    """Vertices that must stay: those on a border, and those of faces at an edge with other than two faces."""
    faces_at = np.bincount(face_edges.ravel(), minlength=edges.shape[1])
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
