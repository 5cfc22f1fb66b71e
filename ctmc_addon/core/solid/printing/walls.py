# SPDX-License-Identifier: GPL-3.0-or-later
"""Walls of a part: how thin they are, and how much of the surface has thin ones.

The thickness at a place is the diameter of the largest ball inside that touches the surface there (maps/thickness.py).
Toward a sharp edge it falls to 0, which no print lab calls a wall. A place belongs to a wall only where its ball meets
a surface that faces it: the two sides are parallel to within 30 degrees (`FACING`). So edges of 30 degrees and more do
not count, and a blade that is sharper does.

A wall has an area, so a single sample decides nothing: the thinnest wall is the least thickness at which the walls that
are not thicker cover the two sides of a square millimeter, or a thousandth of the surface where that is less.
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

FACING = -math.sqrt(0.75)  # The cosine of 150 degrees between the normals of both sides.
LEAST_MM2, LEAST_SHARE = 2.0, 0.001  # The area of the thinnest wall, both sides; the lesser of both counts.
SAMPLES = 50_000  # Without a spacing, a surface has at least about so many samples.
MOST_SAMPLES = 300_000  # However thin the walls are that are looked for, about so many are added to the vertices.
MOST_ASKED = 60_000  # Measure about so many of them, evenly.
BETWEEN = 2.0  # Triangles with an edge of more than this many spacings have samples of their own.
SAME = 0.02  # A wall is below a limit if it is thinner by more than this share, twice the error of a ball.
BOX_MARGIN = 0.1  # for normals that are not quite right
STAGES = {"Sampling the surface": 1, "Measuring walls": 8}


@dataclass(frozen=True, eq=False)
class Walls:
    """Samples of a surface that belong to walls, the thinnest first.

    Parameters
    ----------
    thickness : (n,) float64
        Millimeters, rising.
    areas : (n,) float64
        Area of each sample, mm2.
    area : float
        Area of the whole surface, mm2.
    thickest : float or None
        The largest ball inside, mm; None where nothing limits any, as in an open surface.
    """

    thickness: Doubles
    areas: Doubles
    area: float
    thickest: float | None

    @property
    def thinnest(self) -> float | None:
        """The thinnest wall, mm; that of the largest ball where no two sides face each other, as in a cube."""
        enough = int(np.searchsorted(np.cumsum(self.areas), min(LEAST_MM2, LEAST_SHARE * self.area)))
        return float(self.thickness[enough]) if enough < len(self.thickness) else self.thickest

    def share_below(self, limit: float) -> float:
        """Return the share of the area with walls thinner than a limit by more than `SAME`, 0 to 1."""
        count = int(np.searchsorted(self.thickness, limit * (1 - SAME)))
        return float(np.cumsum(self.areas[:count])[-1]) / self.area if count else 0.0


def walls_steps(mesh: TriangleMesh, budget: Budget, spacing: float | None = None) -> Steps[Walls]:
    """Measure the walls of a surface.

    Parameters
    ----------
    mesh : TriangleMesh
        RAS+ mm, its triangles outward.
    budget : Budget
    spacing : float, optional
        How far samples within its triangles are apart, mm, such as the spacing of what it was made from; at most about
        as far as the walls are thin. By default by its area.

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
    asked = once & (areas[tree.order] > 0) & tree.normals.any(axis=0)  # Some samples stand for no area.
    numbers = np.flatnonzero(asked)
    every = -(-len(numbers) // MOST_ASKED) or 1
    asked[:] = False
    asked[numbers[::every]] = True  # Neighbors in the tree are neighbors in space.
    radii = yield from stages.run(measuring, balls.radii_steps(asked, budget.thread_count))
    places = np.flatnonzero(asked & ~np.isnan(radii))
    thickness = np.minimum(2 * radii[places], limit)
    wall = np.flatnonzero(balls.facing(places) <= FACING)
    order = wall[np.argsort(thickness[wall], kind="stable")]
    thickest = float(thickness.max()) if len(thickness) else None
    return Walls(thickness[order], every * areas[tree.order[places[order]]], mesh.area, thickest)
