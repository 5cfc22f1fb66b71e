# SPDX-License-Identifier: GPL-3.0-or-later
"""The scalar field that a surface is extracted from: region, label, NaN, threshold and smoothing.

Boxes are in voxel indices of the volume, three (start, stop) pairs in the order x, y, z.

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

from ..errors import LabelError, VolumeError
from ..memory import require
from ..progress import PAUSE, Stages, Step, Steps
from ..settings import ReconstructionSettings, constrained_threshold_error
from .affine import with_origin
from .labels import existing_labels_steps, label_extent_steps, require_labels
from .region import Box, box_slices, grown_box, region_box, relative_box
from .slabs import SlabVolume, values_in
from .smoothing import (
    REACH,
    SmoothField,
    automatic_refinement,
    constrained_bytes,
    constrained_steps,
    gaussian_smooth_steps,
    reach_of,
    refined_affine,
)
from .statistics import slabs_of
from .thresholding import WHOLE_VOLUME, check_threshold, used_threshold_steps
from .volume import Placed, Volume

SMOOTHING_STAGE = {"none": {}, "gaussian": {"Smoothing": 1}, "constrained": {"Smoothing": 6}}


@dataclass(frozen=True, eq=False)
class ScalarField:
    """Values to extract from, and their position in the volume.

    Parameters
    ----------
    values : (slices, rows, columns)
        Gray values, a label's 0 and 1, or of a label that is smoothed as constrained about the distance to its
        surface in mm, positive inside; of a box a little larger than the window.
    origin : (x, y, z) int
        The volume's index of the first value.
    window : Box
        The part of the volume that is extracted.
    threshold : float
        The gray value that is used; half of a label's 0 and 1.
    notes : tuple of str
    slice_steps, first_slice : int
        Every so many slices of the values, from this one, is one of the volume's.
    level : float
        Where the surface lies in the values: the threshold, or 0 mm.
    window_in_values : Box
        The window, counted from the first value.
    wrong_side : int or None
        Samples of the label in the window whose values are on the other side of the level; None without a label.
    working_bytes : int
        Memory that making the values took.
    kind, place : str
        What the values mean, as in `Volume`, and whose they are, for messages.
    """

    values: NDArray[Any]
    origin: tuple[int, int, int]
    window: Box
    threshold: float
    notes: tuple[str, ...]
    level: float
    window_in_values: Box
    slice_steps: int = 1
    first_slice: int = 0
    wrong_side: int | None = None
    working_bytes: int = 0
    kind: str = "grey value"
    place: str = WHOLE_VOLUME

    def affine(self, volume: Placed) -> NDArray[np.float64]:
        """The affine of the values: index (x, y, z) to RAS+ mm, (4, 4)."""
        return refined_affine(with_origin(volume.affine, self.origin), self.slice_steps, self.first_slice)


def scalar_field_steps(
    volume: Volume | SlabVolume,
    settings: ReconstructionSettings,
    threads: int | None = None,
    memory_limit: int | None = None,
    window: Box | None = None,
) -> Steps[ScalarField]:
    """Return what is extracted from `volume` with `settings`; of values that are fetched, it holds those of its box.

    `window` is what `field_window_steps` returned, where that is known already.

    Raises
    ------
    LabelError, ThresholdError, VolumeError, SettingsError, MemoryLimitError
    """
    method = settings.smoothing_method
    value_stage = "Looking at the values" if settings.label is None else "Finding the label"
    stages = Stages({value_stage: 1} | SMOOTHING_STAGE[method])
    if window is None:
        window = yield from stages.run(value_stage, field_window_steps(volume, settings, threads))
    reach = reach_of_settings(volume.spacing, settings)
    box = field_box(volume, settings, window)
    origin = (box[0][0], box[1][0], box[2][0])
    yield Step(0.0, value_stage)
    values = yield from stages.run(value_stage, _values_steps(volume, box, settings.label))
    place = WHOLE_VOLUME if settings.region is None else "the region"
    kind = volume.kind if settings.label is None else "label"
    if settings.label is not None:
        # A Gaussian brings what lies beyond the window into it.
        in_window = values if method == "gaussian" else values[box_slices(relative_box(window, origin))]
        check_not_filled(bool(in_window.all()), settings)
    else:
        if values.dtype.kind == "f":
            needed = relative_box(grown_box(window, reach, volume.size), origin)
            values = _finite(values, values[box_slices(needed)], settings.nan_as, memory_limit)
        if settings.threshold is not None:
            in_window = values[box_slices(relative_box(window, origin))]
            check_threshold(settings.threshold, in_window, volume.kind, place, settings.upper)
    threshold = yield from stages.run(value_stage, used_threshold_steps(volume, settings))
    notes = field_notes(settings, threshold)
    window_in_values = relative_box(window, origin)
    field = ScalarField(values, origin, window, threshold, notes, threshold, window_in_values, kind=kind, place=place)
    if method == "gaussian":
        require(
            9 * values.size,
            f"smoothing {values.shape[2]} x {values.shape[1]} x {values.shape[0]} voxels",
            "choose a region or do not smooth",
            memory_limit,
        )
        smoothing = gaussian_smooth_steps(values, volume.spacing, settings.gaussian_mm, threads)
        smoothed = yield from stages.run("Smoothing", smoothing)
        field = replace(field, values=smoothed, place=f"{place} after smoothing")
    elif method == "constrained" and not values.all():
        agreeing = _constrained_steps(field, volume, settings, threads, memory_limit)
        field = yield from stages.run("Smoothing", agreeing)
    return field if settings.label is None else replace(field, wrong_side=_wrong_side(field, values))


def _constrained_steps(
    field: ScalarField,
    volume: Placed,
    settings: ReconstructionSettings,
    threads: int | None,
    memory_limit: int | None,
) -> Steps[ScalarField]:
    """Return the field of a label, whose values are 0 and 1, with the smoothest values that agree with it."""
    mask, spacing = field.values, volume.spacing
    slice_steps = refinement_of(spacing, settings)
    yield PAUSE
    needed = constrained_bytes(mask, spacing, slice_steps, settings.close_border)
    slices, rows, columns = mask.shape
    require(
        needed,
        f"smoothing a label's {columns} x {rows} x {slices} voxels in {slice_steps} steps a slice",
        "choose a region, fewer slice_steps or smoothing none",
        memory_limit,
    )
    smooth = yield from constrained_steps(mask, spacing, slice_steps, settings.close_border, threads, memory_limit)
    steps = f", its slices in {slice_steps} steps each" if slice_steps > 1 else ""
    volumes = ""
    if settings.region is None or not _is_cut(field, volume):  # the volume is that of the label in the field's box
        volumes = (
            f"; the surface encloses {smooth.volume_mm3:.6g} mm3 at alpha 1 and stride 1, "
            f"the samples {smooth.label_mm3:.6g} mm3"
        )
    notes = [f"The label is smoothed with every sample on its own side{steps}{volumes}."]
    if slice_steps < automatic_refinement(spacing) and settings.slice_steps == 0:
        notes.append(f"Slices are not refined at a stride of {settings.stride[2]} along z.")
    return replace(
        field,
        values=smooth.values,
        notes=tuple(notes),
        level=0.0,
        window_in_values=_refined_window(field, volume, smooth, settings.close_border),
        slice_steps=slice_steps,
        first_slice=smooth.first_slice,
        working_bytes=needed + mask.size,
    )


def refinement_of(spacing_mm: tuple[float, float, float], settings: ReconstructionSettings) -> int:
    """Return the steps from slice to slice that settings give; 1 unless a label is smoothed as constrained."""
    if settings.smoothing_method != "constrained":
        return 1
    if settings.slice_steps == 0 and settings.stride[2] > 1:
        return 1
    return settings.slice_steps or automatic_refinement(spacing_mm)


def field_window_steps(
    volume: Volume | SlabVolume, settings: ReconstructionSettings, threads: int | None = None
) -> Steps[Box]:
    """Return the box that is extracted: the region, or in it a label's box with its margin."""
    window = region_box(volume, settings)
    if settings.smoothing_method == "constrained" and settings.label is None:
        raise constrained_threshold_error()
    if settings.label is not None:
        require_labels(volume, settings.label)
        window = yield from _label_box_steps(volume, settings, settings.label, window, threads)
    return window


