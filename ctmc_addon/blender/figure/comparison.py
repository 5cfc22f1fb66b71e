# SPDX-License-Identifier: GPL-3.0-or-later
"""Describe what a sheet compares: one setting or two crossed settings, and the settings of every cell.

No Blender here, as in spec.py.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...core import (
    SETTINGS,
    SIMPLIFICATION,
    Described,
    ReconstructionSettings,
    SettingsError,
    has_width,
    setting,
    settings_of_stage,
)
from ...reporting.captions import smoothing_phrase, stride_phrase

MOST_CELLS = 26  # A sheet labels its cells with the 26 letters.


@dataclass(frozen=True)
class Comparison(Described):
    """Values that a sheet compares: of one setting, or of two crossed, the first down and the second across.

    Raises
    ------
    SettingsError
        If none or more than two are given, a value lies outside its limits, or they make too many cells.
    """

    strides: tuple[tuple[int, int], ...] = setting(
        (),
        "Strides to compare: 1 2 3, or 2x1 for different strides along x and y",
        label="Stride",
        unit="px",
        low=SETTINGS["stride"].low,
        high=SETTINGS["stride"].high,
        size=2,
        many=True,
        type=int,
    )
    alphas: tuple[float, ...] = setting(
        (), "Alphas to compare", label="Alpha", low=SETTINGS["alpha"].low, high=SETTINGS["alpha"].high, many=True
    )
    levels: tuple[float, ...] = setting(
        (), "Shares of removed triangles to compare", label="Levels", unit="%", low=0.0, high=99.0, many=True
    )

    smoothings: tuple[str, ...] = setting(
        (),
        "Smoothings to compare, with their volumes",
        label="Smoothings",
        choices=SETTINGS["smoothing"].choices[1:],
        many=True,
        type=str,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        many = self.counts
        if not 1 <= len(many) <= 2:
            raise SettingsError(
                "a sheet compares strides, alphas, levels or smoothings, or two of them crossed; give one or two"
            )
        count = many[0] * many[-1] if len(many) == 2 else many[0]
        if count > MOST_CELLS:
            raise SettingsError(f"{count} cells are too many for one letter each; compare at most {MOST_CELLS}")

    @property
    def counts(self) -> list[int]:
        """Return how many values are compared along each axis."""
        return [len(axis) for axis in (self.smoothings, self.strides, self.alphas, self.levels) if axis]

    @property
    def columns(self) -> int | None:
        """Return the cells per row where two settings are crossed, else None."""
        return self.counts[1] if len(self.counts) == 2 else None

    def variants(
        self, settings: ReconstructionSettings, spacing_mm: Sequence[float] = ()
    ) -> list[tuple[str, ReconstructionSettings]]:
        """Return the title and the settings of every cell; strides in mm too where the spacing is given."""
        axes: list[list[tuple[str, dict[str, Any]]]] = []
        if self.smoothings:
            axes.append([])
            for name in self.smoothings:
                change: dict[str, Any] = {
                    "smoothing": name,
                    "smoothing_mm": settings.smoothing_mm if has_width(name) else None,
                }
                axes[0].append((smoothing_phrase(replace(settings, **change)) or "not smoothed", change))
        if self.strides:
            z = settings.stride[2]
            axes.append([(stride_phrase((x, y), spacing_mm[:2]), {"stride": (x, y, z)}) for x, y in self.strides])
        if self.alphas:
            axes.append([(f"alpha {alpha:g}", {"alpha": alpha}) for alpha in self.alphas])
        if self.levels:
            full = settings.without(SIMPLIFICATION)
            free = {name: getattr(full, name) for name in settings_of_stage(SIMPLIFICATION)}
            axes.append(
                [
                    (
                        f"{level:g} % simplified" if level else "not simplified",
                        {**free, "reduction": level / 100 or None},
                    )
                    for level in self.levels
                ]
            )
        out = []
        for choice in itertools.product(*axes):
            changes: dict[str, Any] = {}
            for _, change in choice:
                changes |= change
            out.append((", ".join(title for title, _ in choice), replace(settings, **changes)))
        return out
