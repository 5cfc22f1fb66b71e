# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a simplified surface is farther than a bound from the original, or the original from it: between samples too.

A triangle is convex: a piece whose three corners are near one triangle is near it everywhere. Other pieces are near
where the other surface's distance from their middle is so small that it cannot grow beyond the bound on the way
to their corners, if they stand no steeper than `Policy.steep` against it. What remains is cut in four, and again.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...arrays import Doubles, Flags, Floats, Indices, Ints
from ...mesh.distance.triangle_tree import TriangleTree, squared_distances
from ...mesh.topology import edges_steps
from ...mesh.triangle_mesh import TriangleMesh
from ...mesh.vectors import cross, dot
from ...progress import PAUSE, Steps
from ..policy import POLICY, Policy

Pieces = list[Floats]  # The three corners, (3, n) each.

BLOCK, ASKED = 4096, 1024  # Examine so many pieces, and ask the tree for so many points, at once: they fit the cache.


class Target:
    """Reference surface: its triangles in the order of their tree, and their neighbors."""

    def prepare_steps(self, positions: Floats, faces: Ints) -> Steps[None]:
        """Take in positions (3, V) and faces (3, F)."""
        self.tree = TriangleTree()
        yield from self.tree.prepare_steps(
            TriangleMesh(np.ascontiguousarray(positions.T), np.ascontiguousarray(faces.T))
        )
        faces = faces[:, self.tree.order]
        edges, face_edges = yield from edges_steps(faces.astype(np.int32), positions.shape[1])
        face = np.tile(np.arange(faces.shape[1]), 3)
        first, last = np.empty(edges.shape[1], np.int64), np.empty(edges.shape[1], np.int64)
        last[face_edges.ravel()] = face
        yield PAUSE
        first[face_edges.ravel()[::-1]] = face[::-1]
        yield PAUSE
        first, last = np.take(first, face_edges), np.take(last, face_edges)
        self.neighbor = np.where(first == face.reshape(faces.shape), last, first)  # at a border the face itself

    def triangles(self, number: Indices) -> Iterator[Doubles]:
        """The three corners, (3, n) each."""
        return (np.take(corner, number, axis=1) for corner in self.tree.corners)

    def squared_distances(self, points: Floats, number: Indices) -> Doubles:
        """Squared distance of each point (3, n) to the triangle with the number given for it, a block at a time."""
        squared = np.empty(len(number))
        for start in range(0, len(number), BLOCK):
            block = slice(start, start + BLOCK)
            squared[block] = squared_distances(points[:, block], *self.triangles(number[block]))
        return squared

    def nearest_steps(self, points: Floats, limits: Doubles) -> Steps[tuple[Doubles, Indices]]:
        """`TriangleTree.nearest` of any number of points, (3, n)."""
        squared, near = np.empty(len(limits)), np.empty(len(limits), np.int64)
        for start in range(0, len(limits), ASKED):
            block = slice(start, start + ASKED)
            squared[block], near[block] = self.tree.nearest(points[:, block].astype(np.float64), limits[block])
            yield PAUSE
        return squared, near

    def across(self, points: Floats, number: Indices) -> Indices:
        """The neighbor across the side that each point (3, n) lies beyond most, or the triangle itself."""
        corners = list(self.triangles(number))
        normal = cross(corners[1] - corners[0], corners[2] - corners[0])
        least, across = np.zeros(len(number)), number
        for side in range(3):
            along = corners[(side + 1) % 3] - corners[side]
            beyond = dot(cross(along, points - corners[side]), normal)
            beyond /= np.sqrt(np.maximum(dot(along, along), np.finfo(np.float64).tiny))
            across = np.where(beyond < least, self.neighbor[side].take(number), across)
            least = np.minimum(least, beyond)
        return across


