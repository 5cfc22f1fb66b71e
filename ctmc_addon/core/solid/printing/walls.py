# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the walls of a part: how thin they are, and the share of the surface with thin walls.

The thickness at a point is the diameter of the largest ball inside that touches the surface there (maps/thickness.py).
It falls to 0 toward a sharp edge, which is not a wall to a print lab. A point belongs to a wall only if its ball meets
a surface that faces it: the two sides are parallel to within 30 degrees (`FACING`). So an edge of 30 degrees or more
does not count, and a sharper blade does.

A wall has an area, so a single sample decides nothing. The thinnest wall is the least thickness for which walls up to
it cover both sides of a square millimeter, or a thousandth of the surface if that is less.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...arrays import Doubles
from ...errors import MeshError
from ...machine.budget import Budget
from ...mesh.distance.surface_samples import surface_samples_steps
from ...mesh.distance.tangent_balls import TRIANGLE_SLOPE, TangentBalls
from ...mesh.triangle_mesh import TriangleMesh
from ...progress import Stages, Steps

FACING = -math.sqrt(0.75)  # The cosine of 150 degrees; the normals of facing sides are at least that far apart.
LEAST_MM2, LEAST_SHARE = 2.0, 0.001  # The area of the thinnest wall, both sides; the smaller of the two counts.
SAMPLES = 50_000  # Without a spacing, a surface has at least about this many samples.
MOST_SAMPLES = 300_000  # At most about this many samples are added to the vertices, even for thin walls.
MOST_MEASURED = 60_000  # Measure about this many samples, evenly spread.
BETWEEN = 2.0  # Triangles with an edge of more than this many spacings get samples inside.
SAME = 0.02  # A wall is below a limit if it is thinner by more than this share, twice the error of a ball.
BOX_MARGIN = 0.1  # Enlarge the box by this share, because normals are inexact.
STAGES = {"Sampling the surface": 1, "Measuring walls": 8}


@dataclass(frozen=True, eq=False)
class Walls:
    """The samples of a surface that belong to walls, thinnest first.

    Parameters
    ----------
    thickness : (n,) float64
        Millimeters, rising.
    areas : (n,) float64
        Area of each sample, mm2.
    area : float
        Area of the whole surface, mm2.
    thickest : float or None
        Diameter of the largest ball inside, mm; None if no ball is limited, as in an open surface.
    """

    thickness: Doubles
    areas: Doubles
    area: float
    thickest: float | None

    @property
    def thinnest(self) -> float | None:
        """The thinnest wall, mm; if no two sides face each other, as in a cube, the diameter of the largest ball."""
        enough = int(np.searchsorted(np.cumsum(self.areas), min(LEAST_MM2, LEAST_SHARE * self.area)))
        return float(self.thickness[enough]) if enough < len(self.thickness) else self.thickest

    def share_below(self, limit: float) -> float:
        """Return the share of the area with walls below a limit by more than `SAME`, 0 to 1."""
        count = int(np.searchsorted(self.thickness, limit * (1 - SAME)))
        return float(np.cumsum(self.areas[:count])[-1]) / self.area if count else 0.0


def walls_steps(mesh: TriangleMesh, budget: Budget, spacing: float | None = None) -> Steps[Walls]:
    """Measure the walls of a surface.

    Parameters
    ----------
    mesh : TriangleMesh
        RAS+ mm, with outward triangles.
    budget : Budget
    spacing : float, optional
        Distance between samples inside triangles, mm, such as that of the samples of the volume; at most about the
        thickness of the walls. By default it follows from the area.

    Raises
    ------
    MeshError
        For a mesh without triangles.
    """
    if not len(mesh.faces):
        raise MeshError("a part without triangles has no walls; lower the threshold, or cut somewhere else")
    sampling, measuring = STAGES
    stages = Stages(STAGES)
    wide, fine = (math.sqrt(mesh.area / count) for count in (SAMPLES, MOST_SAMPLES))
    longest = BETWEEN * (wide if spacing is None else max(spacing, fine))
    samples = yield from stages.run(sampling, surface_samples_steps(mesh, longest or 1.0, side=-1))
    tree, gap, areas = samples
    limit = float((mesh.vertices.max(axis=0) - mesh.vertices.min(axis=0)).min())
    balls = TangentBalls(tree, gap, limit * (1 + BOX_MARGIN) / 2, TRIANGLE_SLOPE)
    once = np.zeros(len(tree.order), np.bool_)
    once[samples.places] = True
    asked = once & (areas[tree.order] > 0) & tree.normals.any(axis=0)  # Some samples have no area.
    numbers = np.flatnonzero(asked)
    every = -(-len(numbers) // MOST_MEASURED) or 1
    asked[:] = False
    asked[numbers[::every]] = True  # Neighbors in the tree are neighbors in space.
    radii = yield from stages.run(measuring, balls.radii_steps(asked, budget.thread_count))
    places = np.flatnonzero(asked & ~np.isnan(radii))
    thickness = np.minimum(2 * radii[places], limit)
    wall = np.flatnonzero(balls.facing(places) <= FACING)
    order = wall[np.argsort(thickness[wall], kind="stable")]
    thickest = float(thickness.max()) if len(thickness) else None
    return Walls(thickness[order], every * areas[tree.order[places[order]]], mesh.area, thickest)
