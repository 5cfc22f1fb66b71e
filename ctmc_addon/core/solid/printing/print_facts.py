# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the facts about a part that a print lab needs.

The part keeps its orientation in RAS+ mm and is printed along +z, on a bed at its lowest point.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...arithmetic import arctangents
from ...arrays import Flags
from ...machine.budget import Budget
from ...measures.units import spacing_text
from ...mesh.face_normals import face_vectors
from ...mesh.topology import FACES_PER_STEP
from ...mesh.triangle_mesh import TriangleMesh
from ...progress import PAUSE, Stages, Steps
from ..request import MOST_CUTS, Point, SolidRequest
from .walls import walls_steps

STEEP = math.sqrt(0.5)  # The sine of 45 degrees; printers need supports beyond it.
LEAST_SHARE = 0.001  # An overhang counts if at least this share of the area overhangs as far.
ON_BED = 0.1  # Faces this near to the lowest point rest on the bed, mm: about one layer.
ROUNDING = 0.01  # Positions of cuts are rounded to this, and a part may exceed the bed by it, mm.
MM2_PER_CM2, MM3_PER_ML = 100.0, 1000.0
STAGES = {"Measuring overhangs": 1, "Measuring walls": 9}


@dataclass(frozen=True)
class PrintFacts:
    """Facts about a part for a print lab.

    Parameters
    ----------
    size_mm : (x, y, z) float
        Sides of the box around it along the axes of RAS.
    material_ml : float or None
        Enclosed volume without cavities; None for an open surface.
    area_cm2 : float
        Area of the surface, including cavities.
    thinnest_wall_mm : float or None
        As `Walls.thinnest`: sharp edges do not count.
    below_least_wall : float or None
        Share of the area whose wall is thinner than the least wall, 0 to 1; None without a least wall.
    pieces : int
        Components that enclose material, including loose ones inside cavities.
    closed_cavities : int
        Cavities without a drain.
    largest_overhang_deg : float
        The largest angle from the vertical of faces that look down, 90 for a ceiling, that a thousandth of the area
        reaches; faces on the bed do not count. 0 if nothing overhangs.
    overhang_share : float
        Share of the area that overhangs by more than 45 degrees, 0 to 1.
    least_wall_mm : float or None
        Requested least wall.
    bed_mm : (x, y, z) float or None
        Requested space of the printer.
    fits_bed : bool or None
        Whether the part fits as it lies, or turned about z by 90 degrees; None without a bed.
    cuts : tuple of str
        If it does not fit, cuts that divide it evenly into pieces that do: "--cut X Y Z NX NY NZ".
    """

    size_mm: Point
    material_ml: float | None
    area_cm2: float
    thinnest_wall_mm: float | None
    below_least_wall: float | None
    pieces: int
    closed_cavities: int
    largest_overhang_deg: float
    overhang_share: float
    least_wall_mm: float | None = None
    bed_mm: Point | None = None
    fits_bed: bool | None = None
    cuts: tuple[str, ...] = ()

    def report(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()}

    @property
    def notes(self) -> tuple[str, ...]:
        """Return the reasons against a print as sentences, each with a remedy."""
        notes = []
        if self.fits_bed is False and self.bed_mm is not None:
            remedy = f"cut it with {' '.join(self.cuts)}"
            if len(self.cuts) > MOST_CUTS:
                remedy = f"it takes {len(self.cuts)} cuts, and at most {MOST_CUTS} are possible; give a larger bed"
            notes.append(f"The part does not fit the bed of {spacing_text(self.bed_mm)}; {remedy}")
        if self.closed_cavities:
            what = "1 cavity" if self.closed_cavities == 1 else f"{self.closed_cavities} cavities"
            notes.append(f"The part encloses {what} without a drain; --drain X Y Z MM opens one")
        return tuple(notes)


def print_facts_steps(
    mesh: TriangleMesh, solid: SolidRequest, budget: Budget | None = None, spacing: float | None = None
) -> Steps[PrintFacts]:
    """Measure the facts about a part.

    Parameters
    ----------
    mesh : TriangleMesh
        RAS+ mm.
    solid : SolidRequest
        Only its least wall, bed and pegs matter.
    budget : Budget, optional
    spacing : float, optional
        Spacing of the samples that the part was made from, mm, for the samples of its walls.

    Raises
    ------
    MeshError
        For a mesh without triangles.
    """
    overhanging, measuring = STAGES
    stages = Stages(STAGES)
    measures = mesh.measures
    walls = yield from stages.run(measuring, walls_steps(mesh, budget or Budget(), _sampling(solid, spacing)))
    largest, share = yield from stages.run(overhanging, _overhang_steps(mesh, measures.area))
    least = solid.least_wall or None
    cuts = cuts_to_fit(mesh.vertices.min(axis=0).tolist(), mesh.vertices.max(axis=0).tolist(), solid)
    assert measures.size is not None, "there are triangles"
    volume = measures.enclosed_volume
    return PrintFacts(
        size_mm=measures.size,
        material_ml=None if volume is None else volume / MM3_PER_ML,
        area_cm2=measures.area / MM2_PER_CM2,
        thinnest_wall_mm=walls.thinnest,
        below_least_wall=None if least is None else walls.share_below(least),
        pieces=measures.bodies,
        closed_cavities=measures.cavities,
        largest_overhang_deg=largest,
        overhang_share=share,
        least_wall_mm=least,
        bed_mm=solid.bed,
        fits_bed=None if solid.bed is None else not cuts,
        cuts=cuts,
    )


