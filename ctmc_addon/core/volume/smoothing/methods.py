# SPDX-License-Identifier: GPL-3.0-or-later
"""The ways to smooth before extraction, one object each: what it reads, how it is named, what it takes.

A new way is one class here and one line of `SMOOTHINGS`, beside its name in the settings' choices.
"""

from __future__ import annotations

import math

from ...settings import AUTO, SETTINGS, ReconstructionSettings
from .constrained import automatic_refinement, reach_of
from .gaussian import REACH

Spacing = tuple[float, float, float]


class Smoothing:
    """No smoothing; what the others differ from.

    Attributes
    ----------
    by_slabs : bool
        Whether it is done some slices at a time, so that memory follows a slab; else the whole box is needed at once.
    weight : int
        Usual time beside that of looking at the values.
    voxel_seconds : float
        Of a preview, before any has been timed; slow on purpose.
    settings : tuple of str
        Settings that it alone reads.
    """

    by_slabs = True
    weight = 0
    voxel_seconds = 8e-8
    settings: tuple[str, ...] = ()

    def reach(self, spacing_mm: Spacing, settings: ReconstructionSettings) -> list[int]:
        """Return how many voxels beyond the window it reads along x, y and z."""
        del spacing_mm, settings
        return [0, 0, 0]

    def slice_steps(self, spacing_mm: Spacing, settings: ReconstructionSettings) -> int:
        """Return the steps from slice to slice that it makes."""
        del spacing_mm, settings
        return 1

    def caption(self, settings: ReconstructionSettings) -> str:
        """Return what a figure's caption says of it."""
        del settings
        return "not smoothed"

    def notes(self, settings: ReconstructionSettings) -> tuple[str, ...]:
        """Return the notes that a report has of this smoothing."""
        if settings.label is None:
            return ()
        return ("On a label that is not smoothed every crossing is the midpoint, and alpha has no effect.",)


class Gaussian(Smoothing):
    """A Gaussian of the values."""

    weight = 1

    def reach(self, spacing_mm: Spacing, settings: ReconstructionSettings) -> list[int]:
        """Return how many voxels beyond the window it reads along x, y and z."""
        return [math.ceil(REACH * settings.gaussian_mm / side) for side in spacing_mm]

    def caption(self, settings: ReconstructionSettings) -> str:
        """Return what a figure's caption says of it."""
        return f"Gaussian of {settings.gaussian_mm:g} mm"

    def notes(self, settings: ReconstructionSettings) -> tuple[str, ...]:
        """Return the notes that a report has of this smoothing."""
        del settings
        return ()


class Constrained(Smoothing):
    """The smoothest field that agrees with a label at every sample."""

    by_slabs = False
    weight = 6
    voxel_seconds = 4e-7
    settings = ("slice_steps",)

    def reach(self, spacing_mm: Spacing, settings: ReconstructionSettings) -> list[int]:
        """Return how many voxels beyond the window it reads along x, y and z."""
        return [0, 0, 0] if settings.region is None else [*reach_of(spacing_mm)]

    def slice_steps(self, spacing_mm: Spacing, settings: ReconstructionSettings) -> int:
        """Return the steps from slice to slice that it makes."""
        if settings.slice_steps == 0 and settings.stride[2] > 1:
            return 1
        return settings.slice_steps or automatic_refinement(spacing_mm)

    def caption(self, settings: ReconstructionSettings) -> str:
        """Return what a figure's caption says of it."""
        del settings
        return "constrained smoothing"

    def notes(self, settings: ReconstructionSettings) -> tuple[str, ...]:
        """Return the notes that a report has of this smoothing."""
        del settings
        return ()


SMOOTHINGS: dict[str, Smoothing] = {"none": Smoothing(), "gaussian": Gaussian(), "constrained": Constrained()}


def used_settings(settings: ReconstructionSettings) -> list[str]:
    """Return the names of the settings but for those of smoothings that are not done, and of a choice of alpha."""
    own = smoothing_of(settings).settings
    others = {name for smoothing in SMOOTHINGS.values() for name in smoothing.settings if name not in own}
    if settings.alpha != AUTO:
        others.add("min_angle_deg")
    return [name for name in SETTINGS if name not in others]


def smoothing_of(settings: ReconstructionSettings) -> Smoothing:
    """Return the smoothing that settings ask for."""
    return SMOOTHINGS[settings.smoothing_method]
