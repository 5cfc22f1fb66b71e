"""How far two surfaces are from each other, exactly from point to surface, by Blender's tree of triangles.

The points: 20,000 on each surface, spread evenly by area with a fixed seed, for mean and maximum, and all vertices of
both for the maximum. Positions of both in one space; distances in its unit. Blender measures in float32; both surfaces
are moved to the middle first, which leaves an error of some 10^-7 of their extent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import MeshError, Step, Steps, TriangleMesh, finish
from ...core.mesh import SAMPLES, SEED, surface_samples

BLOCK = 20_000  # points between two steps


@dataclass(frozen=True)
class Deviation:
    """Distance between two surfaces, both ways, in their unit.

    Parameters
    ----------
    mean : float
        Mean of the two mean distances at the samples, from each surface to the other.
    maximum : float
        The largest distance at any sample or vertex of either.
    """

    mean: float
    maximum: float


class Reference:
    """A surface that others are measured against, its tree and samples made once."""

    def __init__(self, mesh: TriangleMesh, samples: int = SAMPLES, seed: int = SEED) -> None:
        self.mesh, self.samples, self.seed = mesh, samples, seed
        self.middle = middle_of(mesh)
        self.tree = tree_of(mesh, self.middle)
        self.points = surface_samples(mesh, samples, seed)

    def distances_steps(self, points: NDArray[Any]) -> Steps[NDArray[np.float64]]:
        """Distance of every point (n, 3) to the surface, (n,)."""
        return distances_steps(self.tree, points - self.middle)

    def deviation_steps(self, mesh: TriangleMesh) -> Steps[Deviation]:
        """How far `mesh` and this surface are apart."""
        if np.array_equal(mesh.vertices, self.mesh.vertices) and np.array_equal(mesh.faces, self.mesh.faces):
            return Deviation(0.0, 0.0)
        tree = tree_of(mesh, self.middle)
        means, most = [], []
        for here, there in ((mesh, self.tree), (self.mesh, tree)):
            points = self.points if here is self.mesh else surface_samples(here, self.samples, self.seed)
            sampled = yield from distances_steps(there, points - self.middle)
            at_vertices = yield from distances_steps(there, used_vertices(here) - self.middle)
            means.append(float(sampled.mean()))
            most += [float(sampled.max()), float(at_vertices.max())]
        return Deviation(sum(means) / 2, max(most))


def deviation(mesh: TriangleMesh, reference: TriangleMesh, samples: int = SAMPLES, seed: int = SEED) -> Deviation:
    """How far two surfaces are apart.

    Parameters
    ----------
    mesh, reference : TriangleMesh
        In one space.
    samples : int
        Points on each surface.

    Raises
    ------
    MeshError
        If one of them has no triangles.
    """
    return finish(Reference(reference, samples, seed).deviation_steps(mesh))


def middle_of(mesh: TriangleMesh) -> NDArray[np.float64]:
    """The middle of the box around a mesh's vertices, (3,)."""
    if not len(mesh.faces):
        raise MeshError("a mesh without triangles has no distance to anything; lower the threshold or reduction")
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    return (low.astype(np.float64) + high) / 2


def tree_of(mesh: TriangleMesh, middle: NDArray[np.float64]) -> Any:
    """Blender's tree of a mesh's triangles, positions relative to `middle`."""
    from mathutils.bvhtree import BVHTree

    faces: Sequence[Sequence[int]] = mesh.faces.tolist()
    return BVHTree.FromPolygons((mesh.vertices - middle).tolist(), faces, all_triangles=True)


def used_vertices(mesh: TriangleMesh) -> NDArray[np.float32]:
    """The vertices that some triangle has, (n, 3)."""
    used = np.zeros(len(mesh.vertices), bool)
    used[mesh.faces] = True
    return mesh.vertices[used]


def distances_steps(tree: Any, points: NDArray[Any]) -> Steps[NDArray[np.float64]]:
    """Distance of every point (n, 3) to the nearest triangle of a tree, (n,)."""
    out = np.empty(len(points))
    nearest = tree.find_nearest
    for start in range(0, len(points), BLOCK):
        block = points[start : start + BLOCK].tolist()
        out[start : start + len(block)] = [nearest(point)[3] for point in block]
        yield Step((start + len(block)) / len(points), "Measuring distances")
    return out
