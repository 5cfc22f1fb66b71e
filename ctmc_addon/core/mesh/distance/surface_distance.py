# SPDX-License-Identifier: GPL-3.0-or-later
"""How far two surfaces are from each other: the one estimator that panel, figures, experiments and report share.

Exact distances from points to triangles, both ways, between points spread evenly over each surface and, for the
largest, its vertices. Positions of both surfaces in one space; distances in its unit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...progress import PAUSE, Stages, Steps, equal_part, finish
from ..quality import surface_samples_steps
from ..triangle_mesh import TriangleMesh
from .triangle_tree import TriangleTree

STAGES = {"Preparing to measure distances": 1, "Measuring distances": 3}


@dataclass(frozen=True)
class SurfaceDistance:
    """Distance between two surfaces, both ways, in their unit.

    Parameters
    ----------
    mean : float
        Mean of the two mean distances at the samples, from each surface to the other.
    percentile_95 : float
        Distance within which 95 % of the samples of each surface stay: the larger of the two ways.
    largest : float
        The largest distance at any sample or vertex of either.
    """

    mean: float
    percentile_95: float
    largest: float


class ReferenceSurface:
    """A surface to measure other surfaces against; its tree and samples are made once, at first use."""

    def __init__(self, mesh: TriangleMesh) -> None:
        self.mesh = mesh
        self._tree: TriangleTree | None = None
        self._samples: NDArray[np.float64] | None = None

    def tree_steps(self) -> Steps[TriangleTree]:
        """The triangles, ready for questions about distance."""
        if self._tree is None:
            tree = TriangleTree()
            yield from tree.prepare_steps(self.mesh)
            self._tree = tree
        return self._tree

    def samples_steps(self) -> Steps[NDArray[np.float64]]:
        """Points spread evenly over the surface, (SAMPLES, 3)."""
        if self._samples is None:
            self._samples = yield from surface_samples_steps(self.mesh)
        return self._samples

    def vertices(self) -> NDArray[np.float32]:
        """The vertices that some triangle has, (n, 3)."""
        used = np.zeros(len(self.mesh.vertices), bool)
        used[self.mesh.faces] = True
        return self.mesh.vertices[used]


def surface_distance(mesh: TriangleMesh, reference: TriangleMesh) -> SurfaceDistance:
    """Measure the distance between two surfaces.

    Parameters
    ----------
    mesh, reference : TriangleMesh
        In one space.

    Raises
    ------
    MeshError
        If one of them has no triangles.

    Examples
    --------
    >>> square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    >>> faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    >>> above = TriangleMesh(square + np.float32([0, 0, 2]), faces)
    >>> surface_distance(above, TriangleMesh(square, faces))
    SurfaceDistance(mean=2.0, percentile_95=2.0, largest=2.0)
    """
    return finish(surface_distance_steps(mesh, ReferenceSurface(reference)))


def surface_distance_steps(
    mesh: TriangleMesh, reference: ReferenceSurface, threads: int | None = None
) -> Steps[SurfaceDistance]:
    """`surface_distance` as steps, with `threads` threads, by default one for each processor."""
    if np.array_equal(mesh.vertices, reference.mesh.vertices) and np.array_equal(mesh.faces, reference.mesh.faces):
        return SurfaceDistance(0.0, 0.0, 0.0)
    preparing, measuring = STAGES
    stages = Stages(STAGES)
    surfaces = (ReferenceSurface(mesh), reference)
    yield from stages.run(preparing, _prepare_steps(surfaces))
    return (yield from stages.run(measuring, _both_ways_steps(surfaces, threads)))


def vertex_distances_steps(
    mesh: TriangleMesh, reference: ReferenceSurface, threads: int | None = None
) -> Steps[NDArray[np.float64]]:
    """Distance of every vertex of a mesh to the reference, (V,) float64, as steps."""
    preparing, measuring = STAGES
    stages = Stages(STAGES)
    tree = yield from stages.run(preparing, reference.tree_steps())
    return (yield from stages.run(measuring, tree.distances_steps(mesh.vertices, threads=threads)))


def _prepare_steps(surfaces: tuple[ReferenceSurface, ReferenceSurface]) -> Steps[None]:
    for surface in surfaces:
        yield from surface.tree_steps()
        yield from surface.samples_steps()


def _both_ways_steps(
    surfaces: tuple[ReferenceSurface, ReferenceSurface], threads: int | None
) -> Steps[SurfaceDistance]:
    means, percentiles, largest = [], [], 0.0
    for number, (here, there) in enumerate((surfaces, surfaces[::-1])):
        tree, samples = (yield from there.tree_steps()), (yield from here.samples_steps())
        sampled = yield from equal_part(tree.distances_steps(samples, threads=threads), 2 * number, 4)
        means.append(float(sampled.mean()))
        percentiles.append(float(np.percentile(sampled, 95)))
        largest = max(largest, float(sampled.max()))
        yield PAUSE._replace(fraction=(2 * number + 1) / 4)
        at_vertices = tree.largest_steps(here.vertices(), largest, threads)
        largest = yield from equal_part(at_vertices, 2 * number + 1, 4)
    return SurfaceDistance(sum(means) / 2, max(percentiles), largest)
