# SPDX-License-Identifier: GPL-3.0-or-later
"""Open a DICOM file by its content: an image of a series, a dose, a segmentation or a structure set."""

from __future__ import annotations

from pathlib import Path

from ...core import Steps
from ..result import VolumeSource
from .header import is_multi_frame
from .labels import segmentation, structures
from .labels.classes import DOSE, SEGMENTATION, STRUCTURES, object_class
from .series import series


def open_steps(path: Path) -> Steps[VolumeSource]:
    """Open the labels or the dose of a file, or the series that it is an image of."""
    kind = object_class(path)
    if kind == SEGMENTATION:
        return (yield from segmentation.open_steps(path))
    if kind == STRUCTURES:
        return (yield from structures.open_steps(path))
    if kind == DOSE:
        return (yield from series.open_dose_steps(path))
    return (yield from series.open_steps(path))


def is_whole_volume(path: Path) -> bool:
    """Return whether a file is a volume by itself, and not a slice of its folder."""
    return object_class(path) in (SEGMENTATION, STRUCTURES, DOSE) or is_multi_frame(path)
