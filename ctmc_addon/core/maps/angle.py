# SPDX-License-Identifier: GPL-3.0-or-later
"""Smallest angle of the triangles around a vertex: what a mesh generator or solver asks of a surface."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..arithmetic import arctangents
from ..mesh.angles.triangle_angles import doubled_areas, smallest_tangents, squared_sides
from ..progress import Step, Steps
from .quantity import MappedSurface, MapValues, Quantity

FACES_AT_ONCE = 1 << 17


@dataclass(frozen=True)
class SmallestAngle(Quantity):
    """Smallest angle of all triangles around every vertex, degrees; NaN for a vertex without triangles."""

    flag: ClassVar[str] = "angle"
    text: ClassVar[str] = "smallest angle of the triangles around, for simulation"
    label: ClassVar[str] = "Smallest Angle"

    @property
    def name(self) -> str:
        """The name of the map."""
        return "smallest_angle_deg"

    @property
    def unit(self) -> str:
        """Degrees."""
        return "deg"

    def values_steps(self, surface: MappedSurface) -> Steps[MapValues]:
        """Take the smallest angle of each triangle to its corners."""
        mesh = surface.mesh
        smallest = np.full(len(mesh.vertices), np.inf)
        for start in range(0, len(mesh.faces), FACES_AT_ONCE):
            faces = mesh.faces[start : start + FACES_AT_ONCE]
            corners = [mesh.vertices[faces[:, at]].astype(np.float64) for at in range(3)]
            tangents = smallest_tangents(doubled_areas(corners), squared_sides(corners))
            for at in range(3):
                np.minimum.at(smallest, faces[:, at], tangents)
            yield Step(start / len(mesh.faces))
        smallest[np.isinf(smallest)] = np.nan
        return MapValues((arctangents(smallest) * (180.0 / math.pi)).astype(np.float32))
