# SPDX-License-Identifier: GPL-3.0-or-later
"""The smoothest field that agrees with a label at every sample, as a field that a surface is extracted from."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...machine.budget import Budget
from ...measures.units import volume_text
from ...progress import PAUSE, Steps
from ...settings import ReconstructionSettings
from ...volume.field import ScalarField, all_values_steps
from ...volume.field_values import HeldValues
from ...volume.region import box_slices, relative_box
from ...volume.volume import Box, Volume
from ..choices import WIDE
from ..constrained import REMEDY, automatic_refinement, constrained_steps, reach_of
from ..smooth_field import SmoothField
from .smoothing import Smoothing, Spacing


class _SmoothedNote(str):
    """The note on a smoothed label, distinguished from other notes by its class."""

    __slots__ = ()


class Constrained(Smoothing):
    """The smoothest field that agrees with a label at every sample."""

    smooths = True
    by_slabs = False
    fallback = WIDE
    weight = 6
    voxel_seconds = 4e-7
    settings = ("slice_steps",)
    reads = ("close_border",)

    def field_steps(self, field: ScalarField, volume: Volume, budget: Budget, with_surface: bool) -> Steps[ScalarField]:
        """Return the field of a label with the smoothest values that agree with it, all of them in memory."""
        settings, spacing = field.settings, volume.spacing
        budget.require(math.prod(field.values.shape), f"smoothing label {settings.label}", REMEDY)
        mask = (yield from all_values_steps(field.values)).view(bool)
        if mask.all():
            return field
        slice_steps = self.slice_steps(spacing, settings)
        yield PAUSE
        window = None
        is_plain = settings.stride == (1, 1, 1) and settings.topology == "classic" and settings.region is None
        if with_surface and is_plain and not settings.close_border and not _reaches_border(field, mask, volume):
            x, y, (start, stop) = relative_box(field.window, field.origin)
            window = x, y, (start * slice_steps, (stop - 1) * slice_steps + 1)
        smooth = yield from constrained_steps(mask, spacing, slice_steps, settings.close_border, budget, window)
        volumes = ""
        if settings.region is None or not _is_cut(field, mask, volume):  # the volume is that of the label in the box
            is_open = not settings.close_border and _reaches_border(field, mask, volume)
            surface, samples = (volume_text(each, 5) for each in (smooth.volume_mm3, smooth.label_mm3))
            volumes = f"Smoothed label: {surface}, voxels {samples}"
            if is_open:
                volumes = f"Smoothed label, closed at the border: {surface}, voxels {samples}"
        notes = [*field.notes, _smoothed_note(slice_steps, volumes)]
        if slice_steps < automatic_refinement(spacing) and settings.slice_steps == 0:
            notes.append(f"Slices are not refined at a stride of {settings.stride[2]} along z.")
        smoothed = replace(
            field,
            notes=tuple(notes),
            level=0.0,
            window_in_values=_refined_window(field, volume, smooth, settings.close_border),
            slice_steps=slice_steps,
            first_slice=smooth.first_slice,
            surface=smooth.surface,
        )
        return replace(smoothed, values=HeldValues(smooth.values, _wrong_side(smoothed, smooth.values, mask)))

    def reach(self, spacing_mm: Spacing, settings: ReconstructionSettings) -> list[int]:
        """Return how many voxels beyond the window it reads along x, y and z."""
        return [0, 0, 0] if settings.region is None else [*reach_of(spacing_mm)]

    def slice_steps(self, spacing_mm: Spacing, settings: ReconstructionSettings) -> int:
        """Return the steps from slice to slice that it makes."""
        if settings.slice_steps == 0 and settings.stride[2] > 1:
            return 1
        return settings.slice_steps or automatic_refinement(spacing_mm)

    def shared_notes(self, notes: tuple[str, ...], slice_steps: int) -> tuple[str, ...]:
        """Return the notes on a field of a label that shares walls: it may enclose another volume than by itself."""
        return tuple(_smoothed_note(slice_steps) if isinstance(note, _SmoothedNote) else note for note in notes)


def _smoothed_note(slice_steps: int, volumes: str = "") -> _SmoothedNote:
    """Return the note on a label that was smoothed in `slice_steps` steps a slice.

    `volumes` begins the note with what it encloses.
    """
    beginning = volumes or "Smoothed label, every voxel on its own side"
    return _SmoothedNote(f"{beginning}, {slice_steps} steps per slice" if slice_steps > 1 else beginning)


def _is_cut(field: ScalarField, mask: NDArray[np.bool_], volume: Volume) -> bool:
    """Return whether a label reaches the border of its window where the volume goes on."""
    x, y, z = (
        (start + (start > 0), stop - (stop < n)) for (start, stop), n in zip(field.window, volume.size, strict=True)
    )
    return _reaches_out(field, mask, (x, y, z))


def _reaches_border(field: ScalarField, mask: NDArray[np.bool_], volume: Volume) -> bool:
    """Return whether a label reaches the border of the volume, where its surface is open unless it is closed there."""
    x, y, z = ((1, n - 1) for n in volume.size)
    return _reaches_out(field, mask, (x, y, z))


def _reaches_out(field: ScalarField, mask: NDArray[np.bool_], box: Box) -> bool:
    """Return whether a label has samples outside a box of the volume."""
    inner = tuple(
        (max(start, 0), min(stop, n))
        for (start, stop), n in zip(relative_box(box, field.origin), mask.shape[::-1], strict=True)
    )
    return np.count_nonzero(mask[box_slices((inner[0], inner[1], inner[2]))]) < np.count_nonzero(mask)


def _refined_window(field: ScalarField, volume: Volume, smooth: SmoothField, close_border: bool) -> Box:
    """Return the window counted in refined slices; a closed border lies half a slice gap outside it."""
    x, y, (start, stop) = relative_box(field.window, field.origin)
    low, high = (smooth.first_slice + slice_ * smooth.slice_steps for slice_ in (start, stop - 1))
    if close_border:
        cap = (smooth.slice_steps - 1) // 2  # Marching Cubes adds half a refined slice
        low = 0 if field.window[2][0] == 0 else low - cap
        high = len(smooth.values) - 1 if field.window[2][1] == volume.size[2] else high + cap
    return x, y, (low, high + 1)


def _wrong_side(field: ScalarField, values: NDArray[np.float32], mask: NDArray[np.bool_]) -> int:
    """Return how many samples of a label, in the window, the values have on the other side of the surface."""
    x, y, z = box_slices(relative_box(field.window, field.origin))[::-1]
    count = 0
    for slice_ in range(z.start, z.stop):
        layer = values[field.first_slice + slice_ * field.slice_steps, y, x]
        count += int(np.count_nonzero((layer >= field.level) != mask[slice_, y, x]))
    return count
