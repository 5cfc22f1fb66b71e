# SPDX-License-Identifier: GPL-3.0-or-later
"""The facts about a finished surface; `measures.py` has their names and units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..maps.surface_map import SurfaceMap
    from ..mesh.distance.surface_distance import SurfaceDistance
    from ..mesh.measures import Measures
    from ..solid.printing.print_facts import PrintFacts
    from ..volume.statistics.inside import InsideValues
    from ..volume.statistics.sampled_inside import SampledValues


@dataclass(frozen=True)
class FinishedSurface:
    """Measures of a finished surface; None if unknown.

    Parameters
    ----------
    measures : Measures
    full_faces : int
        Triangles before simplification.
    removed_components : int
        Small components that the settings asked to remove.
    collapsed_components : mapping of str to number
        `count` and `mm3` of the components that simplification removed as a whole.
    self_intersections : int
        Pairs of triangles that cross, touch or overlap.
    distance : SurfaceDistance
        Distance to the full surface, mm.
    largest_diameter_mm : float
    inside : InsideValues or SampledValues
        The gray values inside, or the dose or uptake.
    maps : mapping of str to SurfaceMap
        Maps on its vertices by name; each is a measure of its own (`map_measure`).
    printing : PrintFacts
        Of a part for print.
    """

    measures: Measures | None = None
    full_faces: int | None = None
    removed_components: int | None = None
    collapsed_components: Mapping[str, float] | None = None
    self_intersections: int | None = None
    distance: SurfaceDistance | None = None
    largest_diameter_mm: float | None = None
    inside: InsideValues | SampledValues | None = None
    maps: Mapping[str, SurfaceMap] = field(default_factory=dict)
    printing: PrintFacts | None = None
