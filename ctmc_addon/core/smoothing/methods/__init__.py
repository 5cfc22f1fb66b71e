# SPDX-License-Identifier: GPL-3.0-or-later
"""The ways to smooth before extraction, one object each: what it reads, how it is named, what it takes, its work.

A new way is one class in this folder, its line here, and its line in `choices`.
"""

from __future__ import annotations

from ...described import AUTO
from ...settings import SETTINGS, ReconstructionSettings
from ..choices import NONE, OF_LABEL, WIDE
from .constrained import Constrained
from .gaussian import Gaussian
from .smoothing import Smoothing, Spacing, Unsmoothed

__all__ = ["SMOOTHINGS", "Smoothing", "refinement_of", "smoothing_of", "used_settings"]

SMOOTHINGS: dict[str, Smoothing] = {NONE: Unsmoothed(NONE), WIDE: Gaussian(WIDE), OF_LABEL: Constrained(OF_LABEL)}


def smoothing_of(settings: ReconstructionSettings) -> Smoothing:
    """Return the smoothing that settings ask for."""
    return SMOOTHINGS[settings.smoothing_method]


def refinement_of(spacing_mm: Spacing, settings: ReconstructionSettings) -> int:
    """Return the steps from slice to slice that settings give; 1 unless their smoothing makes more."""
    return smoothing_of(settings).slice_steps(spacing_mm, settings)


def used_settings(settings: ReconstructionSettings) -> list[str]:
    """Return the names of the settings but for those of smoothings that are not done, and of a choice of alpha."""
    own = smoothing_of(settings).settings
    excluded = {name for smoothing in SMOOTHINGS.values() for name in smoothing.settings if name not in own}
    if settings.alpha != AUTO:
        excluded.add("min_angle_deg")
    return [name for name in SETTINGS if name not in excluded]
