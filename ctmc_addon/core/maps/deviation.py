# SPDX-License-Identifier: GPL-3.0-or-later
"""Distance of a simplified surface to the full one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..mesh.distance.surface_distance import ReferenceSurface, vertex_distances_steps
from ..progress import Stages, Steps
from .make import full_settings
from .quantity import MappedSurface, MapValues, Quantity


@dataclass(frozen=True)
class Deviation(Quantity):
    """Distance of every vertex to the surface before simplification, mm; 0 without simplification."""

    flag: ClassVar[str] = "deviation"
    text: ClassVar[str] = "distance to the surface before simplification"
    label: ClassVar[str] = "Deviation"
    ramp: ClassVar[str] = "light"
    needs_full: ClassVar[bool] = True

    @property
    def name(self) -> str:
        """The name of the map."""
        return "deviation_mm"

    def values_steps(self, surface: MappedSurface) -> Steps[MapValues]:
        """Measure the distance of every vertex to the nearest triangle of the full surface."""
        if not surface.settings.simplifies:
            return MapValues(np.zeros(len(surface.mesh.vertices), np.float32))
        stages = Stages({"Making the full surface": 2, "Measuring distances": 1})
        making, measuring = stages.shares
        full = yield from stages.run(making, surface.surface_steps(full_settings(surface.settings)))
        distances = vertex_distances_steps(surface.mesh, ReferenceSurface(full), surface.budget.threads)
        return MapValues((yield from stages.run(measuring, distances)).astype(np.float32))
