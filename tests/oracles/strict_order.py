# SPDX-License-Identifier: GPL-3.0-or-later
"""Edge collapse in the strict order of cost: one heap, one collapse after the other, all costs around it anew.

What rounds of many collapses come near to. For some thousand triangles; a border stays where it is.
"""

from __future__ import annotations

import heapq

import numpy as np

from ctmc_addon.core import TriangleMesh

DAMPING = 1e-6
TURN = 0.2


class Strict:
    """A mesh while it is simplified. `history`: quadrics are summed up, not made anew from the faces there are."""

    def __init__(self, mesh: TriangleMesh, history: bool = False) -> None:
        self.history = history
        self.places = mesh.vertices.astype(np.float64)
        self.corners = mesh.faces.astype(np.int64)
        self.faces_at: list[set[int]] = [set() for _ in self.places]
        for number, face in enumerate(self.corners.tolist()):
            for corner in face:
                self.faces_at[corner].add(number)
        self.count = len(self.corners)
        self.version = np.zeros(len(self.places), np.int64)  # of each vertex, raised when its costs change
        edges = {(a, b) for vertex in range(len(self.places)) for a, b in self.edges_of(vertex)}
        at_border = [edge for edge in edges if len(self.faces_at[edge[0]] & self.faces_at[edge[1]]) != 2]
        self.locked = {vertex for edge in at_border for vertex in edge}
        self.quadrics = np.array([self.quadric(vertex) for vertex in range(len(self.places))])  # (V, 4, 4)
        self.heap: list[tuple[float, int, int, int, int]] = []
        self.push(sorted(edges))

    def edges_of(self, vertex: int) -> set[tuple[int, int]]:
        """The edges at a vertex, the lower end first."""
        return {(min(vertex, other), max(vertex, other)) for other in self.neighbors(vertex)}

    def neighbors(self, vertex: int) -> set[int]:
        """The vertices that share a face with it."""
        return set(self.corners[list(self.faces_at[vertex])].ravel().tolist()) - {vertex}

    def quadric(self, vertex: int) -> np.ndarray:
        """Sum over the faces of the squared distance to their plane times a third of their area, (4, 4)."""
        a, b, c = self.places[self.corners[list(self.faces_at[vertex])]].transpose(1, 0, 2)
        normals = np.cross(b - a, c - a)
        length = np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        planes = np.concatenate([normals / length, -(normals / length * a).sum(axis=1, keepdims=True)], axis=1)
        return np.einsum("n,ni,nj->ij", length[:, 0] / 6, planes, planes)

    def targets(self, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where the vertex goes that edges (n, 2) become, (n, 3), and what that costs, (n,)."""
        quadric = self.quadrics[edges].sum(axis=1)
        middle = self.places[edges].mean(axis=1)
        matrix = quadric[:, :3, :3]
        slope = np.einsum("nij,nj->ni", matrix, middle) + quadric[:, :3, 3]
        damped = matrix + (DAMPING * np.maximum(np.trace(matrix, axis1=1, axis2=2), 1e-30))[:, None, None] * np.eye(3)
        target = middle - np.linalg.solve(damped, slope[:, :, None])[:, :, 0]
        for end in (0, 1):
            at_border = np.array([edge[end] in self.locked for edge in edges.tolist()], bool)
            target[at_border] = self.places[edges[at_border, end]]
        point = np.concatenate([target, np.ones((len(edges), 1))], axis=1)
        return target, np.maximum(np.einsum("ni,nij,nj->n", point, quadric, point), 0.0)

    def push(self, edges: list[tuple[int, int]]) -> None:
        """Put edges on the heap with what they cost now."""
        edges = [edge for edge in edges if not self.locked.issuperset(edge)]
        if edges:
            _, costs = self.targets(np.array(edges))
            for (a, b), cost in zip(edges, costs.tolist(), strict=True):
                heapq.heappush(self.heap, (cost, a, b, int(self.version[a]), int(self.version[b])))

    def may(self, first: int, second: int, target: np.ndarray) -> bool:
        """Whether the link condition holds, and no face turns too far."""
        shared = self.neighbors(first) & self.neighbors(second)
        if len(shared) != 2 or any(len(self.neighbors(each)) == 3 and each not in self.locked for each in shared):
            return False
        left = self.corners[list(self.faces_at[first] ^ self.faces_at[second])]
        before = self.places[left]
        after = before.copy()
        after[(left == first) | (left == second)] = target
        old, new = (np.cross(each[:, 1] - each[:, 0], each[:, 2] - each[:, 0]) for each in (before, after))
        along = (old * new).sum(axis=1)
        return bool((along > TURN * np.linalg.norm(old, axis=1) * np.linalg.norm(new, axis=1)).all())

    def collapse(self, first: int, second: int, target: np.ndarray) -> None:
        """Collapse an edge, and work out the costs of all edges that this changes."""
        if second in self.locked:
            first, second = second, first
        gone = self.faces_at[first] & self.faces_at[second]
        for face in gone:
            for corner in self.corners[face].tolist():
                self.faces_at[corner].discard(face)
        for face in self.faces_at[second]:
            self.corners[face][self.corners[face] == second] = first
        self.faces_at[first] |= self.faces_at[second]
        self.faces_at[second] = set()
        self.version[second] = -1
        self.places[first] = target
        self.count -= len(gone)
        changed = {first}
        if self.history:
            self.quadrics[first] += self.quadrics[second]
        else:
            changed |= self.neighbors(first)
            for vertex in changed:
                self.quadrics[vertex] = self.quadric(vertex)
        for vertex in changed:
            self.version[vertex] += 1
        self.push(sorted({edge for vertex in changed for edge in self.edges_of(vertex)}))

    def mesh(self) -> TriangleMesh:
        """What is left."""
        used, faces = np.unique(self.corners[sorted(set().union(*self.faces_at))], return_inverse=True)
        return TriangleMesh(self.places[used].astype(np.float32), faces.reshape(-1, 3).astype(np.int32))


def strictly_simplified(mesh: TriangleMesh, reduction: float, history: bool = False) -> TriangleMesh:
    """Simplify to the same number of triangles as `simplify`, but in the strict order."""
    work, target = Strict(mesh, history), round(len(mesh.faces) * (1 - reduction))
    while work.count > target and work.heap:
        _, a, b, version_a, version_b = heapq.heappop(work.heap)
        if (work.version[a], work.version[b]) == (version_a, version_b):
            place = work.targets(np.array([[a, b]]))[0][0]
            if work.may(a, b, place):
                work.collapse(a, b, place)
    return work.mesh()
