# SPDX-License-Identifier: GPL-3.0-or-later
"""The field that a surface is extracted from: region, label, NaN, threshold and smoothing.

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

from ..budget import Budget
from ..errors import AbsentLabelError, LabelError, MeshError, SettingsError
from ..mesh.triangle_mesh import Surface
from ..progress import PAUSE, Stages, Step, Steps, finish
from ..settings import ReconstructionSettings, constrained_threshold_error
from ..units import volume_text
from .field_values import FieldValues, GaussianValues, GrayValues, HeldValues, LabelMask
from .labels import existing_labels_steps, label_extent_steps, label_notes, layer_of_label_steps, require_labels
from .region import box_slices, grown_box, region_box, relative_box
from .smoothing import (
    REACH,
    REMEDY,
    SmoothField,
    automatic_refinement,
    constrained_steps,
    refined_affine,
    smoothing_of,
)
from .statistics import slabs_of, value_facts_steps
from .thresholding import WHOLE_VOLUME, check_threshold, used_threshold_steps
from .value_kind import ValueKind
from .volume import Box, Placed, Volume

VALUES_STAGE, LABEL_STAGE, SMOOTHING = "Looking at the values", "Finding the label", "Smoothing"


@dataclass(frozen=True, eq=False)
class Field:
    """The values that a surface is extracted from, and their position in the volume.

    Parameters
    ----------
    volume : Volume
        The box.
    whole : (slices, rows, columns)
        The volume that the field is a box of.
    settings : ReconstructionSettings
    values : FieldValues
        Gray values, a label's 0 and 1, or of a label that is smoothed as constrained about the distance to its
        surface in mm, positive inside; of a box a little larger than the window.
    origin : (x, y, z) int
        The volume's index of the first value.
    window : Box
        The part of the volume that is extracted.
    threshold : float
        The gray value that is used; half of a label's 0 and 1.
    notes : tuple of str
    level : float
        Where the surface lies in the values: the threshold, or 0 mm.
    window_in_values : Box
        The window, counted from the first value.
    slice_steps, first_slice : int
        Every so many slices of the values, from this one, is one of the volume's.
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
        """What the values mean, as in `Volume`."""
        return self.volume.kind if self.settings.label is None else ValueKind.LABEL

    @property
    def place(self) -> str:
        """The part of the volume that the values are of, for messages."""
        return WHOLE_VOLUME if self.settings.region is None else "the region"

    def again(self) -> Field:
        """The same field, to be fetched from its first slice."""
        return replace(self, values=self.values.again())

    def at_threshold(self, threshold: float) -> Field:
        """The same field for another threshold of gray values."""
        return replace(self, threshold=threshold, level=threshold, notes=())

    def check(self) -> None:
        """Raise why there would be no surface, or none but the closed border, where all values are on one side."""
        if self.settings.label is None:
            if self.settings.threshold is not None:
                low, high, not_finite = finish(value_facts_steps(self.volume.part(self._window_of_volume)))
                replaced = self.settings.nan_as if not_finite else None
                ends = [low, high] if replaced is None else [low, high, replaced]
                check_threshold(self.threshold, np.array([[ends]]), self.kind, self.place, self.settings.upper)
        elif not self.settings.close_border:
            # A Gaussian brings what lies beyond the window into it.
            gaussian = self.settings.smoothing_method == "gaussian"
            looked_at = self.volume if gaussian else self.volume.part(self._window_of_volume)
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
        smoothed = " after smoothing" if self.settings.smoothing_method == "gaussian" else ""
        ends = np.array([[[min(lows, default=math.nan), max(highs, default=math.nan)]]])
        check_threshold(self.level, ends, self.kind, f"{self.place}{smoothed}", self.settings.upper)
        raise MeshError(f"no sample of this grid is cut off by threshold {self.level:g}; use a smaller stride")

    @property
    def _window_of_volume(self) -> Box:
        return relative_box(self.window, self.origin)


