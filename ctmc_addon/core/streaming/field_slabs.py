# SPDX-License-Identifier: GPL-3.0-or-later
"""The scalar field of a volume that is not held in memory: the same values as scalar_field.py's, some slices at a time.

Region, box and reach are those of scalar_field.py. What that says before extraction because it has seen all values,
that no value is on one side of the threshold or that some are NaN, is said here as the values come.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError, VolumeError
from ..extraction.grid import Axis, make_axes
from ..extraction.marching_cubes import no_surface_text
from ..parallel import map_steps, worker_count
from ..progress import PAUSE, Steps
from ..settings import ReconstructionSettings
from ..volume.affine import with_origin
from ..volume.region import Box, box_slices, grown_box, relative_box
from ..volume.scalar_field import check_not_filled, field_box, field_notes, not_finite_text, reach_of_settings
from ..volume.slabs import SlabVolume
from ..volume.smoothing import smoothed_middle, smoothed_plane, weights
from ..volume.statistics import slabs_of
from ..volume.thresholding import WHOLE_VOLUME, check_threshold, used_threshold_steps
from ..volume.volume import Placed

SMOOTHING = "Smoothing"


class FieldSlabs:
    """Values to extract from, fetched some slices at a time; `field_slabs_steps` makes it.

    Attributes are those of `ScalarField`. Slices are counted from the box's first.
    """

    slice_steps = 1
    working_bytes = 0

    def __init__(
        self, volume: SlabVolume, settings: ReconstructionSettings, window: Box, threshold: float, threads: int | None
    ) -> None:
        reach = reach_of_settings(volume.spacing, settings)
        box = field_box(volume, settings, window)
        self.volume, self._threads = volume, worker_count(threads)
        self.origin = (box[0][0], box[1][0], box[2][0])
        self.settings, self.window, self.threshold, self.level = settings, window, threshold, threshold
        self.window_in_values = relative_box(window, self.origin)
        self.notes = field_notes(settings, threshold)
        self.kind = volume.kind if settings.label is None else "label"
        self.place = WHOLE_VOLUME if settings.region is None else "the region"
        self._needed = relative_box(grown_box(window, reach, volume.size), self.origin)
        self._values = volume.part(box)
        self.shape = self._values.shape
        smooths = settings.smoothing_method == "gaussian"
        self._kernels = [weights(settings.gaussian_mm / side) for side in volume.spacing] if smooths else None
        self.dtype = self._type()
        self.wrong_side: int | None = None if settings.label is None else 0
        self._planes: dict[int, NDArray[np.float32]] = {}  # slices that are smoothed along x and y
        self._masks: dict[int, NDArray[np.uint8]] = {}
        self._seen_below = self._seen_above = False
        self.counted = self.window_in_values[2]  # slices of which samples on the wrong side are counted

    def again(self) -> FieldSlabs:
        """The same field, to be fetched from its first slice."""
        return FieldSlabs(self.volume, self.settings, self.window, self.threshold, self._threads)

    def affine(self, volume: Placed) -> NDArray[np.float64]:
        """The affine of the values: index (x, y, z) to RAS+ mm, (4, 4)."""
        return with_origin(volume.affine, self.origin)

    def axes(self) -> tuple[Axis, Axis, Axis]:
        """The samples along x, y and z."""
        return make_axes(self.window_in_values, self.settings.stride, self.settings.close_border)

    @property
    def skips_slices(self) -> bool:
        """Whether slices that are not sampled need not be fetched: not where they are looked at for NaN or counted."""
        return self.dtype.kind != "f"

    def slices_steps(self, numbers: list[int]) -> Steps[NDArray[Any]]:
        """Fetch the values of slices with rising numbers, (slices, rows, columns)."""
        if not numbers:
            return np.empty((0, *self.shape[1:]), self.dtype)
        if self._kernels is not None:
            return (yield from self._smoothed_steps(numbers, self._kernels))
        return (yield from self._fetched_steps(numbers))

    @property
    def seen(self) -> tuple[bool, bool]:
        """Whether there were values of the window below the threshold, and others not below it."""
        return self._seen_below, self._seen_above

    def add_seen(self, seen: tuple[bool, bool], wrong_side: int | None) -> None:
        """Take over what others saw of the same field."""
        self._seen_below, self._seen_above = self._seen_below or seen[0], self._seen_above or seen[1]
        if wrong_side is not None:
            self.wrong_side = (self.wrong_side or 0) + wrong_side

    def check(self) -> None:
        """Raise what scalar_field.py raises where all values are on one side of the threshold."""
        if self._seen_below and self._seen_above:
            return
        window = self._values.part(self.window_in_values)
        if self.settings.label is not None:
            mask = window if self._kernels is None else self._values
            check_not_filled(all(bool((slab == self.settings.label).all()) for slab in slabs_of(mask)), self.settings)
        elif self.settings.threshold is not None:
            check_threshold(self.threshold, window, self.kind, self.place, self.settings.upper)

    def check_extracted_steps(self) -> Steps[None]:
        """Raise why there is no surface at all."""
        self.check()
        if self._kernels is None:
            window = self._values.part(self.window_in_values)
            check_threshold(self.level, window, self.kind, self.place, self.settings.upper)
        else:
            _, rows, columns = box_slices(self.window_in_values)
            self._planes, lows, highs = {}, [], []
            for slice_ in range(*self.window_in_values[2]):
                smoothed = yield from self.slices_steps([slice_])
                lows.append(smoothed[:, rows, columns].min())
                highs.append(smoothed[:, rows, columns].max())
            ends = np.array([[[min(lows), max(highs)]]])
            check_threshold(self.level, ends, self.kind, f"{self.place} after smoothing", self.settings.upper)
        raise MeshError(no_surface_text(self.level))

    def _type(self) -> np.dtype[Any]:
        if self._kernels is not None:
            return np.dtype(np.float32)
        if self.settings.label is not None or self._values.dtype == bool:
            return np.dtype(np.uint8)
        return self._values.dtype

    def _fetched_steps(self, numbers: list[int]) -> Steps[NDArray[Any]]:
        """Values before smoothing: gray values without NaN, or a label's 0 and 1."""
        rows, columns = range(self.shape[1]), range(self.shape[2])
        parts = []
        for run in runs_of(numbers):
            yield PAUSE
            parts.append(self._values.samples(run, rows, columns))
        if not parts:
            return np.empty((0, *self.shape[1:]), self.dtype)
        values = parts[0] if len(parts) == 1 else np.concatenate(parts)
        if self.settings.label is not None:
            values = (values == self.settings.label).view(np.uint8)
        elif values.dtype.kind == "f":
            values = self._finite(values, numbers)
        elif values.dtype == bool:
            values = values.view(np.uint8)
        self._see(values, numbers)
        return values

    def _finite(self, values: NDArray[Any], numbers: list[int]) -> NDArray[Any]:
        finite = np.isfinite(values)
        if finite.all():
            return values
        if self.settings.nan_as is not None:
            return np.where(finite, values, values.dtype.type(self.settings.nan_as))
        x, y, z = self._needed
        inner = [z[0] <= number < z[1] for number in numbers]
        if not finite[inner, slice(*y), slice(*x)].all():
            needed = self._values.part(self._needed)
            count = sum(int(slab.size - np.count_nonzero(np.isfinite(slab))) for slab in slabs_of(needed))
            raise VolumeError(not_finite_text(count))
        return values

    def _see(self, values: NDArray[Any], numbers: list[int]) -> None:
        """Note whether there are values of the window on either side of the threshold."""
        x, y, z = self.window_in_values
        in_window = [number for number, slice_ in enumerate(numbers) if z[0] <= slice_ < z[1]]
        if (self._seen_below and self._seen_above) or not in_window:
            return
        inside = values[in_window[0] : in_window[-1] + 1, slice(*y), slice(*x)] >= self.level
        self._seen_above |= bool(inside.any())
        self._seen_below |= not inside.all()

    def _smoothed_steps(self, numbers: list[int], kernels: list[list[np.float32]]) -> Steps[NDArray[Any]]:
        """Gaussian smoothing, the border repeated: the same sums as gaussian.py's of the whole box."""
        along_x, along_y, along_z = kernels
        reach, last = len(along_z) - 1, self.shape[0] - 1
        low, high = max(0, numbers[0] - reach), min(last, numbers[-1] + reach) + 1
        self._planes = {number: plane for number, plane in self._planes.items() if number >= low}
        wanted = [number for number in range(low, high) if number not in self._planes]
        fetched = yield from self._fetched_steps(wanted)
        planes = yield from map_steps(
            lambda plane: smoothed_plane(plane, along_x, along_y), list(fetched), self._threads, SMOOTHING
        )
        self._planes |= dict(zip(wanted, planes, strict=True))

        def across(number: int) -> NDArray[np.float32]:
            around = range(number - reach, number + reach + 1)
            return smoothed_middle([self._planes[min(max(at, 0), last)] for at in around], along_z)

        smoothed = np.stack((yield from map_steps(across, numbers, self._threads, SMOOTHING)))
        if self.settings.label is not None:
            self._masks = {number: mask for number, mask in self._masks.items() if number >= numbers[0]}
            self._masks |= dict(zip(wanted, fetched, strict=True))
            self._count_wrong_side(smoothed, numbers)
        return smoothed

    def _count_wrong_side(self, smoothed: NDArray[np.float32], numbers: list[int]) -> None:
        x, y, z = self.window_in_values
        for values, number in zip(smoothed, numbers, strict=True):
            if z[0] <= number < z[1] and self.counted[0] <= number < self.counted[1]:
                inside = values[slice(*y), slice(*x)] >= self.level
                self.wrong_side = (self.wrong_side or 0) + int(
                    np.count_nonzero(inside != self._masks[number][slice(*y), slice(*x)])
                )


def runs_of(numbers: list[int]) -> Iterator[range]:
    """Rising numbers as ranges.

    Examples
    --------
    >>> list(runs_of([0, 4, 8, 10]))
    [range(0, 9, 4), range(10, 11)]
    """
    start = 0
    while start < len(numbers):
        step = numbers[start + 1] - numbers[start] if start + 1 < len(numbers) else 1
        end = start + 1
        while end < len(numbers) and numbers[end] - numbers[end - 1] == step:
            end += 1
        yield range(numbers[start], numbers[end - 1] + 1, step)
        start = end


def field_slabs_steps(
    volume: SlabVolume, settings: ReconstructionSettings, window: Box, threads: int | None = None
) -> Steps[FieldSlabs]:
    """Return what is extracted from a window of a volume that is not in memory.

    Smoothing as constrained is not for it.

    Raises
    ------
    ThresholdError
        If Otsu's threshold is needed and all values in the region are equal or none is finite.
    """
    threshold = yield from used_threshold_steps(volume, settings)
    return FieldSlabs(volume, settings, window, threshold, threads)
