# SPDX-License-Identifier: GPL-3.0-or-later
"""Find walls thinner than a least thickness, and make the shape that thickens only these walls to it.

The middle of a thin wall consists of the centers of balls that touch both sides (mesh/distance/tangent_balls.py). If
all corners of a triangle lie on thin walls, their centers form a triangle of the middle; each other center is a point
of it. The shape is everything within half of the least thickness of the middle. A plate gets exactly the least
thickness; a bar gets it as diameter, plus up to a tenth of its own where normals are off. Where a wall is thick enough,
the shape ends inside it.

A ball near an edge is small too. It belongs to a wall only if it meets a surface that faces it (walls.py), or if its
far end lies as near to the surface as it would between two facing sides, because a ball in a round bar may meet any
side. So the edges of a box are not walls, and a blade below 30 degrees is one.

Distances are in mm, positive inside; points are (3, n) float64, RAS+ mm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...arrays import Doubles, Flags
from ...machine.parallel import worker_count
from ...measures.units import mm_text
from ...mesh.distance.surface_samples import SurfaceSamples, surface_samples_steps
from ...mesh.distance.tangent_balls import TRIANGLE_SLOPE, TangentBalls
from ...mesh.distance.triangle_tree import BLOCK, TriangleTree
from ...mesh.topology import compacted
from ...mesh.triangle_mesh import TriangleMesh
from ...progress import PAUSE, Stages, Steps, equal_part
from ..fields.shapes import Box, Plane
from ..printing.walls import FACING, LEAST_MM2, LEAST_SHARE, MOST_SAMPLES, SAME
from ..request import Point
from .near_cells import NearCells, near_cells_steps
from .rounding import place_text

BETWEEN = 2.0  # Triangles whose longest edge exceeds this many spacings get samples inside.
PER_WALL = 1 / 3  # In a repeated search, samples are closer: an edge is at most this share of the wall.
MORE = 1 / 8  # Each repetition adds this share of a spacing on either side, which chords of the lattice cut off.
SEARCHED = 1.05  # Search for balls with diameters up to this share of the least wall.
EMPTY = 0.7  # A ball whose center is nearer to the surface than this share of its radius lies at a rim.
FAR = 2.0  # Points farther outside than this many spacings count as that far away.
STAGES = {"Sampling the surface": 1, "Measuring walls": 8, "Preparing the middle of walls": 1}


@dataclass(frozen=True)
class Thickening:
    """The shape within a radius of the middle of thin walls.

    Parameters
    ----------
    middle : TriangleTree
        Triangles, some of which are points.
    radius : float
        Half of the least wall.
    cells : NearCells
        Points outside these cubes count as one side of a cube away from the middle, which saves time.
    """

    middle: TriangleTree
    radius: float
    cells: NearCells

    @property
    def box(self) -> Box:
        """Box that holds the shape."""
        corners = self.middle.corners
        return corners.min(axis=(0, 2)) - self.radius, corners.max(axis=(0, 2)) + self.radius

    @property
    def planes(self) -> tuple[Plane, ...]:
        """Empty, because the surface is round."""
        return ()

    def at(self, points: Doubles) -> Doubles:
        """Return the signed distance to the surface, exact up to `FAR` spacings outside."""
        farthest = self.cells.side
        out = np.full(points.shape[1], self.radius - farthest)
        near = self.cells.of(points)
        for start in range(0, len(near), BLOCK):
            numbers = near[start : start + BLOCK]
            squared, _ = self.middle.nearest(points[:, numbers], np.full(len(numbers), farthest * farthest))
            out[numbers] = self.radius - np.minimum(np.sqrt(squared), farthest)
        return out


@dataclass(frozen=True)
class ThinWalls:
    """Walls thinner than the least thickness.

    Parameters
    ----------
    shape : Thickening or None
        Shape to add to the solid; None if no wall is thin.
    share : float
        Share of the surface that bounds thin walls, 0 to 1.
    thinnest : float or None
        Thickness of the thinnest wall, mm; its area is at least that in walls.py.
    place : (x, y, z) float or None
        Point in the middle of that wall, RAS+ mm.
    notes : tuple of str
        Sentences for the user.
    """

    shape: Thickening | None = None
    share: float = 0.0
    thinnest: float | None = None
    place: Point | None = None
    notes: tuple[str, ...] = ()


def thin_walls_steps(
    mesh: TriangleMesh, least: float, spacing: float, threads: int | None = None, before: Sequence[Thickening] = ()
) -> Steps[ThinWalls]:
    """Find the walls of a solid that are thinner than `least` mm.

    Parameters
    ----------
    mesh : TriangleMesh
        Closed, RAS+ mm.
    least : float
        Above 0, mm.
    spacing : float
        Usual edge of the mesh, mm; triangles with edges more than twice as long get samples inside.
    threads : int, optional
        Default: one for each processor.
    before : sequence of Thickening
        Shapes that thicken the solid already: only walls near them are searched; see `PER_WALL` and `MORE`.
    """
    nothing = ThinWalls(notes=(f"No wall is thinner than {mm_text(least)}.",))
    if not len(mesh.faces):
        return nothing
    apart = BETWEEN * spacing
    if before:
        apart = min(apart, max(PER_WALL * least, BETWEEN * math.sqrt(mesh.area / MOST_SAMPLES)))
    stages = Stages(STAGES)
    sampling, measuring, preparing = STAGES
    samples = yield from stages.run(sampling, surface_samples_steps(mesh, apart, side=-1))
    measured = _balls_steps(mesh, samples, SEARCHED * least / 2, worker_count(threads), before)
    diameters, centers = yield from stages.run(measuring, measured)
    thin = diameters < least * (1 - SAME)
    if not thin.any():
        return nothing
    radius = least / 2 + len(before) * MORE * spacing
    shape = yield from stages.run(preparing, _shape_steps(mesh, thin, centers, radius, FAR * spacing))
    return _described(diameters, centers, samples.areas, thin, least, shape)


def _described(
    diameters: Doubles, centers: Doubles, areas: Doubles, thin: Flags, least: float, shape: Thickening
) -> ThinWalls:
    """Return thin walls with their measures and a note."""
    whole, own = np.cumsum(np.stack([areas, np.where(thin, areas, 0.0)]), axis=1)[:, -1].tolist()
    thinnest_first = np.flatnonzero(thin)[np.argsort(diameters[thin], kind="stable")]
    enough = int(np.searchsorted(np.cumsum(areas[thinnest_first]), min(LEAST_MM2, LEAST_SHARE * whole)))
    at = int(thinnest_first[min(enough, len(thinnest_first) - 1)])
    x, y, z = centers[at].tolist()
    thinnest, share = float(diameters[at]), own / whole if whole else 0.0
    note = (
        f"{_percent(share)} of the surface bounds walls thinner than {mm_text(least)}, down to {mm_text(thinnest, 3)} "
        f"at {place_text((x, y, z), least)}; they are thickened, by up to {mm_text(least - thinnest, 3)}."
    )
    return ThinWalls(shape, share, thinnest, (x, y, z), (note,))


def _shape_steps(mesh: TriangleMesh, thin: Flags, centers: Doubles, radius: float, far: float) -> Steps[Thickening]:
    """Return the shape that thickens thin walls."""
    middle = yield from _middle_steps(mesh, thin, centers)
    tree = TriangleTree()
    yield from tree.prepare_steps(middle)
    return Thickening(tree, radius, (yield from near_cells_steps(tree, radius + far)))


def _balls_steps(
    mesh: TriangleMesh, samples: SurfaceSamples, limit: float, threads: int, near: Sequence[Thickening]
) -> Steps[tuple[Doubles, Doubles]]:
    """Return the balls that touch both sides of walls, up to a radius: near the shapes, or everywhere without any.

    Diameters (n,) and centers (n, 3) are those at the samples; the diameter is NaN if there is no ball.
    """
    tree, gap, areas = samples
    balls = TangentBalls(tree, gap, limit, TRIANGLE_SLOPE)
    asked = np.zeros(len(tree.order), np.bool_)
    asked[samples.places] = True
    asked &= tree.normals.any(axis=0)
    if near:
        within = np.zeros(len(asked), np.bool_)
        for shape in near:
            within[shape.cells.of(tree.positions + tree.middle[:, None])] = True
            yield PAUSE
        asked &= within
    radii = yield from equal_part(balls.radii_steps(asked, threads), 0, 2)
    places = np.flatnonzero(asked & ~np.isnan(radii))
    ways = tree.normals[:, places].astype(np.float64) * radii[places]
    middles = tree.positions[:, places].astype(np.float64) + tree.middle[:, None] + ways
    facing = balls.facing(places) <= FACING
    not_facing = np.flatnonzero(~facing)
    if len(not_facing):
        surface = TriangleTree()
        yield from surface.prepare_steps(mesh)
        reach = (1 + FACING) * radii[places[not_facing]]
        ends = surface.distances_steps((middles + ways)[:, not_facing].T, float(reach.max()), threads)
        not_facing = not_facing[(yield from equal_part(ends, 2, 4)) <= reach]
        empty = yield from equal_part(surface.distances_steps(middles[:, not_facing].T, limit, threads), 3, 4)
        facing[not_facing[empty >= EMPTY * radii[places[not_facing]]]] = True
    numbers = tree.order[places[facing]]
    diameters, centers = np.full(len(areas), np.nan), np.zeros((len(areas), 3))
    diameters[numbers] = 2 * radii[places[facing]]
    centers[numbers] = middles[:, facing].T
    return diameters, centers


def _middle_steps(mesh: TriangleMesh, thin: Flags, centers: Doubles) -> Steps[TriangleMesh]:
    """Return the middle of thin walls as triangles, some of which are points."""
    faces = mesh.faces[thin[mesh.faces].all(axis=1)]
    yield PAUSE
    covered = np.zeros(len(thin), np.bool_)
    covered[faces] = True
    yield PAUSE
    isolated = np.flatnonzero(thin & ~covered).astype(np.int32)
    numbers = np.concatenate([faces, np.repeat(isolated[:, None], 3, axis=1)])
    used, renumbered = compacted(numbers, len(thin))
    yield PAUSE
    return TriangleMesh(centers[used].astype(np.float32), renumbered)


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %" if share >= 0.001 else "Less than 0.1 %"