def field_steps(
    volume: Volume,
    settings: ReconstructionSettings,
    budget: Budget | None = None,
    window: Box | None = None,
    with_surface: bool = False,
    region: Box | None = None,
) -> Steps[Field]:
    """Return what is extracted from a volume with some settings.

    Parameters
    ----------
    volume : Volume
    settings : ReconstructionSettings
    budget : Budget, optional
    window : Box, optional
        What `field_window_steps` returned, where that is known already.
    with_surface : bool
        Whether the field is to keep the surface that smoothing measured, if that is the one of the settings but for its
        normals.
    region : Box, optional
        What `region_box` returned, where that is known already.

    Raises
    ------
    LabelError, ThresholdError, VolumeError, SettingsError, MemoryLimitError
    """
    budget = budget or Budget()
    smoothing = smoothing_of(settings)
    if budget.workers is not None and not smoothing.by_slabs:
        raise SettingsError(
            f"a label smoothed as {settings.smoothing_method} cannot be extracted by several machines; choose gaussian"
        )
    region = region or region_box(volume, settings)
    if settings.label is not None:
        volume = yield from layer_of_label_steps(volume, settings.label, region, budget.threads)
    looking = VALUES_STAGE if settings.label is None else LABEL_STAGE
    stages = Stages({looking: 1} | ({SMOOTHING: smoothing.weight} if smoothing.weight else {}))
    if window is None:
        window = yield from stages.run(looking, field_window_steps(volume, settings, budget, region))
    reach = smoothing.reach(volume.spacing, settings)
    box = grown_box(window, [voxels + 1 for voxels in reach], volume.size)  # a voxel more, for normals
    origin = (box[0][0], box[1][0], box[2][0])
    part = volume.part(box)
    threshold = yield from stages.run(looking, used_threshold_steps(volume, settings))
    notes = smoothing.notes(settings)
    if settings.label is not None:
        notes = (*label_notes(volume, region), *notes)
    if settings.label is None and settings.threshold is None:
        advice = "" if volume.kind != ValueKind.LABEL else " It tells no labels apart: give one, several or all."
        notes = (f"No threshold or label was given: Otsu's threshold {threshold:g} is used.{advice}", *notes)
    inner = relative_box(window, origin)
    plain: GrayValues | LabelMask
    if settings.label is None:
        plain = GrayValues(part, relative_box(grown_box(window, reach, volume.size), origin), settings.nan_as)
    else:
        plain = LabelMask(part, settings.label)
    field = Field(part, volume.shape, settings, plain, origin, window, threshold, notes, threshold, inner)
    if settings.smoothing_method == "gaussian":
        counted = None if settings.label is None else inner
        smoothed = GaussianValues(plain, volume.spacing, settings.gaussian_mm, counted, threshold, budget)
        field = replace(field, values=smoothed)
    elif settings.smoothing_method == "constrained":
        field.check()
        field = yield from stages.run(SMOOTHING, _constrained_steps(field, volume, budget, with_surface))
    return field


def _constrained_steps(field: Field, volume: Placed, budget: Budget, with_surface: bool) -> Steps[Field]:
    """Return the field of a label with the smoothest values that agree with it, all of them in memory."""
    settings, spacing = field.settings, volume.spacing
    budget.require(math.prod(field.values.shape), f"smoothing label {settings.label}", REMEDY)
    mask = (yield from _all_steps(field.values)).view(bool)
    if mask.all():
        return field
    slice_steps = refinement_of(spacing, settings)
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
        words = "closed flat at the border, the surface would enclose" if is_open else "the surface encloses"
        surface, samples = (volume_text(each, 6) for each in (smooth.volume_mm3, smooth.label_mm3))
        volumes = f"; {words} {surface} at alpha 1 and stride 1, the samples {samples}"
    notes = [*field.notes, smoothed_note(slice_steps, volumes)]
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


def smoothed_note(slice_steps: int, volumes: str = "") -> str:
    """Return the note on a label that was smoothed as constrained, in so many steps a slice.

    `volumes` says after a semicolon what it encloses.
    """
    steps = f", its slices in {slice_steps} steps each" if slice_steps > 1 else ""
    return f"The label is smoothed with every sample on its own side{steps}{volumes}."


def _all_steps(values: FieldValues) -> Steps[NDArray[Any]]:
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


def held_steps(field: Field) -> Steps[Field]:
    """Return the field with all its values in memory, for works that ask for them again and again."""
    if isinstance(field.values, HeldValues):
        return field
    values = yield from _all_steps(field.values)
    return replace(field, values=HeldValues(values, field.values.wrong_side))


