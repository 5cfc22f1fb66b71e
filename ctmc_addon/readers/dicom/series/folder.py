# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the headers of a folder's DICOM files, and sort its slices and its damaged files by series.

No patient data is read. Errors name files; notes number them, because names may hold a patient's.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ....core import ReadError, Stages, Steps
from ...file_formats import files_below, natural_key, suffix
from ...optional_imports import imported_steps, quiet, quiet_batches_steps
from ...registry import FORMATS
from ..header import Broken, ImageFile, Slice, may_be_dicom, read_header
from .stack_geometry import Stack

MOST_NUMBERED = 12  # Of more damaged slices, the rest are "more".
SHORTEST = 132  # A DICOM file has at least the bytes of its preamble.


class FolderContent(NamedTuple):
    """The DICOM files of a folder: slices by series, and images that cannot be read."""

    series: dict[str, list[Slice]]
    broken: list[Broken]
    color: list[ImageFile]
    strays: int


def headers_steps(files: Sequence[Path]) -> Steps[list[ImageFile | Broken]]:
    """Read the header of every DICOM image among files, in their order; other files are passed over.

    Parameters
    ----------
    files : sequence of Path
    """
    headers = yield from each_header_steps(files)
    return [header for header in headers if header is not None]


def each_header_steps(files: Sequence[Path]) -> Steps[list[ImageFile | Broken | None]]:
    """Return `read_header` of each file; pydicom is imported only where one may be DICOM."""
    stages = Stages({"Loading pydicom": 1, "Reading headers": 4})
    if any(map(may_be_dicom, files)):
        yield from stages.run("Loading pydicom", imported_steps("pydicom", "pydicom", "DICOM"))
    return (yield from stages.run("Reading headers", quiet_batches_steps(read_header, files, "Reading headers", 16)))


def estimate_voxels(folder: Path) -> int:
    """Return the voxels of a folder's slices if all are like the first; 0 if it has no image."""
    files = list(files_below(folder))
    with quiet():
        first = next((header for header in map(read_header, files) if isinstance(header, ImageFile)), None)
    return 0 if first is None else first.rows * first.columns * len(files) * len(first.frames)


def sorted_by_series(headers: Sequence[ImageFile | Broken]) -> FolderContent:
    """Group slices by series, in the order in which the series first appear."""
    series: dict[str, list[Slice]] = {}
    broken = [header for header in headers if isinstance(header, Broken)]
    images = [header for header in headers if isinstance(header, ImageFile)]
    color = [image for image in images if not image.gray]
    for image in images:
        if image.gray:
            series.setdefault(image.series, []).extend(Slice(image, frame) for frame in range(len(image.frames)))
    slice_names: dict[tuple[Path, str], set[str]] = {}
    for image in images if broken else []:
        slice_names.setdefault((image.path.parent, _name_pattern(image.path)), set()).add(image.series)
    unsound, strays = [], 0
    for header in broken:
        own = (
            slice_names.get((header.path.parent, _name_pattern(header.path)), ()) if header.stray else (header.series,)
        )
        damage = "named like the slices, but not DICOM" if header.path.stat().st_size else "0 bytes"
        unsound += [
            header._replace(series=uid, damage=damage if header.stray else header.damage) for uid in sorted(own)
        ]
        strays += not own and _is_named_dicom(header.path)
    return FolderContent(series, unsound, color, strays)


def _name_pattern(path: Path) -> str:
    """Return the common part of the names in one export, with '#' for numbers and hexadecimal words.

    Examples
    --------
    >>> _name_pattern(Path("IM-0001-0017.dcm")), _name_pattern(Path("1.2.840.17")), _name_pattern(Path("0f1e22ab-77aa"))
    ('im-#-#.dcm', '#.#.#.#', '#-#')
    """
    words = re.sub(r"(?<![0-9a-z])[0-9a-f]{4,}(?![0-9a-z])", "#", path.name.casefold())
    return re.sub(r"[0-9]+", "#", words)


def _is_named_dicom(path: Path) -> bool:
    """Return whether a file that is not DICOM has a suffix of DICOM, or none and too few bytes."""
    return suffix(path) in FORMATS["DICOM"].suffixes or (not suffix(path) and path.stat().st_size < SHORTEST)


def damaged_of(content: FolderContent, uid: str) -> list[Broken]:
    """Return the damaged files of a series, without which slices would be missing silently."""
    return [
        broken
        for broken in content.broken
        if broken.series == uid  # or one that was cut off within its UID
        or (broken.series not in content.series and uid.startswith(broken.series))
    ]


def damaged_notes(damaged: Sequence[Broken], slices: Sequence[Slice], stack: Stack) -> list[str]:
    """Return the note about slices that were left out, by their number: the names of files may hold a patient's."""
    if not damaged:
        return []
    paths = {ct_slice.image.path for ct_slice in slices} | {broken.path for broken in damaged}
    numbers = {path: number for number, path in enumerate(sorted(paths, key=natural_key), 1)}
    left_out = sorted(numbers[broken.path] for broken in damaged)
    gap = "the gap was filled by linear interpolation" if stack.resampled else "no gap remains within the stack"
    if len(left_out) == 1:
        return [f"slice {left_out[0]} of {len(paths)}, by file name, is damaged and was left out; {gap}"]
    words = [str(number) for number in left_out[:MOST_NUMBERED]]
    words += ["more"] if len(left_out) > MOST_NUMBERED else []
    named = f"{', '.join(words[:-1])} and {words[-1]}"
    return [f"slices {named} of {len(paths)}, by file name, are damaged and were left out; {gap}"]


def truncated(broken: Broken) -> ReadError:
    """Return the error for a DICOM file that cannot be read to its end."""
    damage = broken.damage or f"{broken.path.stat().st_size} bytes"
    return ReadError(f"{broken.path.name} is a truncated or damaged DICOM file ({damage}); {broken.remedy}")