def field_box(volume: Placed, settings: ReconstructionSettings, window: Box) -> Box:
    """Return the box of the values that smoothing and extraction read: window, reach, and a voxel for normals."""
    return grown_box(window, [voxels + 1 for voxels in reach_of_settings(volume.spacing, settings)], volume.size)


def _values_steps(volume: Volume | SlabVolume, box: Box, label: int | None) -> Steps[NDArray[Any]]:
    """Return the gray values in a box, or where a label is; a view where that is possible."""
    values = values_in(volume, box)
    if isinstance(values, np.ndarray):
        return values if label is None else values == label
    out = np.empty(values.shape, values.dtype if label is None else bool)
    done = 0
    for slab in slabs_of(values):
        yield Step(done / len(out))
        out[done : done + len(slab)] = slab if label is None else slab == label
        done += len(slab)
    return out


def reach_of_settings(spacing_mm: tuple[float, float, float], settings: ReconstructionSettings) -> list[int]:
    """Return how many voxels beyond the window smoothing reads along x, y and z."""
    if settings.smoothing_method == "constrained" and settings.region is not None:
        return [*reach_of(spacing_mm)]
    return [math.ceil(REACH * settings.gaussian_mm / side) for side in spacing_mm]


def field_notes(settings: ReconstructionSettings, threshold: float) -> tuple[str, ...]:
    """Return what is said of a threshold that was found, and of a label that is not smoothed."""
    if settings.label is None and settings.threshold is None:
        return (f"No threshold or label was given: Otsu's threshold {threshold:g} is used.",)
    if settings.label is not None and settings.smoothing_method == "none":
        return ("On a label that is not smoothed every crossing is the midpoint, and alpha has no effect.",)
    return ()


