# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether the values of a volume are read into memory or fetched a slab at a time, and the field that follows."""

from __future__ import annotations

import math

from ..errors import MemoryLimitError, SettingsError
from ..memory import available_bytes, require
from ..progress import Stages, Steps
from ..settings import ReconstructionSettings
from ..volume.region import Box
from ..volume.scalar_field import ScalarField, field_box, field_window_steps, reach_of_settings, scalar_field_steps
from ..volume.slabs import SlabVolume
from ..volume.volume import Volume
from .field_slabs import FieldSlabs, field_slabs_steps
from .parts import WORK_BYTES, WORK_FACTOR

SMALL_BYTES = 1 << 26  # that are read into memory even under a stride, where they fit
SHARE = 0.25  # of the memory, that values may take beside the surface
BITS, SMOOTHED = 0.125, 8.0  # bytes a sample, of comparing and of Gaussian smoothing


def field_steps(
    volume: Volume | SlabVolume,
    settings: ReconstructionSettings,
    threads: int | None = None,
    memory_limit: int | None = None,
    by_slabs: bool = False,
) -> Steps[ScalarField | FieldSlabs]:
    """Return what is extracted from a volume: in memory where it fits beside the surface.

    Values that are fetched are read into memory only where that is quicker: not under a stride, which leaves most
    of them out, nor `by_slabs`, where workers fetch them.

    Raises
    ------
    LabelError, ThresholdError, VolumeError, SettingsError, MemoryLimitError
    """
    constrained = settings.smoothing_method == "constrained"
    if isinstance(volume, Volume):
        try:
            return (yield from scalar_field_steps(volume, settings, threads, memory_limit))
        except MemoryLimitError:
            if constrained:
                raise
        volume, by_slabs = SlabVolume.of(volume), True  # smoothed, or without NaN, a slab at a time
    stages = Stages({"Finding the region": 1, "Preparing values": 9})
    window = yield from stages.run("Finding the region", field_window_steps(volume, settings, threads))
    if by_slabs and constrained:
        raise SettingsError("a label smoothed as constrained cannot be extracted by several machines; choose gaussian")
    if not by_slabs and (constrained or in_memory(volume, settings, window, memory_limit)):
        if constrained:
            require(
                bytes_in_memory(volume, settings, window),
                f"smoothing label {settings.label}",
                "choose a region, or another smoothing",
                memory_limit,
            )
        reading = scalar_field_steps(volume, settings, threads, memory_limit, window)
        return (yield from stages.run("Preparing values", reading))
    return (yield from stages.run("Preparing values", field_slabs_steps(volume, settings, window, threads)))


def in_memory(volume: SlabVolume, settings: ReconstructionSettings, window: Box, memory_limit: int | None) -> bool:
    """Return whether the values of a window are read into memory."""
    needed = bytes_in_memory(volume, settings, window)
    return (max(settings.stride) == 1 or needed <= SMALL_BYTES) and fits_in_memory(needed, memory_limit)


def fits_in_memory(value_bytes: int, memory_limit: int | None = None) -> bool:
    """Return whether so many bytes leave enough memory for a surface beside them."""
    limit = available_bytes() if memory_limit is None else memory_limit
    return limit is None or value_bytes <= SHARE * limit


def widest_slices(volume: Volume | SlabVolume, settings: ReconstructionSettings, limit: int) -> int:
    """Return the side in voxels of the largest square slices whose slabs are extracted in so many bytes."""
    values = volume.values if isinstance(volume, Volume) else volume
    smooths = settings.smoothing_method == "gaussian"
    voxel_bytes = WORK_FACTOR * (settings.stride[2] + 1) * (4 if smooths else values.dtype.itemsize)
    if smooths:
        voxel_bytes += 4 * (2 * reach_of_settings(volume.spacing, settings)[2] + 1)
    return math.isqrt(max(0, limit - WORK_BYTES) // voxel_bytes)


def bytes_in_memory(volume: SlabVolume, settings: ReconstructionSettings, window: Box) -> int:
    """Return the bytes that the values of a window take in memory until the surface is made."""
    samples = math.prod(stop - start for start, stop in field_box(volume, settings, window))
    value_bytes = volume.dtype.itemsize if settings.label is None else 1
    smoothed = SMOOTHED if settings.smoothing_method == "gaussian" else 0.0
    return int(samples * (value_bytes + BITS + smoothed))
