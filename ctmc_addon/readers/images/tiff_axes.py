# SPDX-License-Identifier: GPL-3.0-or-later
"""Read what ImageJ and OME write into a TIFF: the slice, time and channel of each page, spacing and calibration.

Axes are tifffile's letters: Z slices, T times, C channels, S samples of a pixel.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ...core import ReadError
from ..length_units import in_mm
from .imagej_calibration import ImageJCalibration, calibration_of
from .tiff_page import PageLayout

PIXELS = ("pixel", "pixels")  # Units that ImageJ writes for a picture without a scale.
MOST_CHANNELS = 4  # Up to this many channels may be real; ImageJ also calls the slices of a plain stack channels.
LONGEST_TEXT = 1 << 20  # Only this many letters of a description are searched.


class Pages(NamedTuple):
    """The pages of a series that are slices: `first` and every `step`-th after it, `slices` at each of `times`."""

    slices: int
    times: int
    step: int
    time_step: int
    notes: tuple[str, ...] = ()

    def first(self, time: int) -> int:
        """Return the page number of the first slice at a time, which counts from 1."""
        return (time - 1) * self.time_step


def pages_of_axes(axes: str, shape: tuple[int, ...], path: Path) -> Pages:
    """Return the slices and times among the pages of a series; of several channels the first is taken.

    Parameters
    ----------
    axes : str
        A letter for each axis, as tifffile names them.
    shape : tuple of int
        The size along each.
    path : Path
        For errors.

    Raises
    ------
    ReadError
        If there is a single slice, or more than one time and channel that cannot be told apart.

    Examples
    --------
    >>> pages_of_axes("TZYX", (2, 3, 8, 9), Path("a.tif"))
    Pages(slices=3, times=2, step=1, time_step=3, notes=())
    """
    sides = [(axis, int(side)) for axis, side in zip(axes, shape, strict=True) if axis not in "SYX" and side > 1]
    letters = [axis for axis, _ in sides]
    several = " x ".join(f"{axis} {side}" for axis, side in zip(axes, shape, strict=True))
    if not sides:
        raise ReadError(f"{path.name} has only one slice; a surface needs at least 2 slices")
    depth = "Z" if "Z" in letters else letters[0]
    unknown = set(letters) - {depth, "T", "C"} or len(set(letters)) < len(letters)
    only_channels = depth == "C" and sides[0][1] <= MOST_CHANNELS
    if unknown or only_channels or (depth != "Z" and len(letters) > 1):
        raise ReadError(f"{path.name} has more than one channel or time ({several}); save one as a stack of its own")
    steps = {axis: math.prod(side for _, side in sides[at + 1 :]) for at, (axis, _) in enumerate(sides)}
    lengths = dict(sides)
    times, channels = (lengths.get(axis, 1) if axis != depth else 1 for axis in "TC")
    notes = (f"{path.name} has {channels} channels: the first was read",) if channels > 1 else ()
    return Pages(lengths[depth], times, steps[depth], steps.get("T", 0) if times > 1 else 0, notes)


class TiffMetadata(NamedTuple):
    """The metadata of ImageJ or OME about the pixels of a TIFF.

    Parameters
    ----------
    spacing : (x, y, z) float or None
        Millimeters.
    notes : tuple of str
        What was assumed about the spacing.
    calibration : ImageJCalibration
        From stored numbers to gray values.
    """

    spacing: tuple[float, float, float] | None = None
    notes: tuple[str, ...] = ()
    calibration: ImageJCalibration = ImageJCalibration()


def metadata_of_tiff(tiff: Any, layout: PageLayout, several: bool) -> TiffMetadata:
    """Return the metadata of ImageJ or OME in a TIFF.

    Parameters
    ----------
    tiff : tifffile.TiffFile
    layout : PageLayout
        Of its first page.
    several : bool
        Whether it has several pages; of a single one ImageJ leaves the distance of slices out.
    """
    if tiff.is_ome:
        return _metadata_of_ome(str(tiff.ome_metadata or "")[:LONGEST_TEXT])
    if tiff.is_imagej:
        about = tiff.imagej_metadata or {}
        return TiffMetadata(*_imagej_spacing(tiff, about, several), calibration_of(about, layout))
    return TiffMetadata()


def _metadata_of_ome(text: str) -> TiffMetadata:
    """Return the metadata of the first `Pixels` in the OME-XML; a note if it is in another file."""
    elsewhere = re.search(r"<(?:\w+:)?BinaryOnly\s[^<>]*MetadataFile\s*=\s*[\"']([^\"']*)", text)
    if elsewhere:
        return TiffMetadata(notes=(f"spacing and order of the TIFF are in {elsewhere[1]}, which was not read",))
    element = re.search(r"<(?:\w+:)?Pixels\s[^<>]*>", text)
    words = re.findall(r"(PhysicalSize[XYZ](?:Unit)?)\s*=\s*[\"']([^\"']*)[\"']", element[0] if element else "")
    return TiffMetadata(*spacing_of_ome(dict(words)))


def spacing_of_ome(pixels: Mapping[str, str]) -> tuple[tuple[float, float, float] | None, tuple[str, ...]]:
    """Return the PhysicalSize among the attributes of OME's `Pixels`; its unit is µm where none is given."""
    sizes = [pixels.get(f"PhysicalSize{axis}") for axis in "XYZ"]
    units = [pixels.get(f"PhysicalSize{axis}Unit", "µm") for axis in "XYZ"]
    return spacing_in_mm([number_of(size) for size in sizes], units)


