# SPDX-License-Identifier: GPL-3.0-or-later
"""A distance map on a surface: every point in the color of its distance to another surface.

The surface is first cut into triangles no larger than the other's, or the inside of a large triangle, which is where a
coarse surface is wrong, would show what its corners have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core import PAUSE, Steps, TriangleMesh
from ...core.maps import step_up
from ...core.mesh import ReferenceSurface, mean_longest_edge_steps, subdivided_steps, vertex_distances_steps
from .spec import ColorScale

DISTANCE = "deviation_mm"  # Vertex attribute that the map shows.
DISTANCE_RAMP = "light"  # What is right is light, and large errors stand out, to the color-blind too.


@dataclass(frozen=True)
class DistanceMap:
    """A finely cut surface with the distance of every vertex, mm."""

    mesh: TriangleMesh
    distances_mm: NDArray[np.float64]


def distance_map_steps(
    mesh: TriangleMesh, reference: ReferenceSurface, threads: int | None = None
) -> Steps[DistanceMap]:
    """Measure the distance of a surface to another, at the vertices of its triangles and of their subdivisions.

    Parameters
    ----------
    mesh : TriangleMesh
    reference : ReferenceSurface
    threads : int, optional
        By default one for each processor, at most 8.
    """
    yield PAUSE
    length = yield from mean_longest_edge_steps(reference.mesh)
    fine = yield from subdivided_steps(mesh, length)
    distances = yield from vertex_distances_steps(fine, reference, threads)
    return DistanceMap(fine, distances)


def color_scale(maps: Sequence[DistanceMap], limit_mm: float | None = None) -> ColorScale:
    """Return colors for several surfaces, which share the scale.

    Parameters
    ----------
    maps : sequence of DistanceMap
    limit_mm : float, optional
        Distance at which the colors end; by default the 99th percentile of the distances, rounded up.
    """
    every = np.concatenate([distance_map.distances_mm for distance_map in maps])
    most = float(every.max())
    if limit_mm is None:
        limit_mm = step_up(float(np.percentile(every, 99))) if most > 1e-6 else 1.0
    beyond = bool(most > limit_mm * (1 + 1e-6))
    return ColorScale(DISTANCE, "distance", "mm", (0.0, limit_mm), DISTANCE_RAMP, above=beyond)