def check_not_filled(filled: bool, settings: ReconstructionSettings) -> None:
    """Raise `LabelError` where a label fills what is extracted, so that only a closed border gives a surface."""
    if filled and not settings.close_border:
        place, remedy = ("volume", "") if settings.region is None else ("region", " or a larger region")
        raise LabelError(f"every sample of this {place} is label {settings.label}; use close_border{remedy}")


def _is_cut(field: ScalarField, volume: Placed) -> bool:
    """Return whether a label reaches the border of its window where the volume goes on."""
    window = [
        (start + (start > 0), stop - (stop < n)) for (start, stop), n in zip(field.window, volume.size, strict=True)
    ]
    inner = relative_box((window[0], window[1], window[2]), field.origin)
    return np.count_nonzero(field.values[box_slices(inner)]) < np.count_nonzero(field.values)


def _refined_window(field: ScalarField, volume: Placed, smooth: SmoothField, close_border: bool) -> Box:
    """Return the window counted in refined slices; a closed border lies half a slice gap outside it."""
    x, y, (start, stop) = relative_box(field.window, field.origin)
    low, high = (smooth.first_slice + slice_ * smooth.slice_steps for slice_ in (start, stop - 1))
    if close_border:
        cap = (smooth.slice_steps - 1) // 2  # Marching Cubes adds half a refined slice
        low = 0 if field.window[2][0] == 0 else low - cap
        high = len(smooth.values) - 1 if field.window[2][1] == volume.size[2] else high + cap
    return x, y, (low, high + 1)


def _wrong_side(field: ScalarField, mask: NDArray[np.bool_]) -> int:
    """Return how many samples of a label, in the window, the field has on the other side of the surface."""
    x, y, z = box_slices(relative_box(field.window, field.origin))[::-1]
    count = 0
    for slice_ in range(z.start, z.stop):
        values = field.values[field.first_slice + slice_ * field.slice_steps, y, x]
        count += int(np.count_nonzero((values >= field.level) != mask[slice_, y, x]))
    return count


def _finite(values: NDArray[Any], needed: NDArray[Any], nan_as: float | None, memory_limit: int | None) -> NDArray[Any]:
    """Return floating values, NaN and infinite ones replaced in a copy; without `nan_as` none may be among `needed`."""
    if nan_as is None:
        count = sum(int(layer.size - np.count_nonzero(np.isfinite(layer))) for layer in needed)
        if count:
            raise VolumeError(not_finite_text(count))
        return values
    if all(np.isfinite(layer).all() for layer in values):
        return values
    require(values.nbytes, "replacing NaN voxels", "choose a region, or replace them in the file", memory_limit)
    replaced = np.array(values)
    for layer in replaced:
        layer[~np.isfinite(layer)] = nan_as
    return replaced


def not_finite_text(count: int) -> str:
    """Return what is wrong with values that are not finite, and the remedy."""
    return f"{count} voxels are NaN or infinite; replace them with nan_as, such as -1024 in HU"


def _label_box_steps(
    volume: Volume | SlabVolume, settings: ReconstructionSettings, label: int, window: Box, threads: int | None
) -> Steps[Box]:
    """Return the box of a label, its sides on the stride's grid, so that the surface is that of the whole window."""
    extent = yield from label_extent_steps(volume, label, window, threads)
    if extent is None:
        existing = yield from existing_labels_steps(volume, window, threads)
        raise LabelError(f"label {label} is empty {'in this region' if settings.region else 'here'}; {existing}")
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
