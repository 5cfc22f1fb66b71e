# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the smallest angle of the triangles around each vertex; small angles hinder a simulation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..arithmetic import arctangents
from ..mesh.angles.triangle_angles import doubled_areas, smallest_tangents, squared_sides
from ..mesh.topology import FACES_PER_STEP
from ..progress import Step, Steps
from .quantity import MappedSurface, MapValues, Quantity


@dataclass(frozen=True)
class SmallestAngle(Quantity):
    """Smallest angle of all triangles around a vertex, degrees; NaN without triangles."""

    flag: ClassVar[str] = "angle"
    text: ClassVar[str] = "Smallest angle of the triangles around each vertex; small angles are bad for simulation"
    label: ClassVar[str] = "Smallest Angle"

    @property
    def name(self) -> str:
        """The name of the map."""
        return "angle_deg"

    @property
    def unit(self) -> str:
        """Degrees."""
        return "deg"

    def values_steps(self, surface: MappedSurface) -> Steps[MapValues]:
        """Work the values out."""
        faces, vertices = surface.mesh.faces, surface.mesh.vertices
        least = np.full(len(vertices), np.inf)  # Tangents of the angles.
        for start in range(0, len(faces), FACES_PER_STEP):
            numbers = faces[start : start + FACES_PER_STEP]
            corners = [vertices[numbers[:, corner]].astype(np.float64) for corner in range(3)]
            tangents = smallest_tangents(doubled_areas(corners), squared_sides(corners))
            for corner in range(3):
                np.minimum.at(least, numbers[:, corner], tangents)
            yield Step(start / len(faces))
        there = np.isfinite(least)
        angles = np.full(len(vertices), np.nan, np.float32)
        angles[there] = arctangents(least[there]) * (180.0 / math.pi)
        return MapValues(angles)
