# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the pixel size from the log that Bruker's SkyScan and NRecon write beside their slices.

NAME_rec.log (of the reconstruction) or NAME.log (of the scan) lies beside NAME_rec00000000.bmp. It has sections with
lines of `key=value`; lengths are in micrometers, and voxels have the same size along each axis.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

from ...core import mm_text
from ...core.files.input_files import add_inputs
from .slice_names import step_of

Spacing = tuple[float, float, float]
SUFFIX = ".log"
MOST_BYTES = 1 << 20
MM_PER_UM = 1e-3
RECONSTRUCTION, ACQUISITION = "reconstruction", "acquisition"
PIXEL_SIZE, IMAGE_PIXEL_SIZE, STEP = "pixel size (um)", "image pixel size (um)", "section to section step"
# The size of reconstructed voxels comes before that of the camera's pixels, which the scan may have had.
KEYS = (
    (RECONSTRUCTION, PIXEL_SIZE),
    (RECONSTRUCTION, IMAGE_PIXEL_SIZE),
    (ACQUISITION, PIXEL_SIZE),
    (ACQUISITION, IMAGE_PIXEL_SIZE),
)


def skyscan_spacing(slices: Sequence[Path]) -> tuple[Spacing | None, tuple[str, ...]]:
    """Return the spacing of slices in mm from the log beside them, and a note about it.

    Parameters
    ----------
    slices : sequence of Path
        In one folder.
    """
    for log in _logs_of(slices):
        with log.open("rb") as file:
            values = _values(file.read(MOST_BYTES).decode("latin-1"))
        text = next((values[key] for key in KEYS if key in values), None)
        if text is None:
            continue
        add_inputs((log,))
        size = _positive(text)
        if size is None:
            return None, (f"the pixel size '{text[:20]}' in {log.name} is not a length and was ignored",)
        step, why = _pixels_apart(_positive(values.get((RECONSTRUCTION, STEP), "")) or 1.0, step_of(slices) or 1.0)
        mm = size * MM_PER_UM
        apart = "" if step == 1.0 else f", and slices are {step:g} pixels apart ({why})"
        return (mm, mm, mm * step), (f"{log.name} says that pixels are {size:.6g} um wide: {mm_text(mm, 6)}{apart}",)
    return None, ()


def _pixels_apart(section_step: float, file_step: float) -> tuple[float, str]:
    """Return the distance between slices in pixels, from the steps of the log and of the file numbers, and the reason.

    Files may be numbered by section, and then have the log's step or a multiple of it where some were taken out; or
    one after the other.

    Examples
    --------
    >>> [_pixels_apart(*steps)[0] for steps in ((1.0, 2.0), (3.0, 1.0), (2.0, 2.0), (2.0, 4.0), (2.0, 3.0))]
    [2.0, 3.0, 2.0, 4.0, 6.0]
    """
    log_says = f"{STEP.title().replace(' To ', ' to ')} {section_step:g}"
    if file_step in (1.0, section_step):
        return section_step, log_says
    files_say = f"the files are numbered in steps of {file_step:g}, {log_says}"
    by_section = file_step % section_step == 0
    return (file_step if by_section else file_step * section_step), files_say


def _logs_of(slices: Sequence[Path]) -> list[Path]:
    """Return the logs that are named like the slices up to their number, the longest name first."""
    logs = [path for path in slices[0].parent.iterdir() if path.suffix.lower() == SUFFIX and path.is_file()]
    ends = (slices[0].stem, slices[-1].stem)

    def fits(log: Path) -> bool:
        like = re.compile(re.escape(log.stem) + r"[ _-]*(rec)?[ _-]*[0-9]+", re.IGNORECASE)
        return all(like.fullmatch(stem) for stem in ends)

    return sorted(filter(fits, logs), key=lambda log: (-len(log.stem), log.name))


def _values(text: str) -> dict[tuple[str, str], str]:
    """Return the values of a log by section and key, both in small letters."""
    values: dict[tuple[str, str], str] = {}
    section = ""
    for line in text.splitlines():
        head = re.fullmatch(r"\s*\[(.*)\]\s*", line)
        if head:
            section = head[1].strip().casefold()
            continue
        key, equals, value = line.partition("=")
        if equals:
            values.setdefault((section, key.strip().casefold().replace("\u03bcm", "um")), value.strip())
    return values


def _positive(text: str) -> float | None:
    """Return a number above 0, with a decimal comma in some countries, or None."""
    try:
        number = float(text.replace(",", "."))
    except ValueError:
        return None
    return number if 0 < number < math.inf else None
