# SPDX-License-Identifier: GPL-3.0-or-later
"""A quantity for tests: the height above the lowest vertex."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ctmc_addon.core import PAUSE, Described, setting
from ctmc_addon.core.maps.quantity import MapValues, Quantity


@dataclass(frozen=True)
class RiseOptions(Described):
    """Options of `Rise`."""

    rise_from_mm: float | None = setting(None, "No value below this height", label="From", unit="mm")


@dataclass(frozen=True)
class Rise(Quantity):
    """Height above the lowest vertex, NaN below `rise_from_mm`."""

    flag, text, label, options = "rise", "height above the lowest vertex", "Rise", RiseOptions
    rise_from_mm: float | None = None

    @property
    def name(self):
        return "rise_mm"

    def values_steps(self, surface):
        yield PAUSE
        z = surface.mesh.vertices[:, 2]
        values = z - z.min()
        if self.rise_from_mm is not None:
            values[values < self.rise_from_mm] = np.nan
        return MapValues(values, notes=("measured upward",))
