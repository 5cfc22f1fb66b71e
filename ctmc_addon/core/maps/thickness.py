# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the thickness of walls and the width of gaps by the largest ball that touches the surface inside or outside.

Small triangles need only their vertices; larger ones get samples inside, so that a simplified surface has the same map.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..arrays import Floats
from ..errors import MeshError, SettingsError
from ..measures.units import mm_text
from ..mesh.distance.surface_samples import surface_samples_steps
from ..mesh.distance.tangent_balls import SLOPE, TRIANGLE_SLOPE, TangentBalls
from ..progress import Stages, Steps
from .quantity import MappedSurface, MapValues, Quantity

GAP_UP_TO_MM = 50.0
BETWEEN = 2.0  # Triangles with a longest edge of more than this many voxels get samples inside.
BOX_MARGIN = 0.1  # Enlarge the box by this share, because normals are inexact.
STAGES = {"Sampling the surface": 1, "Fitting balls": 8}


@dataclass(frozen=True)
class Thickness(Quantity):
    """Wall thickness at every vertex, mm: the diameter of the largest ball inside that touches the surface there.

    NaN if nothing limits the ball, which occurs only in an open surface.

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
        Wider gaps become NaN.

    Examples
    --------
    >>> Gap(up_to_mm=0)
    Traceback (most recent call last):
    ...
    ctmc_addon.core.errors.SettingsError: the widest gap must be above 0 mm, not 0; 50 mm is usual
    """

    up_to_mm: float = GAP_UP_TO_MM

    flag = "gap"
    text = (
        f"Width of gaps up to {mm_text(GAP_UP_TO_MM)}: the diameter of the largest ball outside that touches the "
        "surface"
    )
    label = "Gap"

    def __post_init__(self) -> None:
        if not 0 < self.up_to_mm < np.inf:
            raise SettingsError(
                f"the widest gap must be above 0 mm, not {self.up_to_mm:g}; {mm_text(GAP_UP_TO_MM)} is usual"
            )

    @property
    def name(self) -> str:
        """The name of the map."""
        return "gap_mm"

    def values_steps(self, surface: MappedSurface) -> Steps[MapValues]:
        """Work the values out."""
        values = yield from _diameters_steps(surface, 1, self.up_to_mm)
        note = f"Gaps wider than {mm_text(self.up_to_mm)} have no value."
        return MapValues(values, notes=(note,) if np.isnan(values).any() else ())


def _diameters_steps(surface: MappedSurface, side: int, limit: float) -> Steps[Floats]:
    """Return the diameter of the ball at every vertex, (V,) float32: outside for side 1, inside for side -1.

    Parameters
    ----------
    surface : MappedSurface
    side : int
    limit : float
        Largest diameter, mm; if infinite, the diagonal of the box around the surface.
    """
    mesh = surface.mesh
    if not len(mesh.faces):
        raise MeshError(
            "a mesh without triangles has no thickness or gap; lower the threshold or the share of triangles to remove"
        )
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    search = limit
    if math.isinf(limit):  # The largest ball that fits into the box of the surface.
        limit = float((high - low).min())
        search = limit * (1 + BOX_MARGIN)
    sampling, measuring = STAGES
    stages = Stages(STAGES)
    voxel = sum(surface.volume.spacing) / 3
    normals = _normals_of_field(surface)
    slope = TRIANGLE_SLOPE if normals is None else SLOPE
    sampled = surface_samples_steps(mesh, BETWEEN * voxel, normals, side)
    tree, gap, _ = yield from stages.run(sampling, sampled)
    count = len(mesh.vertices)
    at_vertex = (tree.order < count) & tree.normals.any(axis=0)
    threads = surface.budget.thread_count
    radii = yield from stages.run(measuring, TangentBalls(tree, gap, search / 2, slope).radii_steps(at_vertex, threads))
    values = np.full(count, np.nan, np.float32)
    values[tree.order[at_vertex]] = 2 * radii[at_vertex]
    return np.minimum(values, np.float32(limit))  # NaN stays NaN.


def _normals_of_field(surface: MappedSurface) -> Floats | None:
    """Return the normals of the mesh if they come from its field; None to let the balls average those of triangles."""
    settings = surface.settings
    shares = settings.label is not None and settings.interfaces == "shared"
    averaged = settings.normals == "mesh" or settings.simplifies or shares
    return None if averaged else surface.mesh.normals
