# SPDX-License-Identifier: GPL-3.0-or-later
"""Place the frames of a DICOM dose (RTDOSE), and scale them to Gy.

DICOM PS3.3 C.8.8.3.2: GridFrameOffsetVector is relative to the first frame, along the cross product of the directions
of rows and columns, if its first value is 0; else it holds the z of each frame in the patient, if its first value is z
of ImagePositionPatient. Values are DoseGridScaling times what is stored.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core import one_line
from .frames import FrameGeometry, WrongGroups, numbers_of

SAME_Z = 0.01  # Millimeters; files round positions.
GY = "GY"


def dose_frames(elements: Any, count: int) -> tuple[FrameGeometry, ...]:
    """Return position and scale of each frame, in the order of its pixels.

    Parameters
    ----------
    elements : mapping of str to object
        By keyword, without pixels.
    count : int
        Number of frames.

    Raises
    ------
    WrongGroups
        If frames have no place, or values no scale.
    """
    position = numbers_of(elements.get("ImagePositionPatient", None), 3)
    orientation = numbers_of(elements.get("ImageOrientationPatient", None), 6)
    spacing = numbers_of(elements.get("PixelSpacing", None), 2)
    scale = numbers_of([elements.get("DoseGridScaling", None)], 1)
    given = elements.get("GridFrameOffsetVector", None)
    offsets = numbers_of([given] if isinstance(given, float) else given, count)
    if scale is None or scale[0] <= 0:
        raise WrongGroups("DoseGridScaling is missing or not above 0")
    if position is None or orientation is None:
        raise WrongGroups("ImagePositionPatient or ImageOrientationPatient is missing")
    if offsets is None:
        if count > 1:
            length = len(given) if hasattr(given, "__len__") else 0
            raise WrongGroups(f"GridFrameOffsetVector has {length} numbers for {count} frames")
        offsets = (0.0,)
    row, column = np.array(orientation[:3]), np.array(orientation[3:])
    normal = np.cross(row, column)
    first = offsets[0]
    if first != 0 and abs(first - position[2]) > SAME_Z:
        raise WrongGroups(
            f"GridFrameOffsetVector begins with {first:g}, which is neither 0 nor z of the first frame, {position[2]:g}"
        )
    along = normal if first == 0 else np.array([0.0, 0.0, 1.0])
    places = [tuple((np.array(position) + (offset - first) * along).tolist()) for offset in offsets]
    unit = str(elements.get("DoseUnits", None) or GY).upper()
    return tuple(FrameGeometry(place, orientation, spacing, scale[0], 0.0, unit, False) for place in places)


def dose_remarks(elements: Any) -> tuple[str, ...]:
    """Return notes on a dose."""
    remarks = []
    unit = str(elements.get("DoseUnits", None) or GY).upper()
    if unit != GY:
        remarks.append(f"the dose is not in Gy: DoseUnits is {one_line(unit)}")
    kind = str(elements.get("DoseType", None) or "PHYSICAL").upper()
    if kind == "EFFECTIVE":
        remarks.append("the dose is weighted by its biological effect (DoseType EFFECTIVE)")
    elif kind != "PHYSICAL":
        remarks.append(f"the values are not a physical dose (DoseType {one_line(kind)})")
    summed = str(elements.get("DoseSummationType", None) or "PLAN").upper()
    if summed not in ("PLAN", "MULTI_PLAN", "PLAN_OVERVIEW"):
        remarks.append(f"the dose is a part of the plan's (DoseSummationType {one_line(summed)})")
    return tuple(remarks)
