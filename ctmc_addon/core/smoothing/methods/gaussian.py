# SPDX-License-Identifier: GPL-3.0-or-later
"""A Gaussian of the values, some slices at a time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...machine.budget import Budget
from ...machine.parallel import map_steps
from ...measures.units import length_text
from ...progress import PAUSE, Steps
from ...settings import ReconstructionSettings
from ...volume.field import ScalarField
from ...volume.field_values import FieldValues
from ...volume.volume import Box, Volume
from ..gaussian import REACH, smoothed_middle, smoothed_plane, weights
from .smoothing import Smoothing, Spacing

SMOOTHING = "Smoothing"


class Gaussian(Smoothing):
    """A Gaussian of the values."""

    smooths = True
    keeps_samples = False
    weight = 1

    def field_steps(self, field: ScalarField, volume: Volume, budget: Budget, with_surface: bool) -> Steps[ScalarField]:
        """Return a field whose values are smoothed as they are fetched."""
        del with_surface
        yield PAUSE
        settings = field.settings
        counted = None if settings.label is None else field.window_in_values
        width = settings.smoothing_width_mm
        values = GaussianValues(field.values, volume.spacing, width, counted, field.threshold, budget)
        return replace(field, values=values)

    def reach(self, spacing_mm: Spacing, settings: ReconstructionSettings) -> list[int]:
        """Return how many voxels beyond the window it reads along x, y and z."""
        return [math.ceil(REACH * settings.smoothing_width_mm / side) for side in spacing_mm]

    def growth(self, spacing_mm: Spacing, settings: ReconstructionSettings) -> list[int]:
        """Return how many voxels beyond a label its values may differ from 0 along x, y and z: as many as it reads."""
        return self.reach(spacing_mm, settings)

    def caption(self, settings: ReconstructionSettings) -> str:
        """Return the words of a figure's caption on this smoothing."""
        return f"Gaussian of {length_text(settings.smoothing_width_mm)}"


class GaussianValues:
    """Other values, smoothed by a Gaussian, the border repeated; the sums are those of the whole box.

    Parameters
    ----------
    values : FieldValues
    spacing_mm : (x, y, z) float
    sigma_mm : float
    counted : Box, optional
        Box in which samples of a label on the wrong side are counted: a label's.
    level : float
        Inside is ``value >= level``.
    budget : Budget
    """

    held = skips_slices = False
    mixes_samples = True
    own_bytes = 0

    def __init__(
        self,
        values: FieldValues,
        spacing_mm: Sequence[float],
        sigma_mm: float,
        counted: Box | None,
        level: float,
        budget: Budget,
    ) -> None:
        self.values, self.spacing_mm, self.sigma_mm = values, spacing_mm, sigma_mm
        self.counted, self.level, self.budget = counted, level, budget
        self.shape, self.dtype = values.shape, np.dtype(np.float32)
        self.wrong_side = 0
        self._kernels = [weights(sigma_mm / side) for side in spacing_mm]
        self._planes: dict[int, NDArray[np.float32]] = {}  # slices that are smoothed along x and y
        self._masks: dict[int, NDArray[np.uint8]] = {}
        self._next, self._end = 0, self.shape[0]  # slices whose wrong side is still to be counted

    def again(self) -> GaussianValues:
        """The same values, to be fetched from the first slice."""
        again = self.values.again()
        return GaussianValues(again, self.spacing_mm, self.sigma_mm, self.counted, self.level, self.budget)

    def slices_steps(self, numbers: Sequence[int]) -> Steps[NDArray[Any]]:
        """Fetch the values of slices with rising numbers, (slices, rows, columns)."""
        if not len(numbers):
            return np.empty((0, *self.shape[1:]), self.dtype)
        along_x, along_y, along_z = self._kernels
        threads = self.budget.thread_count
        reach, last = len(along_z) - 1, self.shape[0] - 1
        low, high = max(0, numbers[0] - reach), min(last, numbers[-1] + reach) + 1
        self._planes = {number: plane for number, plane in self._planes.items() if number >= low}
        missing = [number for number in range(low, high) if number not in self._planes]
        fetched = yield from self.values.slices_steps(missing)
        planes = yield from map_steps(
            lambda plane: smoothed_plane(plane, along_x, along_y), list(fetched), threads, SMOOTHING
        )
        self._planes |= dict(zip(missing, planes, strict=True))

        smoothed = np.empty((len(numbers), *self.shape[1:]), self.dtype)  # Stacked at once, they would block a window.

        def across(row: int) -> None:
            around = range(numbers[row] - reach, numbers[row] + reach + 1)
            smoothed[row] = smoothed_middle([self._planes[min(max(at, 0), last)] for at in around], along_z)

        yield from map_steps(across, range(len(numbers)), threads, SMOOTHING)
        if self.counted is not None:
            self._masks = {number: mask for number, mask in self._masks.items() if number >= numbers[0]}
            self._masks |= dict(zip(missing, fetched, strict=True))
            self._count(smoothed, numbers, self.counted)
        return smoothed

    def count_within(self, first: int, stop: int) -> None:
        """Count samples on the wrong side in the slices from `first` to `stop` only."""
        self._next, self._end = first, stop

    def _count(self, smoothed: NDArray[np.float32], numbers: Sequence[int], counted: Box) -> None:
        x, y, z = counted
        for values, number in zip(smoothed, numbers, strict=True):
            if max(z[0], self._next) <= number < min(z[1], self._end):
                inside = values[slice(*y), slice(*x)] >= self.level
                self.wrong_side += int(np.count_nonzero(inside != self._masks[number][slice(*y), slice(*x)]))
                self._next = number + 1
