# SPDX-License-Identifier: GPL-3.0-or-later
"""Prepare the field that a surface is extracted from: region, label, NaN, threshold and smoothing."""

from __future__ import annotations

import math

from ..errors import AbsentLabelError, SettingsError
from ..machine.budget import Budget
from ..progress import Stages, Steps
from ..settings import ReconstructionSettings
from ..volume.field import ScalarField
from ..volume.field_values import GrayValues, LabelMask
from ..volume.labels.extents import (
    existing_labels_steps,
    label_extent_steps,
    label_notes,
    layer_of_label_steps,
    require_labels,
)
from ..volume.region import grown_box, region_box, relative_box
from ..volume.statistics.thresholding import used_threshold_steps
from ..volume.value_kind import ValueKind
from ..volume.volume import Box, Volume
from .choices import for_labels_text, is_for_gray
from .methods import refinement_of, smoothing_of

VALUES_STAGE, LABEL_STAGE, SMOOTHING = "Checking values", "Finding the label", "Smoothing"


def field_steps(
    volume: Volume,
    settings: ReconstructionSettings,
    budget: Budget | None = None,
    window: Box | None = None,
    with_surface: bool = False,
    region: Box | None = None,
) -> Steps[ScalarField]:
    """Return the field of a volume that is extracted with some settings.

    Parameters
    ----------
    volume : Volume
    settings : ReconstructionSettings
    budget : Budget, optional
    window : Box, optional
        Result of `_field_window_steps`, if it is known already.
    with_surface : bool
        Whether the field is to keep the surface that smoothing measured, if that is the one of the settings but for its
        normals.
    region : Box, optional
        Result of `region_box`, if it is known already.

    Raises
    ------
    LabelError, ThresholdError, VolumeError, SettingsError, MemoryLimitError
    """
    budget = budget or Budget()
    smoothing = smoothing_of(settings)
    if budget.workers is not None and not smoothing.by_slabs:
        raise SettingsError(
            f"a label smoothed as {smoothing.name} cannot be extracted by several machines; "
            f"choose {smoothing.fallback or 'another smoothing'}"
        )
    region = region or region_box(volume, settings)
    if settings.label is not None:
        volume = yield from layer_of_label_steps(volume, settings.label, region, budget.threads)
    looking = VALUES_STAGE if settings.label is None else LABEL_STAGE
    stages = Stages({looking: 1} | ({SMOOTHING: smoothing.weight} if smoothing.smooths else {}))
    if window is None:
        window = yield from stages.run(looking, _field_window_steps(volume, settings, budget, region))
    reach = smoothing.reach(volume.spacing, settings)
    box = grown_box(window, [voxels + 1 for voxels in reach], volume.size)  # a voxel more, for normals
    origin = (box[0][0], box[1][0], box[2][0])
    part = volume.part(box)
    threshold = yield from stages.run(looking, used_threshold_steps(volume, settings))
    notes = smoothing.notes(settings)
    if settings.label is not None:
        notes = (*label_notes(volume, region), *notes)
    if settings.label is None and settings.threshold is None:
        advice = (
            "" if volume.kind != ValueKind.LABEL else " It does not separate labels: give one label, several or all."
        )
        notes = (f"No threshold or label was given: Otsu's threshold {threshold:g} is used.{advice}", *notes)
    inner = relative_box(window, origin)
    plain: GrayValues | LabelMask
    if settings.label is None:
        plain = GrayValues(part, relative_box(grown_box(window, reach, volume.size), origin), settings.nan_as)
    else:
        plain = LabelMask(part, settings.label)
    field = ScalarField(part, volume.shape, settings, plain, origin, window, threshold, notes, threshold, inner)
    if not smoothing.smooths:
        return field
    if not smoothing.by_slabs:
        field.check()  # before all of it is smoothed
    return (yield from stages.run(SMOOTHING, smoothing.field_steps(field, volume, budget, with_surface)))


def _field_window_steps(volume: Volume, settings: ReconstructionSettings, budget: Budget, region: Box) -> Steps[Box]:
    """Return the box that is extracted: the region, or in it a label's box with its margin."""
    window = region
    if settings.label is None and not is_for_gray(settings.smoothing_method):
        raise SettingsError(for_labels_text(settings.smoothing_method))
    if settings.label is not None:
        require_labels(volume)
        window = yield from _label_box_steps(volume, settings, settings.label, window, budget)
    return window


def _label_box_steps(
    volume: Volume, settings: ReconstructionSettings, label: int, window: Box, budget: Budget
) -> Steps[Box]:
    """Return the box of a label, its sides on the stride's grid, so that the surface is that of the whole window."""
    extent = yield from label_extent_steps(volume, label, window, budget.threads)
    if extent is None:
        existing = yield from existing_labels_steps(volume, window, budget.threads)
        raise AbsentLabelError(f"label {label} is empty {'in this region' if settings.region else 'here'}; {existing}")
    margin = [voxels + 1 for voxels in smoothing_of(settings).growth(volume.spacing, settings)]
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