class ErrorCheck:
    """An original and, after `compare_with_steps`, a simplified surface of it.

    Parameters
    ----------
    limit : float
    policy : Policy, optional
        Distances are taken to grow no faster than `steep` along a piece; 1 is right however surfaces stand. The
        smallest pieces are measured at their middles.
    """

    def __init__(self, limit: float, policy: Policy = POLICY) -> None:
        self.limit, self.policy = limit, policy

    def prepare_steps(self, positions: Floats, faces: Ints) -> Steps[None]:
        """Take in the original: positions (3, V) and faces (3, F)."""
        self.original, self.original_faces, self.to_original = positions, faces, Target()
        yield from self.to_original.prepare_steps(positions, faces)

    def compare_with_steps(self, positions: Floats, faces: Ints) -> Steps[None]:
        """Take in the simplified surface: positions (3, W) and faces (3, G)."""
        self.positions, self.faces, self.to_simplified = positions, faces, Target()
        yield from self.to_simplified.prepare_steps(positions, faces)
        squared, near = yield from self.to_simplified.nearest_steps(self.original, self._squared_limits(self.original))
        self.far, self.near = np.isinf(squared), near
        self.nearest = self.to_simplified.tree.order[near]  # face of every vertex of the original, if it is not far
        yield from self._steepness_steps()

    def faces_exceeding_steps(self, numbers: Indices) -> Steps[Indices]:
        """Return which faces of the simplified surface are somewhere farther than the limit from the original."""
        pieces = _pieces(self.positions, self.faces[:, numbers])
        middle = _middle(pieces)
        _, near = yield from self.to_original.nearest_steps(middle, self._squared_limits(middle))
        steep = self.steep[numbers]
        away = yield from _exceeding_steps(self.to_original, pieces, near, steep, self.limit, self.policy)
        return numbers[away]

    def original_exceeding_steps(self, numbers: Indices) -> Steps[Indices]:
        """Return which faces of the original are somewhere farther than the limit from the simplified surface."""
        far = self.far[self.original_faces[:, numbers]].any(axis=0)
        open_ = []
        for start in range(0, len(numbers), BLOCK):
            yield PAUSE
            rest = numbers[start : start + BLOCK][~far[start : start + BLOCK]]
            for corner in self.original_faces:
                pieces = _pieces(self.original, self.original_faces[:, rest])
                rest = rest[~_near_triangle(pieces, self.to_simplified, self.near[corner[rest]], self.limit)]
            open_.append(rest)
        rest = np.concatenate(open_) if open_ else numbers
        pieces = _pieces(self.original, self.original_faces[:, rest])
        near = self.near[self.original_faces[0, rest]]
        away = yield from _exceeding_steps(
            self.to_simplified, pieces, near, self.steep_original[rest], self.limit, self.policy
        )
        return np.concatenate([numbers[far], rest[away]])

    def _squared_limits(self, points: Floats) -> Doubles:
        return np.full(points.shape[1], self.limit * self.limit)

    def _steepness_steps(self) -> Steps[None]:
        """Return the sines of the angles between faces and the other surface, at most `steep`."""
        normals = []
        for pieces in (_pieces(self.original, self.original_faces), _pieces(self.positions, self.faces)):
            normal = cross(pieces[1] - pieces[0], pieces[2] - pieces[0]).astype(np.float64)
            length = np.sqrt(dot(normal, normal))
            normals.append(normal / np.where(length > 0, length, 1.0))
            yield PAUSE
        at_vertex = np.zeros(self.original.shape[1])
        for corner in self.original_faces:
            along = dot(normals[0], np.take(normals[1], self.nearest[corner], axis=1))
            sine = np.where(along > 0, np.sqrt(np.maximum(0.0, 1.0 - along * along)), 1.0)
            np.maximum.at(at_vertex, corner, np.minimum(sine, self.policy.steep))
            yield PAUSE
        self.steep_original = at_vertex[self.original_faces].max(axis=0)
        # A face that no vertex is nearest to stands as its neighbors do.
        steep, around = np.zeros(self.faces.shape[1]), np.zeros(self.positions.shape[1])
        np.maximum.at(steep, self.nearest, at_vertex)
        for corner in self.faces:
            np.maximum.at(around, corner, steep)
        steep = around[self.faces].max(axis=0)
        self.steep = np.where(steep > 0, steep, self.policy.steep)


def _pieces(positions: Floats, faces: Ints) -> Pieces:
    return [np.take(positions, corner, axis=1) for corner in faces]


def _exceeding_steps(
    target: Target, faces: Pieces, near: Indices, steep: Doubles, limit: float, policy: Policy
) -> Steps[Flags]:
    """Return which faces are somewhere farther than the limit from the target; `near` is a triangle near each."""
    away = np.zeros(len(near), bool)
    stack = [(faces, near, np.arange(len(near)), 0)]
    while stack:
        pieces, near, face, level = stack.pop()
        if len(near) > BLOCK:
            for start in range(0, len(near), BLOCK):
                block = slice(start, start + BLOCK)
                stack.append(([corner[:, block] for corner in pieces], near[block], face[block], level))
            continue
        yield PAUSE
        middle = _middle(pieces)
        growth = steep[face] * np.sqrt(np.max([dot(corner - middle, corner - middle) for corner in pieces], axis=0))
        squared = squared_distances(middle, *target.triangles(near))
        open_ = np.flatnonzero((np.sqrt(squared) + growth > limit) & ~away[face])
        open_ = open_[~_near_triangle([corner[:, open_] for corner in pieces], target, near[open_], limit)]
        for _ in range(policy.nearer_steps):
            open_ = open_[np.sqrt(squared[open_]) + growth[open_] > limit]
            across = target.across(middle[:, open_], near[open_])
            other = squared_distances(middle[:, open_], *target.triangles(across))
            closer = other < squared[open_]
            squared[open_[closer]], near[open_[closer]] = other[closer], across[closer]
        # The nearest triangle of all is worth finding only where it can decide.
        ask = open_[(growth[open_] <= limit) & (squared[open_] > limit * limit) | (level == policy.quarterings)]
        other, nearer = yield from target.nearest_steps(middle[:, ask], np.minimum(squared[ask], limit * limit))
        closer = other < squared[ask]
        squared[ask[closer]], near[ask[closer]] = other[closer], nearer[closer]
        away[face[ask[squared[ask] > limit * limit]]] = True
        open_ = open_[(np.sqrt(squared[open_]) + growth[open_] > limit) & ~away[face[open_]]]
        if level < policy.quarterings and len(open_):
            smaller = _quartered([corner[:, open_] for corner in pieces])
            stack.append((smaller, np.tile(near[open_], 4), np.tile(face[open_], 4), level + 1))
    return away


def _near_triangle(pieces: Pieces, target: Target, near: Indices, limit: float) -> Flags:
    """Return which pieces have all corners within the limit of the triangle given for each."""
    rest = np.arange(len(near))
    for corner in pieces:
        squared = squared_distances(np.take(corner, rest, axis=1), *target.triangles(near[rest]))
        rest = rest[squared <= limit * limit]
    within = np.zeros(len(near), bool)
    within[rest] = True
    return within


def _middle(pieces: Pieces) -> Floats:
    return (pieces[0] + pieces[1] + pieces[2]) / np.float32(3.0)


def _quartered(pieces: Pieces) -> Pieces:
    """Every triangle's three corner pieces and its middle piece."""
    a, b, c = pieces
    ab, bc, ca = ((u + v) * np.float32(0.5) for u, v in ((a, b), (b, c), (c, a)))
    return [np.concatenate(parts, axis=1) for parts in ((a, ab, ca, ab), (ab, b, bc, bc), (ca, bc, c, ca))]
