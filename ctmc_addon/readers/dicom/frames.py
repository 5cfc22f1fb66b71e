# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the position and scale of each frame of a DICOM file.

An enhanced multi-frame file keeps this in functional groups, per frame or shared by all
(DICOM PS3.3 C.7.6.16); a single-frame file has it at the top. Positions are in LPS+ mm.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, NamedTuple

MOST_MM = 1e6


class WrongGroups(ValueError):
    """A file has more or fewer functional groups than frames; the text has both numbers."""


class _Moment(NamedTuple):
    """The times and numbers that tell a frame from others at its position; empty or None if missing."""

    temporal: str = ""  # Number of the time point.
    acquisition: str = ""  # Number of the acquisition.
    trigger: float | None = None  # Milliseconds after the heart's trigger.
    acquired: tuple[str, str] | None = None  # Times of day.


class FrameGeometry(NamedTuple):
    """The position, moment and scale of one frame; None if missing."""

    position: tuple[float, ...] | None  # (x, y, z) of the first pixel's center
    orientation: tuple[float, ...] | None  # Direction of a row, then of a column.
    spacing: tuple[float, ...] | None  # Millimeters between rows, then between columns.
    slope: float
    intercept: float
    unit: str  # RescaleType, empty where there is none
    scout: bool
    moment: _Moment = _Moment()


def frame_geometries(dataset: Any, count: int) -> tuple[FrameGeometry, ...]:
    """Return position, moment and scale of every frame, in the order of its pixels.

    Parameters
    ----------
    dataset : mapping of str to object, or pydicom.Dataset
        Elements by keyword, without pixels.
    count : int
        The number of frames.

    Returns
    -------
    tuple of FrameGeometry
        `count` of them; what the file does not say is None in it.
    """
    shared_groups = dataset.get("SharedFunctionalGroupsSequence", None)
    shared = shared_groups[0] if shared_groups else None
    groups = dataset.get("PerFrameFunctionalGroupsSequence", None)
    if groups is None and shared is None:
        # A multi-frame file without groups has one position for all of its frames: no place for any.
        return (_geometry(dataset, (), count == 1),) * count
    if groups is not None and len(groups) != count:
        raise WrongGroups(f"{len(groups)} functional groups for {count} frames")
    frames = [(group, shared) for group in groups] if groups is not None else [(shared,)] * count
    return tuple(_geometry(dataset, frame, count == 1) for frame in frames)


def _geometry(dataset: Any, groups: tuple[Any, ...], top_level_place: bool) -> FrameGeometry:
    def value_of(sequence: str, keyword: str, top_level: bool = True) -> Any:
        """Return the value of the frame's own group, else of the shared one, else of the file."""
        for group in groups:
            items = group.get(sequence, None) if group is not None else None
            value = items[0].get(keyword, None) if items else None
            if value is not None:
                return value
        return dataset.get(keyword, None) if top_level else None

    frame_type = [str(word) for word in value_of("CTImageFrameTypeSequence", "FrameType", False) or ()]
    slope = value_of("PixelValueTransformationSequence", "RescaleSlope")
    intercept = value_of("PixelValueTransformationSequence", "RescaleIntercept")
    return FrameGeometry(
        numbers_of(value_of("PlanePositionSequence", "ImagePositionPatient", top_level_place), 3),
        numbers_of(value_of("PlaneOrientationSequence", "ImageOrientationPatient"), 6),
        numbers_of(value_of("PixelMeasuresSequence", "PixelSpacing"), 2, sys.float_info.max),
        1.0 if slope is None else float(slope),
        0.0 if intercept is None else float(intercept),
        str(value_of("PixelValueTransformationSequence", "RescaleType") or ""),
        "LOCALIZER" in frame_type,
        _moment(dataset, value_of),
    )


def _moment(dataset: Any, value_of: Callable[..., Any]) -> _Moment:
    temporal = value_of("FrameContentSequence", "TemporalPositionIndex", False)
    acquisition = value_of("FrameContentSequence", "FrameAcquisitionNumber", False)
    delay = value_of("CardiacSynchronizationSequence", "NominalCardiacTriggerDelayTime", False)
    phase = value_of("CardiacSynchronizationSequence", "NominalPercentageOfCardiacPhase", False)
    delay = phase if delay is None else delay
    trigger = numbers_of([dataset.get("TriggerTime", None) if delay is None else delay], 1)
    times = (str(dataset.get("AcquisitionTime", None) or ""), str(dataset.get("ContentTime", None) or ""))
    started = str(value_of("FrameContentSequence", "FrameReferenceDateTime", False) or "")
    return _Moment(
        str(temporal or dataset.get("TemporalPositionIdentifier", None) or ""),
        str(acquisition or dataset.get("AcquisitionNumber", None) or ""),
        trigger[0] if trigger else None,
        (started, "") if started else times if any(times) else None,
    )


def numbers_of(value: Any, count: int, most: float = MOST_MM) -> tuple[float, ...] | None:
    """Return `count` numbers of at most `most`, or None if the file has other values."""
    if value is None or isinstance(value, str) or not hasattr(value, "__len__") or len(value) != count:
        return None
    if None in value:
        return None
    numbers = tuple(float(number) for number in value)
    return numbers if all(abs(number) <= most for number in numbers) else None  # nor NaN
