# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure how far two surfaces are from each other, for panel, figures, experiments and report alike.

Exact distances from points to triangles, both ways, between points spread evenly over each surface and, for the
largest, its vertices. Components of the full surface that the other has lost are left out and named separately: their
distance is that to the next component, wherever it is. Positions of both surfaces in one space; distances in its unit.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags, Ints
from ...progress import PAUSE, Stages, Steps, equal_part, finish
from ..measures import component_volumes_steps
from ..quality import surface_samples_steps
from ..topology import component_numbers_steps
from ..triangle_mesh import TriangleMesh
from .lost_components import lost_components_steps
from .triangle_tree import TriangleTree

STAGES = {"Preparing to measure distances": 1, "Measuring distances": 3}


@dataclass(frozen=True)
class OneWayDistance:
    """Distance of the points of one surface to another, in their unit.

    Parameters
    ----------
    mean : float
        At the samples.
    percentile_95 : float
        95 % of the samples stay within it.
    largest : float
        At any sample or vertex.
    """

    mean: float = 0.0
    percentile_95: float = 0.0
    largest: float = 0.0


@dataclass(frozen=True)
class LostComponents:
    """Components of the full surface that another no longer has.

    Parameters
    ----------
    count : int
        Cavities among them.
    volume : float
        What they enclose, cavities too, in the cube of the unit.
    largest : float
        The largest distance of one of their vertices to the other surface.
    """

    count: int = 0
    volume: float = 0.0
    largest: float = 0.0


@dataclass(frozen=True)
class SurfaceDistance:
    """Distance between a surface and the full one, both ways, in their unit.

    Parameters
    ----------
    to_full : OneWayDistance
        From the surface to the full one.
    from_full : OneWayDistance
        From those components of the full surface that are still there.
    lost : LostComponents
        Components of the full surface that are lost.
    """

    to_full: OneWayDistance = field(default_factory=OneWayDistance)
    from_full: OneWayDistance = field(default_factory=OneWayDistance)
    lost: LostComponents = field(default_factory=LostComponents)

    @property
    def mean(self) -> float:
        """Mean of the two means."""
        return (self.to_full.mean + self.from_full.mean) / 2

    @property
    def percentile_95(self) -> float:
        """Distance within which 95 % of the samples of each surface stay: the larger of the two ways."""
        return max(self.to_full.percentile_95, self.from_full.percentile_95)

    @property
    def largest(self) -> float:
        """The larger of the two ways."""
        return max(self.to_full.largest, self.from_full.largest)


class ReferenceSurface:
    """A surface to measure other surfaces against; its tree and samples are made once, at first use."""

    def __init__(self, mesh: TriangleMesh) -> None:
        self.mesh = mesh
        self._tree: TriangleTree | None = None
        self._samples: NDArray[np.float64] | None = None
        self._component: Ints | None = None

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

    def component_steps(self) -> Steps[Ints]:
        """The component of every face, (F,) int32."""
        if self._component is None:
            self._component = yield from component_numbers_steps(self.mesh.faces, len(self.mesh.vertices))
        return self._component

    def vertices(self) -> NDArray[np.float32]:
        """The vertices that some triangle has, (n, 3)."""
        used = np.zeros(len(self.mesh.vertices), bool)
        used[self.mesh.faces] = True
        return self.mesh.vertices[used]


def surface_distance(mesh: TriangleMesh, reference: TriangleMesh) -> SurfaceDistance:
    """Measure the distance between a surface and the full one that it was made from.

    Parameters
    ----------
    mesh, reference : TriangleMesh
        In one space; the reference is the full one.

    Raises
    ------
    MeshError
        If one of them has no triangles.

    Examples
    --------
    >>> square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    >>> faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    >>> above = TriangleMesh(square + np.float32([0, 0, 2]), faces)
    >>> surface_distance(above, TriangleMesh(square, faces)).to_full
    OneWayDistance(mean=2.0, percentile_95=2.0, largest=2.0)
    """
    return finish(surface_distance_steps(mesh, ReferenceSurface(reference)))


def surface_distance_steps(
    mesh: TriangleMesh, reference: ReferenceSurface, threads: int | None = None
) -> Steps[SurfaceDistance]:
    """`surface_distance` as steps, with `threads` threads, by default one for each processor."""
    if np.array_equal(mesh.vertices, reference.mesh.vertices) and np.array_equal(mesh.faces, reference.mesh.faces):
        return SurfaceDistance()
    preparing, measuring = STAGES
    stages = Stages(STAGES)
    surface = ReferenceSurface(mesh)
    lost_faces, lost = yield from stages.run(preparing, _prepare_steps(surface, reference))
    return (yield from stages.run(measuring, _both_ways_steps(surface, reference, lost_faces, lost, threads)))


def vertex_distances_steps(
    mesh: TriangleMesh, reference: ReferenceSurface, threads: int | None = None
) -> Steps[NDArray[np.float64]]:
    """Distance of every vertex of a mesh to the reference, (V,) float64, as steps."""
    preparing, measuring = STAGES
    stages = Stages(STAGES)
    tree = yield from stages.run(preparing, reference.tree_steps())
    return (yield from stages.run(measuring, tree.distances_steps(mesh.vertices, threads=threads)))


def _prepare_steps(surface: ReferenceSurface, full: ReferenceSurface) -> Steps[tuple[Flags, LostComponents]]:
    """Return which faces of the full surface, (F,), belong to lost components, and these without their distance."""
    for each in (surface, full):
        yield from each.tree_steps()
    component = yield from full.component_steps()
    lost = yield from lost_components_steps(surface.mesh, (yield from full.tree_steps()), component)
    if not lost.any():
        return np.zeros(len(component), bool), LostComponents()
    volumes = yield from component_volumes_steps(full.mesh.vertices, full.mesh.faces, component)
    return lost[component], LostComponents(int(lost.sum()), float(np.abs(volumes[lost]).sum()))


def _both_ways_steps(
    surface: ReferenceSurface, full: ReferenceSurface, lost_faces: Flags, lost: LostComponents, threads: int | None
) -> Steps[SurfaceDistance]:
    ways = []
    kept = full if not lost.count else ReferenceSurface(TriangleMesh(full.mesh.vertices, full.mesh.faces[~lost_faces]))
    for number, (points, there) in enumerate(((surface, full), (kept, surface))):
        tree, samples = (yield from there.tree_steps()), (yield from points.samples_steps())
        sampled = yield from equal_part(tree.distances_steps(samples, threads=threads), 2 * number, 4)
        yield PAUSE._replace(fraction=(2 * number + 1) / 4)
        at_vertices = tree.largest_steps(points.vertices(), float(sampled.max()), threads)
        largest = yield from equal_part(at_vertices, 2 * number + 1, 4)
        ways.append(OneWayDistance(float(sampled.mean()), float(np.percentile(sampled, 95)), largest))
    if lost.count:
        lost_surface = ReferenceSurface(TriangleMesh(full.mesh.vertices, full.mesh.faces[lost_faces]))
        tree = yield from surface.tree_steps()
        farthest = yield from tree.largest_steps(lost_surface.vertices(), threads=threads)
        lost = replace(lost, largest=farthest)
    to_full, from_full = ways
    return SurfaceDistance(to_full, from_full, lost)
