# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the deviation: how far simplification has moved a surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..mesh.distance.surface_distance import ReferenceSurface, vertex_distances_steps
from ..progress import Steps, equal_part
from .quantity import MappedSurface, MapValues, Quantity


@dataclass(frozen=True)
class Deviation(Quantity):
    """Distance of every vertex to the full surface, from before simplification; 0 without simplification."""

    flag: ClassVar[str] = "deviation"
    text: ClassVar[str] = "Distance to the full surface: how far simplification has moved it"
    label: ClassVar[str] = "Deviation"
    ramp: ClassVar[str] = "light"

    @property
    def name(self) -> str:
        """The name of the map."""
        return "deviation_mm"

    @property
    def needs_full(self) -> bool:
        """Whether the map needs full surfaces."""
        return True

    def values_steps(self, surface: MappedSurface) -> Steps[MapValues]:
        """Make the full surface and measure the distances to it."""
        if not surface.settings.simplifies:
            return MapValues(np.zeros(len(surface.mesh.vertices), np.float32))
        full = yield from equal_part(surface.surface_steps(surface.settings.without("simplification")), 0, 2)
        measuring = vertex_distances_steps(surface.mesh, ReferenceSurface(full), surface.budget.threads)
        distances = yield from equal_part(measuring, 1, 2)
        return MapValues(distances.astype(np.float32))
