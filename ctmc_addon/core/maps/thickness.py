# SPDX-License-Identifier: GPL-3.0-or-later
"""Thickness of walls and width of gaps: the largest ball that touches the surface, inside or outside.

Flat triangles are as good as the surface between vertices that lie close; larger ones get samples of their own, so
that a simplified surface has the same map.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..arrays import Floats
from ..errors import MeshError, SettingsError
from ..mesh.distance.patch_tree import PatchTree
from ..mesh.distance.tangent_balls import SLOPE, TRIANGLE_SLOPE, TangentBalls
from ..mesh.face_normals import face_vectors, sphere_normals_steps
from ..mesh.topology import FACES_PER_STEP
from ..mesh.triangle_mesh import TriangleMesh
from ..mesh.vectors import dot
from ..progress import PAUSE, Stages, Steps
from .quantity import MappedSurface, MapValues, Quantity

GAP_UP_TO_MM = 50.0
BETWEEN = 2.0  # Samples stand in triangles whose longest edge is more than this many voxels.
MOST_SPLITS = 64  # of an edge
BOX_MARGIN = 0.1  # for normals that are not quite right
STAGES = {"Sampling the surface": 1, "Measuring balls": 8}


@dataclass(frozen=True)
class Thickness(Quantity):
    """Wall thickness at every vertex, mm: the diameter of the largest ball inside that touches the surface there.

    NaN where nothing limits the ball, which only an open surface has.

    Examples
    --------
    >>> Thickness().name, Thickness().unit
    ('thickness_mm', 'mm')
    """

    flag = "thickness"
    text = "Wall thickness: the diameter of the largest ball inside that touches the surface"
    label = "Thickness"

    @property
    def name(self) -> str:
        """The name of the map."""
        return "thickness_mm"

    def values_steps(self, surface: MappedSurface) -> Steps[MapValues]:
        """Work the values out."""
        values = yield from _diameters_steps(surface, -1, np.inf)
        return MapValues(values)


@dataclass(frozen=True)
class Gap(Quantity):
    """Gap at every vertex, mm: the diameter of the largest ball outside that touches the surface there.

    Parameters
    ----------
    up_to_mm : float
        Wider gaps are NaN.

    Examples
    --------
    >>> Gap(up_to_mm=0)
    Traceback (most recent call last):
    ...
    ctmc_addon.core.errors.SettingsError: the widest gap must be above 0 mm, not 0; 50 mm is usual
    """

    up_to_mm: float = GAP_UP_TO_MM

    flag = "gap"
    text = f"Width of gaps up to {GAP_UP_TO_MM:g} mm: the diameter of the largest ball outside that touches the surface"
    label = "Gap"

    def __post_init__(self) -> None:
        if not 0 < self.up_to_mm < np.inf:
            raise SettingsError(
                f"the widest gap must be above 0 mm, not {self.up_to_mm:g}; {GAP_UP_TO_MM:g} mm is usual"
            )

    @property
    def name(self) -> str:
        """The name of the map."""
        return "gap_mm"

    def values_steps(self, surface: MappedSurface) -> Steps[MapValues]:
        """Work the values out."""
        values = yield from _diameters_steps(surface, 1, self.up_to_mm)
        note = f"Gaps wider than {self.up_to_mm:g} mm have no value."
        return MapValues(values, notes=(note,) if np.isnan(values).any() else ())


def _diameters_steps(surface: MappedSurface, side: int, limit: float) -> Steps[Floats]:
    """Return the diameter of the ball at every vertex, (V,) float32, outside for side 1 and inside for -1.

    Parameters
    ----------
    surface : MappedSurface
    side : int
    limit : float
        Diameter up to which to look, mm; infinite for what fits into the box of the surface.
    """
    mesh = surface.mesh
    if not len(mesh.faces):
        raise MeshError(
            "a mesh without triangles has no thickness or gap; lower the threshold or the share of triangles to remove"
        )
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    search = limit
    if math.isinf(limit):  # what fits into the box of the surface
        limit = float((high - low).min())
        search = limit * (1 + BOX_MARGIN)
    sampling, measuring = STAGES
    stages = Stages(STAGES)
    voxel = sum(surface.volume.spacing) / 3
    normals = _normals_of_field(surface)
    slope = TRIANGLE_SLOPE if normals is None else SLOPE
    tree, gap = yield from stages.run(sampling, _tree_steps(mesh, normals, side, BETWEEN * voxel))
    count = len(mesh.vertices)
    asked = (tree.order < count) & tree.normals.any(axis=0)
    threads = surface.budget.thread_count
    radii = yield from stages.run(measuring, TangentBalls(tree, gap, search / 2, slope).radii_steps(asked, threads))
    values = np.full(count, np.nan, np.float32)
    values[tree.order[asked]] = 2 * radii[asked]
    return np.minimum(values, np.float32(limit))  # NaN stays


def _normals_of_field(surface: MappedSurface) -> Floats | None:
    """Return the normals of the mesh if they are those of its field; means of triangles are made here, better ones."""
    settings = surface.settings
    shares = settings.label is not None and settings.interfaces == "shared"
    averaged = settings.normals == "mesh" or settings.simplifies or shares
    return None if averaged else surface.mesh.normals


def _tree_steps(
    mesh: TriangleMesh, normals: Floats | None, side: int, longest: float
) -> Steps[tuple[PatchTree, float]]:
    """Return samples of a surface, its vertices first, and their usual distance; normals point to `side`."""
    if normals is None:
        normals = yield from sphere_normals_steps(mesh.vertices, mesh.faces)
    positions, directions, area = [mesh.vertices], [normals], 0.0
    for start in range(0, len(mesh.faces), FACES_PER_STEP):
        faces = mesh.faces[start : start + FACES_PER_STEP]
        vectors = face_vectors(mesh.vertices, faces)
        lengths = np.sqrt(vectors[:, 0] ** 2 + vectors[:, 1] ** 2 + vectors[:, 2] ** 2)
        area += float(np.cumsum(lengths)[-1]) / 2  # cumsum adds one after the other: the same bits everywhere
        corners = [mesh.vertices[faces[:, corner]].T.astype(np.float64) for corner in range(3)]
        edges = [corners[(corner + 1) % 3] - corners[corner] for corner in range(3)]
        most = np.sqrt(
            np.maximum(np.maximum(dot(edges[0], edges[0]), dot(edges[1], edges[1])), dot(edges[2], edges[2]))
        )
        splits = np.minimum(np.ceil(most / longest), MOST_SPLITS).astype(np.int64)
        splits[lengths == 0] = 1
        for number in np.unique(splits[splits > 1]).tolist():
            of = np.flatnonzero(splits == number)
            a, b, c = (corner[:, of] for corner in corners)
            normal = (vectors[of] / lengths[of, None]).astype(np.float32)
            for u, v in _middles_of_splits(number):
                positions.append((a + (b - a) * u + (c - a) * v).T.astype(np.float32))
                directions.append(normal)
        yield PAUSE
    samples = np.concatenate(positions)
    tree = PatchTree()
    yield from tree.prepare_steps(samples, np.concatenate(directions) * np.float32(side))
    return tree, math.sqrt(area / len(samples))


def _middles_of_splits(number: int) -> Iterator[tuple[float, float]]:
    """Yield the middles of the triangles that a triangle is cut into at `number` parts of its edges, as shares."""
    for i in range(number):
        for j in range(number - i):
            yield (i + 1 / 3) / number, (j + 1 / 3) / number
            if i + j < number - 1:
                yield (i + 2 / 3) / number, (j + 2 / 3) / number
