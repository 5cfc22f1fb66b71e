# SPDX-License-Identifier: GPL-3.0-or-later
"""The field that a surface is extracted from; `smoothing.prepare` makes it of a volume and settings.

Its values are fetched some slices at a time (field_values.py). Boxes are in voxel indices of the volume, three (start,
stop) pairs in the order x, y, z.

    region    what the settings ask for, or the whole volume
    window    the box that is extracted: the region, or in it a label's box with its margin
    margin    voxels that a label's box is wider than the label, on each side
    reach     voxels beyond the window that smoothing reads
    box       the window and its reach, and a voxel more for normals: the values that the field holds
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import LabelError, MeshError
from ..mesh.triangle_mesh import Surface
from ..progress import Step, Steps, finish
from ..settings import ReconstructionSettings
from ..smoothing.smooth_field import refined_affine
from .field_values import FieldValues, HeldValues
from .region import relative_box
from .statistics.thresholding import WHOLE_VOLUME, check_threshold
from .statistics.values import slabs_of, value_facts_steps
from .value_kind import ValueKind
from .volume import Box, Volume


@dataclass(frozen=True, eq=False)
class ScalarField:
    """The values that a surface is extracted from, and their position in the volume.

    Parameters
    ----------
    volume : Volume
        The box.
    whole : (slices, rows, columns)
        The volume that the field is a box of.
    settings : ReconstructionSettings
    values : FieldValues
        Gray values, a label's 0 and 1, those smoothed, or about the distance to the surface of a label in mm, positive
        inside; of a box a little larger than the window.
    origin : (x, y, z) int
        The volume's index of the first value.
    window : Box
        The part of the volume that is extracted.
    threshold : float
        The gray value that is used; half of a label's 0 and 1.
    notes : tuple of str
    level : float
        Value at the surface: the threshold, or 0 mm.
    window_in_values : Box
        The window, counted from the first value.
    slice_steps, first_slice : int
        Step between the volume's slices among those of the values, and the first of them.
    surface : Surface or None
        The surface of the values in index space, where smoothing has made it.
    """

    volume: Volume
    whole: tuple[int, int, int]
    settings: ReconstructionSettings
    values: FieldValues
    origin: tuple[int, int, int]
    window: Box
    threshold: float
    notes: tuple[str, ...]
    level: float
    window_in_values: Box
    slice_steps: int = 1
    first_slice: int = 0
    surface: Surface | None = None

    @property
    def affine(self) -> NDArray[np.float64]:
        """The affine of the values: index (x, y, z) to RAS+ mm, (4, 4)."""
        return refined_affine(self.volume.affine, self.slice_steps, self.first_slice)

    @property
    def wrong_side(self) -> int | None:
        """Samples of the label in the window whose values are on the other side of the level; None without a label."""
        return None if self.settings.label is None else self.values.wrong_side

    @property
    def kind(self) -> ValueKind:
        """Return the meaning of the values, as in `Volume`."""
        return self.volume.kind if self.settings.label is None else ValueKind.LABEL

    @property
    def place(self) -> str:
        """The part of the volume that the values are of, for messages."""
        return WHOLE_VOLUME if self.settings.region is None else "the region"

    def again(self) -> ScalarField:
        """Return the same field, to be fetched from its first slice."""
        return replace(self, values=self.values.again())

    def at_threshold(self, threshold: float) -> ScalarField:
        """Return the same field for another threshold of gray values."""
        return replace(self, threshold=threshold, level=threshold, notes=())

    def check(self) -> None:
        """Raise the reason if all values are on one side: no surface, or only the closed border."""
        if self.settings.label is None:
            if self.settings.threshold is not None:
                low, high, not_finite = finish(value_facts_steps(self.volume.part(self._window_of_volume)))
                replaced = self.settings.nan_as if not_finite else None
                ends = [low, high] if replaced is None else [low, high, replaced]
                check_threshold(self.threshold, np.array([[ends]]), self.kind, self.place, self.settings.upper)
        elif not self.settings.close_border:
            # Smoothing brings what lies beyond the window into it.
            looked_at = self.volume if self.values.mixes_samples else self.volume.part(self._window_of_volume)
            if all(bool((slab == self.settings.label).all()) for slab in slabs_of(looked_at)):
                place, remedy = ("volume", "") if self.settings.region is None else ("region", " or a larger region")
                raise LabelError(
                    f"every sample of this {place} is label {self.settings.label}; use close_border{remedy}"
                )

    def check_closed(self) -> None:
        """Raise what `check` does where a surface may be nothing but the closed border; quick where it is not."""
        settings = self.settings
        if not settings.close_border or settings.label is not None or settings.threshold is None:
            return
        window = self.volume.part(self._window_of_volume)
        if not any(bool((slab < settings.threshold).any()) for slab in slabs_of(window)):
            self.check()

    def check_extracted_steps(self) -> Steps[None]:
        """Raise the error that says why there is no surface at all.

        Raises
        ------
        ThresholdError
            If no sample or every sample is inside.
        MeshError
            If samples lie on both sides but the strided grid misses them.
        """
        self.check()
        x, y, z = self.window_in_values
        values = self.values.again()
        lows, highs = [], []
        for slice_ in range(*z):
            layer = (yield from values.slices_steps([slice_]))[0, slice(*y), slice(*x)]
            finite = layer[np.isfinite(layer)] if layer.dtype.kind == "f" else layer
            if finite.size:
                lows.append(float(finite.min()))
                highs.append(float(finite.max()))
        smoothed = " after smoothing" if self.values.mixes_samples else ""
        ends = np.array([[[min(lows, default=math.nan), max(highs, default=math.nan)]]])
        check_threshold(self.level, ends, self.kind, f"{self.place}{smoothed}", self.settings.upper)
        raise MeshError(f"threshold {self.level:g} separates no samples of this grid; use a smaller stride")

    @property
    def _window_of_volume(self) -> Box:
        return relative_box(self.window, self.origin)


def all_values_steps(values: FieldValues) -> Steps[NDArray[Any]]:
    """Return all values at once, fetched a few slices at a time where they are not held."""
    slices, rows, columns = values.shape
    if values.held:
        return (yield from values.slices_steps(range(slices)))
    out = np.empty(values.shape, values.dtype)
    step = max(1, (1 << 22) // (rows * columns))
    for start in range(0, slices, step):
        yield Step(start / slices)
        out[start : start + step] = yield from values.slices_steps(range(start, min(start + step, slices)))
    return out


def held_steps(field: ScalarField) -> Steps[ScalarField]:
    """Return the field with all its values in memory, for work that reads them again and again."""
    if isinstance(field.values, HeldValues):
        return field
    values = yield from all_values_steps(field.values)
    return replace(field, values=HeldValues(values, field.values.wrong_side, field.values.mixes_samples))
