# SPDX-License-Identifier: GPL-3.0-or-later
"""Describe the color bar of a map: what its colors mean.

No Blender here, as in spec.py.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...core import Unit, fitting_unit


@dataclass(frozen=True)
class ColorScale:
    """The colors of a map, and their bar.

    Parameters
    ----------
    name : str
        The attribute of the vertices.
    title, unit : str
        Written above the bar.
    range : (low, high) float
        Values of the first and the last color.
    ramp : str
        Of `RAMPS`.
    below, above : bool
        Whether some values lie beyond the range.
    gaps : bool
        Whether some vertices have no value.
    """

    name: str
    title: str
    unit: str
    range: tuple[float, float]
    ramp: str
    below: bool = False
    above: bool = False
    gaps: bool = False

    @property
    def shown_unit(self) -> Unit:
        """Return the unit of the bar."""
        return fitting_unit(self.range, self.unit)

    @property
    def heading(self) -> str:
        """Return the title with the unit."""
        return ", ".join(filter(None, (self.title, self.shown_unit.name)))

    def label(self, share: float) -> str:
        """Return the text of the value at a share of the bar, 0 to 1.

        Examples
        --------
        >>> scale = ColorScale("gap_mm", "gap", "mm", (-2.0, 4.0), "magma", above=True)
        >>> [scale.label(share) for share in (0.0, 0.5, 1.0)], scale.heading
        (['-2', '1', '≥ 4'], 'gap, mm')
        """
        low, high = self.range
        beyond = "≤ " if share == 0.0 and self.below else "≥ " if share == 1.0 and self.above else ""
        value = low + share * (high - low)
        rounded = round(value / self.shown_unit.size, 12) + 0.0  # Neither -0 nor 1e-17 in the middle.
        return f"{beyond}{rounded:.4g}"
