"""Exact distance from points to the nearest triangle of a mesh.

A tree of boxes over the triangles in Morton order: every box holds four boxes of the level below. All
points go down the tree together, level by level, as pairs of point and box; a pair is dropped when its
box is farther than a triangle that the point is known to be near.

Positions in any one space; distances in its unit.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError
from ..progress import Pauses, finish
from ..simplification.quadrics import cross, dot
from .triangle_mesh import TriangleMesh

Doubles = NDArray[np.float64]

BRANCH = 4  # boxes in a box
BLOCK = 1024  # points that go down the tree together: their pairs fit the cache


def distances(points: NDArray[Any], mesh: TriangleMesh) -> Doubles:
    """Distance from every point to the surface.

    Parameters
    ----------
    points : (n, 3)
        In the space of the mesh.
    mesh : TriangleMesh
        With at least one triangle.

    Returns
    -------
    (n,) float64
        To the nearest point of the nearest triangle.

    Raises
    ------
    MeshError
        For a mesh without triangles.

    Examples
    --------
    >>> flat = TriangleMesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32))
    >>> distances([[1.0, 1.0, 1.0]], flat).round(4)
    array([1.1547])
    """
    return TriangleTree(mesh).distances(points)


class TriangleTree:
    """The triangles of a mesh, ready for many questions about distance; without a mesh, to be prepared in steps."""

    def __init__(self, mesh: TriangleMesh | None = None) -> None:
        if mesh is not None:
            finish(self.prepare(mesh))

    def prepare(self, mesh: TriangleMesh) -> Pauses[None]:
        """Take in a mesh; yields now and then."""
        if not len(mesh.faces):
            raise MeshError("a mesh without triangles has no distance to anything; lower the threshold or reduction")
        yield
        corners = mesh.vertices[mesh.faces].astype(np.float64)  # (F, 3, 3)
        yield
        middle = corners.sum(axis=1) / 3.0
        yield
        code = yield from _morton(middle)
        yield
        self.order = np.argsort(code, kind="stable")
        yield
        corners = corners[self.order]
        yield
        self.corners = np.ascontiguousarray(corners.transpose(1, 2, 0))  # (corner, axis, F)
        # Levels of (low, high) from single triangles up to one box, (3, boxes) each.
        yield
        low = self.corners.min(axis=0)
        yield
        high = self.corners.max(axis=0)
        self.levels = [(low, high)]
        while low.shape[1] > 1:
            starts = np.arange(0, low.shape[1], BRANCH)
            low = np.minimum.reduceat(low, starts, axis=1)
            high = np.maximum.reduceat(high, starts, axis=1)
            self.levels.append((low, high))

    def distances(self, points: NDArray[Any], limit: float = np.inf) -> Doubles:
        """Distance from every point (n, 3) to the surface, (n,); inf where it is above the limit, which saves time."""
        places = np.ascontiguousarray(np.asarray(points, np.float64).reshape(-1, 3).T)  # (3, n)
        out = np.empty(places.shape[1])
        # Neighbours in space go down the same branches.
        order = np.argsort(finish(_morton(places.T)), kind="stable")
        for start in range(0, len(order), BLOCK):
            block = order[start : start + BLOCK]
            out[block] = np.sqrt(self.nearest(places[:, block], np.full(len(block), limit * limit))[0])
        return out

    def nearest(self, points: NDArray[Any], limits: Doubles) -> tuple[Doubles, NDArray[np.int64]]:
        """Squared distance from every point (3, n) to the nearest triangle, and which of `corners` that is.

        inf and 0 where it is above the point's own limit, which is squared too. Not for very many points at once.
        """
        best = limits.copy()  # no farther than this is the surface, squared
        point = np.arange(points.shape[1])
        box = np.zeros(len(point), np.int64)
        for low, high in self.levels[-2::-1]:
            if not len(point):
                break
            point = np.repeat(point, BRANCH)
            box = (box[:, None] * BRANCH + np.arange(BRANCH)).ravel()
            if low.shape[1] % BRANCH:
                there = box < low.shape[1]
                point, box = point[there], box[there]
            place = np.take(points, point, axis=1)
            below, above = np.take(low, box, axis=1) - place, place - np.take(high, box, axis=1)
            outside = np.maximum(np.maximum(below, above), 0.0)
            # Every side of a box touches a triangle in it: there is one within the farthest corner.
            inside = np.minimum(below, above)
            starts = _starts(point)
            some = point[starts]
            best[some] = np.minimum(best[some], np.minimum.reduceat(dot(inside, inside), starts))
            near = dot(outside, outside) <= best[point]
            point, box = point[near], box[near]
        squared, triangle = np.full(points.shape[1], np.inf), np.zeros(points.shape[1], np.int64)
        if len(point):
            a, b, c = (np.take(corner, box, axis=1) for corner in self.corners)
            found = squared_distances(np.take(points, point, axis=1), a, b, c)
            starts = _starts(point)
            squared[point[starts]] = np.minimum.reduceat(found, starts)
            hits = np.flatnonzero(found == squared[point])
            hits = hits[_starts(point[hits])]  # the first of equals
            triangle[point[hits]] = box[hits]
        squared[squared > limits] = np.inf
        return squared, triangle


def squared_distances(points: NDArray[Any], a: NDArray[Any], b: NDArray[Any], c: NDArray[Any]) -> NDArray[Any]:
    """Squared distance of every point to its own triangle abc, (n,); all arrays are (3, n).

    The nearest point is inside the triangle, and the distance that to its plane, or it is on an edge.
    """
    ab, bc, ca = b - a, c - b, a - c
    pa, pb, pc = points - a, points - b, points - c
    squared = _to_segment(pa, ab)
    np.minimum(squared, _to_segment(pb, bc), out=squared)
    np.minimum(squared, _to_segment(pc, ca), out=squared)
    normal = cross(ab, bc)
    inside = dot(cross(ab, pa), normal) >= 0
    inside &= dot(cross(bc, pb), normal) >= 0
    inside &= dot(cross(ca, pc), normal) >= 0
    size = dot(normal, normal)
    inside &= size > 0
    height = dot(pa, normal)
    return np.where(inside, height * height / np.where(inside, size, 1), squared)


def _to_segment(from_start: NDArray[Any], along: NDArray[Any]) -> NDArray[Any]:
    length = dot(along, along)
    share = dot(from_start, along) / np.where(length > 0, length, 1)
    apart = from_start - along * np.clip(share, 0, 1)
    return dot(apart, apart)


def _starts(sorted_numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where a new number begins, in numbers that never fall."""
    return np.flatnonzero(np.concatenate([[True], sorted_numbers[1:] != sorted_numbers[:-1]]))


def _morton(points: NDArray[Any]) -> Pauses[NDArray[np.uint64]]:
    """Place of every point (n, 3) on a curve through space that keeps neighbours together (Morton 1966)."""
    low = points.min(axis=0) if len(points) else np.zeros(3)
    extent = float((points - low).max()) if len(points) else 0.0
    yield
    cells = ((points - low) * (0x1FFFFF / (extent or 1.0))).astype(np.uint64)
    code = np.zeros(len(points), np.uint64)
    for axis in range(3):
        yield
        bits = cells[:, axis]
        # Two free bits between every two of the 21.
        for shift, mask in (
            (32, 0x1F00000000FFFF),
            (16, 0x1F0000FF0000FF),
            (8, 0x100F00F00F00F00F),
            (4, 0x10C30C30C30C30C3),
            (2, 0x1249249249249249),
        ):
            bits = (bits | bits << np.uint64(shift)) & np.uint64(mask)
        code |= bits << np.uint64(axis)
    return code
