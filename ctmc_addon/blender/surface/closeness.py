"""How far a simplified surface is from the full one, in steps short enough to stop at any moment.

Measured both ways between points of the two surfaces, by Blender's trees of triangles, one for every block of faces:
extraction numbers faces slab by slab, so blocks lie apart and most points ask one tree. Lengths in the meshes' unit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mathutils.bvhtree import BVHTree
from numpy.typing import NDArray

from ...core import MeshError, Step, Steps, TriangleMesh, within

BLOCK = 1 << 13  # faces in a tree
POINTS = 10_000  # on each surface
ASKED = 500  # points between two steps
MESSAGE = "Measuring the distance to the full surface"


@dataclass(frozen=True)
class Closeness:
    """Mean (of the two ways, by area) and largest distance found."""

    mean: float
    maximum: float


class Trees:
    """The triangles of a mesh, ready to be asked for distances."""

    def __init__(self, middle: NDArray[np.float64]) -> None:
        self.middle = middle
        self.trees: list[BVHTree] = []
        self.low = np.empty((0, 3))
        self.high = np.empty((0, 3))

    def add_steps(self, mesh: TriangleMesh) -> Steps[None]:
        """Take in a mesh block by block."""
        lows, highs = [], []
        for start in range(0, len(mesh.faces), BLOCK):
            faces = mesh.faces[start : start + BLOCK]
            used, inverse = np.unique(faces, return_inverse=True)
            points = mesh.vertices[used] - self.middle
            corners = inverse.reshape(-1, 3)
            self.trees.append(BVHTree.FromPolygons(points.tolist(), corners.tolist(), all_triangles=True))
            lows.append(points.min(axis=0))
            highs.append(points.max(axis=0))
            yield Step((start + len(faces)) / len(mesh.faces), MESSAGE)
        self.low, self.high = np.array(lows), np.array(highs)

    def distances_steps(self, points: NDArray[np.float64]) -> Steps[NDArray[np.float64]]:
        """Distance of every point (n, 3) to the nearest triangle, (n,)."""
        best = np.empty(len(points))
        for start in range(0, len(points), ASKED):
            for at, point in enumerate(points[start : start + ASKED] - self.middle, start):
                best[at] = self.distance(point)
            yield Step(min(1.0, (start + ASKED) / len(points)), MESSAGE)
        return best

    def distance(self, point: NDArray[np.float64]) -> float:
        """Distance of one point, relative to the middle: trees whose box is farther than the best are not asked."""
        outside = np.maximum(np.maximum(self.low - point, point - self.high), 0.0)
        boxes = np.sqrt((outside**2).sum(axis=1))
        best = np.inf
        for number in np.argsort(boxes, kind="stable"):
            if boxes[number] >= best:
                break
            best = min(best, self.trees[number].find_nearest(point)[3])
        return float(best)


def closeness_steps(mesh: TriangleMesh, full: TriangleMesh) -> Steps[Closeness]:
    """How far `mesh` is from `full`; both in one space."""
    if not len(mesh.faces) or not len(full.faces):
        raise MeshError("a mesh without triangles has no distance to anything; lower the threshold or reduction")
    middle = middle_of(full)
    means, most = [], []
    for number, (asks, answers) in enumerate(((mesh, full), (full, mesh))):
        trees = Trees(middle)
        yield from within(trees.add_steps(answers), 0.5 * number, 0.5 * number + 0.25)
        points, shares = spread(asks)
        found = yield from within(trees.distances_steps(points), 0.5 * number + 0.25, 0.5 * number + 0.5)
        means.append(float((found * shares).sum() / shares.sum()))
        most.append(float(found.max()))
    return Closeness(sum(means) / 2, max(most))


def middle_of(mesh: TriangleMesh) -> NDArray[np.float64]:
    """The middle of the box around a mesh's vertices, (3,): positions relative to it lose least in float32."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    return np.asarray((low.astype(np.float64) + high) / 2)


def spread(mesh: TriangleMesh, count: int = POINTS) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points spread over a mesh's faces, (n, 3), at their corners and middles in turn, and the area each stands for."""
    every = max(1, len(mesh.faces) // count)
    corners = mesh.vertices[mesh.faces[every // 2 :: every]].astype(np.float64)  # (n, 3, 3)
    area = 0.5 * np.sqrt((np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) ** 2).sum(axis=1))
    points = corners.mean(axis=1)
    points[::2] = corners[::2, 0]
    return points, area