def _sampling(solid: SolidRequest, spacing: float | None) -> float | None:
    """Return the distance between samples of walls: at most the thickness of the walls in the request."""
    if spacing is None:
        return None
    return min([spacing, *(wall for wall in (solid.hollow, solid.least_wall) if wall)])


def _overhang_steps(mesh: TriangleMesh, area: float) -> Steps[tuple[float, float]]:
    """Return the largest overhang, degrees from the vertical, and the share of the area beyond 45."""
    heights = mesh.vertices[:, 2]
    floor = float(heights.min()) + ON_BED
    sines, areas = [], []
    for start in range(0, len(mesh.faces), FACES_PER_STEP):
        faces = mesh.faces[start : start + FACES_PER_STEP]
        vectors = face_vectors(mesh.vertices, faces)
        doubled = np.sqrt(vectors[:, 0] ** 2 + vectors[:, 1] ** 2 + vectors[:, 2] ** 2)
        above: Flags = (heights[faces] > floor).any(axis=1)
        down = np.flatnonzero((vectors[:, 2] < 0) & above)
        sines.append(-vectors[down, 2] / doubled[down])
        areas.append(doubled[down] / 2)
        yield PAUSE
    sine, weight = np.concatenate(sines), np.concatenate(areas)
    order = np.argsort(-sine, kind="stable")
    yield PAUSE
    sine, covered = sine[order], np.cumsum(weight[order])
    reached = int(np.searchsorted(covered, LEAST_SHARE * area))
    steep = int(np.searchsorted(-sine, -STEEP))
    share = float(covered[steep - 1]) / area if steep else 0.0
    return _degrees_of_sine(sine[reached]) if reached < len(sine) else 0.0, share


def _degrees_of_sine(sine: float) -> float:
    """Return an angle from 0 to 90 degrees by its sine, with the same bits everywhere.

    Examples
    --------
    >>> round(_degrees_of_sine(0.5), 12), _degrees_of_sine(1.0)
    (30.0, 90.0)
    """
    cosine = math.sqrt(max(0.0, 1.0 - sine * sine))
    return math.degrees(float(arctangents(np.array([sine / cosine]))[0])) if cosine else 90.0


def cuts_to_fit(low: Sequence[float], high: Sequence[float], solid: SolidRequest) -> tuple[str, ...]:
    """Return cuts across the axes that divide a box evenly into pieces that fit the bed; empty if it fits.

    The box may be turned about z by 90 degrees if that needs fewer pieces. Pegs take room on the bed.

    Parameters
    ----------
    low, high : (x, y, z) float
        Corners of the box, RAS+ mm.
    solid : SolidRequest
        Only its bed and pegs matter.

    Examples
    --------
    >>> cuts_to_fit((0, 0, 0), (300, 100, 200), SolidRequest(bed=(220, 120, 250)))
    ('--cut 150 50 100 1 0 0',)
    >>> cuts_to_fit((0, 0, 0), (100, 200, 200), SolidRequest(bed=(220, 120, 250)))
    ()
    """
    if solid.bed is None:
        return ()
    x, y, z = solid.bed
    sides = [end - start for start, end in zip(low, high, strict=True)]
    peg = solid.pegs.length if solid.pegs is not None else 0.0
    ways = [[_pieces(side, room, peg) for side, room in zip(sides, bed, strict=True)] for bed in ((x, y, z), (y, x, z))]
    counts = min(ways, key=math.prod)  # As it lies, if both take the same number.
    middle = [(start + end) / 2 for start, end in zip(low, high, strict=True)]
    cuts = []
    for axis, count in enumerate(counts):
        for number in range(1, count):
            point = [*middle]
            point[axis] = low[axis] + sides[axis] * number / count
            normal = [float(each == axis) for each in range(3)]
            cuts.append("--cut " + " ".join(_position(each) for each in (*point, *normal)))
    return tuple(cuts)


def _pieces(side: float, room: float, peg: float) -> int:
    """Return the number of pieces into which a side is cut, each with a peg at one end at most."""
    if side <= room + ROUNDING:
        return 1
    free = room - peg if room > peg else room
    return math.ceil((side - ROUNDING) / free)


def _position(number: float) -> str:
    return f"{round(number / ROUNDING) * ROUNDING + 0.0:.2f}".rstrip("0").rstrip(".")
