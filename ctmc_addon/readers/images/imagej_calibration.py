# SPDX-License-Identifier: GPL-3.0-or-later
"""Turn stored numbers into gray values as ImageJ does: by the calibration function cf and its coefficients c0, c1.

ImageJ has no signed 16 bits: it stores HU without a sign and writes the straight line back to them into the file.
Codes and rules are those of ij.measure.Calibration, ij.io.FileSaver and ij.io.FileOpener.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from .tiff_page import BLACK_IS_ZERO, PageLayout

STRAIGHT_LINE, NONE = 0, 20  # Values of cf.
FUNCTIONS = {
    1: "polynomial of degree 2",
    2: "polynomial of degree 3",
    3: "polynomial of degree 4",
    4: "exponential",
    5: "power",
    6: "logarithm",
    7: "Rodbard",
    8: "gamma variate",
    9: "logarithm with offset",
    10: "Rodbard of NIH Image",
    11: "exponential with offset",
    12: "Gaussian",
    13: "exponential recovery",
    21: "uncalibrated optical density",
    22: "custom",
}
SIGNED_16_BIT_OFFSET = 1 << 15  # ImageJ adds it to signed 16 bit values when it opens them, before calibration.


class ImageJCalibration(NamedTuple):
    """The straight line from stored numbers to gray values: slope x stored + intercept."""

    slope: float = 1.0
    intercept: float = 0.0
    notes: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """Return the straight line as text, for a sentence that compares calibrations."""
        if (self.slope, self.intercept) == (1.0, 0.0):
            return "without ImageJ's calibration"
        return f"calibrated as {_line(self.slope, self.intercept)}"


def calibration_of(about: Mapping[str, Any], layout: PageLayout) -> ImageJCalibration:
    """Return the calibration of a TIFF of ImageJ.

    Parameters
    ----------
    about : mapping
        The lines of its description, as tifffile reads them.
    layout : PageLayout
        Of its pages.

    Returns
    -------
    ImageJCalibration
        The identity where there is none, or none that is applied; a note names one that is not.
    """
    code = about.get("cf")
    if code is None or code == NONE:
        return ImageJCalibration()
    unfit = _unfit(layout)
    if unfit:
        return ImageJCalibration(notes=(f"ImageJ's calibration is not applied: cf={code} is for {unfit}",))
    slope, intercept = (_number(about.get(name)) for name in ("c1", "c0"))
    remedy = "; in ImageJ, Image > Type > 32-bit applies it before saving"
    if code != STRAIGHT_LINE or isinstance(code, bool):
        why = f"cf={code} ({FUNCTIONS.get(code, 'unknown') if isinstance(code, int) else 'unknown'})"
    elif slope is None or intercept is None or slope == 0.0:
        why, remedy = f"cf=0, c0={about.get('c0', 'missing')}, c1={about.get('c1', 'missing')}", ""
    elif layout.photometric != BLACK_IS_ZERO:
        why = f"cf=0 of a picture {'with a palette' if layout.colors is not None else 'in which 0 is white'}"
    else:
        if layout.dtype.kind == "i":
            intercept += slope * SIGNED_16_BIT_OFFSET
        if (slope, intercept) == (1.0, 0.0):
            return ImageJCalibration()
        notes = [f"ImageJ's calibration was applied: gray value = {_line(slope, intercept)}"]
        if about.get("zeroclip") is True:
            notes.append("ImageJ's zeroclip is not applied: gray values below 0 are kept")
        return ImageJCalibration(slope, intercept, tuple(notes))
    return ImageJCalibration(
        notes=(f"ImageJ's calibration {why} is not applied: gray values are those stored{remedy}",)
    )


def _unfit(layout: PageLayout) -> str:
    """Return the pixels that ImageJ calibrates and those of the file, '' where they are the same."""
    if layout.samples > 1:
        return "gray values, and this file has colors"
    if layout.bits not in (8, 16) or layout.dtype.kind not in "iu" or layout.dtype == np.int8:
        return f"8 and 16 bits, and this file has {layout.dtype.name}"
    return ""


def _line(slope: float, intercept: float) -> str:
    sign = "-" if intercept < 0 else "+"
    return f"{slope:.10g} x stored {sign} {abs(intercept):.10g}"


def _number(value: Any) -> float | None:
    """Return a finite number, or None."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None