def _imagej_spacing(
    tiff: Any, about: Mapping[str, Any], several: bool
) -> tuple[tuple[float, float, float] | None, tuple[str, ...]]:
    """Return ImageJ's spacing of slices and the resolution of the first page, each axis in its own unit.

    ImageJ writes yunit and zunit where they differ from unit, and leaves a spacing of slices of 1 out.
    """
    unit = unit_of(about, "unit", "")
    units = [unit, unit_of(about, "yunit", unit), unit_of(about, "zunit", unit)]
    tags = tiff.pages[0].tags
    sizes = []
    for name in ("XResolution", "YResolution"):
        value = tags[name].value if name in tags else None
        pair = value if isinstance(value, tuple) and len(value) == 2 else (0, 0)
        is_fraction = all(isinstance(part, int) and part > 0 for part in pair)
        sizes.append(pair[1] / pair[0] if is_fraction else None)
    depth = number_of(about.get("spacing", 1.0 if several else None))
    return spacing_in_mm([*sizes, depth], units)


def unit_of(about: Mapping[str, Any], key: str, default: str) -> str:
    r"""Return a unit as ImageJ writes it, in which \u00B5 is a letter."""
    text = str(about.get(key, default)).strip()
    return re.sub(r"\\u([0-9A-Fa-f]{4})", lambda code: chr(int(code[1], 16)), text) or default


def number_of(value: Any) -> float | None:
    """Return a length above 0, or None; ImageJ's spacing is negative where a stack was turned round."""
    try:
        number = abs(float(value))
    except (TypeError, ValueError):
        return None
    return number if 0 < number < math.inf else None


def spacing_in_mm(
    sizes: list[float | None], units: list[str]
) -> tuple[tuple[float, float, float] | None, tuple[str, ...]]:
    """Return the spacing in mm, or None where x or y is not known or its unit is a pixel; and what was assumed."""
    x, y, z = sizes
    units = [unit.strip() for unit in units]
    if x is None or y is None or not all(units) or any(unit.lower() in PIXELS for unit in units):
        return None, ()
    notes = []
    if z is None:
        z, units = x, [units[0], units[1], units[0]]
        notes.append("the TIFF has no spacing between slices: that between columns is taken; give the spacing in mm")
    lengths_mm, unit_notes = in_mm(units)
    lengths = [size * mm for size, mm in zip((x, y, z), lengths_mm, strict=True)]
    return (lengths[0], lengths[1], lengths[2]), (*notes, *unit_notes)