def refinement_of(spacing_mm: tuple[float, float, float], settings: ReconstructionSettings) -> int:
    """Return the steps from slice to slice that settings give; 1 unless a label is smoothed as constrained."""
    return smoothing_of(settings).slice_steps(spacing_mm, settings)


def field_window_steps(volume: Volume, settings: ReconstructionSettings, budget: Budget, region: Box) -> Steps[Box]:
    """Return the box that is extracted: the region, or in it a label's box with its margin."""
    window = region
    if settings.smoothing_method == "constrained" and settings.label is None:
        raise constrained_threshold_error()
    if settings.label is not None:
        require_labels(volume)
        window = yield from _label_box_steps(volume, settings, settings.label, window, budget)
    return window


def _is_cut(field: Field, mask: NDArray[np.bool_], volume: Placed) -> bool:
    """Return whether a label reaches the border of its window where the volume goes on."""
    x, y, z = (
        (start + (start > 0), stop - (stop < n)) for (start, stop), n in zip(field.window, volume.size, strict=True)
    )
    return _reaches_out(field, mask, (x, y, z))


def _reaches_border(field: Field, mask: NDArray[np.bool_], volume: Placed) -> bool:
    """Return whether a label reaches the border of the volume, where its surface is open unless it is closed there."""
    x, y, z = ((1, n - 1) for n in volume.size)
    return _reaches_out(field, mask, (x, y, z))


def _reaches_out(field: Field, mask: NDArray[np.bool_], box: Box) -> bool:
    """Return whether a label has samples outside a box of the volume."""
    inner = tuple(
        (max(start, 0), min(stop, n))
        for (start, stop), n in zip(relative_box(box, field.origin), mask.shape[::-1], strict=True)
    )
    return np.count_nonzero(mask[box_slices((inner[0], inner[1], inner[2]))]) < np.count_nonzero(mask)


def _refined_window(field: Field, volume: Placed, smooth: SmoothField, close_border: bool) -> Box:
    """Return the window counted in refined slices; a closed border lies half a slice gap outside it."""
    x, y, (start, stop) = relative_box(field.window, field.origin)
    low, high = (smooth.first_slice + slice_ * smooth.slice_steps for slice_ in (start, stop - 1))
    if close_border:
        cap = (smooth.slice_steps - 1) // 2  # Marching Cubes adds half a refined slice
        low = 0 if field.window[2][0] == 0 else low - cap
        high = len(smooth.values) - 1 if field.window[2][1] == volume.size[2] else high + cap
    return x, y, (low, high + 1)


def _wrong_side(field: Field, values: NDArray[np.float32], mask: NDArray[np.bool_]) -> int:
    """Return how many samples of a label, in the window, the values have on the other side of the surface."""
    x, y, z = box_slices(relative_box(field.window, field.origin))[::-1]
    count = 0
    for slice_ in range(z.start, z.stop):
        layer = values[field.first_slice + slice_ * field.slice_steps, y, x]
        count += int(np.count_nonzero((layer >= field.level) != mask[slice_, y, x]))
    return count


def _label_box_steps(
    volume: Volume, settings: ReconstructionSettings, label: int, window: Box, budget: Budget
) -> Steps[Box]:
    """Return the box of a label, its sides on the stride's grid, so that the surface is that of the whole window."""
    extent = yield from label_extent_steps(volume, label, window, budget.threads)
    if extent is None:
        existing = yield from existing_labels_steps(volume, window, budget.threads)
        raise AbsentLabelError(f"label {label} is empty {'in this region' if settings.region else 'here'}; {existing}")
    margin = [math.ceil(REACH * settings.gaussian_mm / side) + 1 for side in volume.spacing]
    box = []
    for axis, ((start, stop), (first, end)) in enumerate(zip(window, extent.box, strict=True)):
        steps = refinement_of(volume.spacing, settings) if axis == 2 else 1
        samples = math.ceil(settings.stride[axis] / steps)
        stride = settings.stride[axis] // math.gcd(settings.stride[axis], steps)  # to where a sample is one of the grid
        low = max(0, first - start - margin[axis]) // stride * stride
        low = min(low, (stop - start - 1 - samples) // stride * stride)  # a whole voxel before a last, partial one
        high = -(-(end - 1 - start + margin[axis]) // stride) * stride
        box.append((start + low, min(stop, start + high + 1)))
    return (box[0], box[1], box[2])
