# SPDX-License-Identifier: GPL-3.0-or-later
"""The base class of the smoothings, and the one that does nothing."""

from __future__ import annotations

from ...machine.budget import Budget
from ...progress import PAUSE, Steps
from ...settings import ReconstructionSettings
from ...volume.field import ScalarField
from ...volume.volume import Volume

Spacing = tuple[float, float, float]


class Smoothing:
    """Base class of the smoothings; smooths nothing.

    Parameters
    ----------
    name : str
        Name in settings.

    Attributes
    ----------
    smooths : bool
        Whether anything is done.
    by_slabs : bool
        Whether it is done some slices at a time, so that memory follows a slab; else the whole box is needed at once.
    keeps_samples : bool
        Whether every sample of a label stays on its own side, so that labels that touch own their samples. The values
        of such a field are distances; else those of all labels and of what is no label add up to 1.
    fallback : str
        The name of a smoothing that takes less memory; empty where this one takes no more than a slab.
    weight : int
        Usual time beside that of looking at the values.
    voxel_seconds : float
        Seconds for a voxel of a preview, before any has been timed; slow on purpose.
    settings : tuple of str
        Settings that it alone reads, but for the width.
    reads : tuple of str
        Settings of later stages that its field depends on.
    """

    smooths = False
    by_slabs = True
    keeps_samples = True
    fallback = ""
    weight = 0
    voxel_seconds = 8e-8
    settings: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()

    def __init__(self, name: str) -> None:
        self.name = name

    def field_steps(self, field: ScalarField, volume: Volume, budget: Budget, with_surface: bool) -> Steps[ScalarField]:
        """Return a field with its values smoothed.

        Parameters
        ----------
        field : ScalarField
            Field with gray values, or a label's 0 and 1, of a box that holds `reach`.
        volume : Volume
            Volume that the field is a box of.
        budget : Budget
        with_surface : bool
            Whether the field is to keep its surface, if smoothing makes the one of the settings.
        """
        del volume, budget, with_surface
        yield PAUSE
        return field

    def reach(self, spacing_mm: Spacing, settings: ReconstructionSettings) -> list[int]:
        """Return how many voxels beyond the window it reads along x, y and z."""
        del spacing_mm, settings
        return [0, 0, 0]

    def growth(self, spacing_mm: Spacing, settings: ReconstructionSettings) -> list[int]:
        """Return how many voxels beyond a label its values may differ from 0 along x, y and z."""
        del spacing_mm, settings
        return [0, 0, 0]

    def slice_steps(self, spacing_mm: Spacing, settings: ReconstructionSettings) -> int:
        """Return the steps from slice to slice that it makes."""
        del spacing_mm, settings
        return 1

    def bytes(self, spacing_mm: Spacing, settings: ReconstructionSettings, item: int) -> tuple[int, int]:
        """Return the bytes of a smoothed value, and the bytes kept for each pixel of a slice.

        `item` is the size of the volume's values in bytes.
        """
        reach = self.reach(spacing_mm, settings)[2]
        return (4, 4 * (2 * reach + 1)) if reach else (item, 0)

    def caption(self, settings: ReconstructionSettings) -> str:
        """Return the words of a figure's caption on this smoothing."""
        del settings
        return f"{self.name} smoothing"

    def notes(self, settings: ReconstructionSettings) -> tuple[str, ...]:
        """Return the notes that a report has of this smoothing before the volume is known."""
        del settings
        return ()

    def shared_notes(self, notes: tuple[str, ...], slice_steps: int) -> tuple[str, ...]:
        """Return the notes on a field of a label that shares walls, from the notes on it without them."""
        del slice_steps
        return notes


class Unsmoothed(Smoothing):
    """The values as they are."""

    def caption(self, settings: ReconstructionSettings) -> str:
        """Return the words of a figure's caption on this smoothing."""
        del settings
        return "not smoothed"

    def notes(self, settings: ReconstructionSettings) -> tuple[str, ...]:
        """Return the note that alpha moves no vertex of a label."""
        if settings.label is None:
            return ()
        return ("Alpha has no effect on a label that is not smoothed: every crossing is the midpoint.",)
