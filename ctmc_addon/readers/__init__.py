"""Files to volumes: one door for every format, chosen by what the path holds.

Knows no Blender. `read_volume` returns a `Volume` in RAS+ mm whose notes say all that was assumed.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from ..core import ReadError, Step, Steps, finish, within, worker_count
from ..core.volume import Volume
from . import nifti, nrrd
from .dicom import series as dicom
from .file_formats import (
    DICOM_SUFFIXES,
    KNOWN_SUFFIXES,
    TIFF_SUFFIXES,
    VOLUME_SUFFIXES,
    files_below,
    format_of,
    segmentation_sibling,
    stem,
    suffix,
)
from .images import folder as stacks
from .images import tiff
from .result import Reading, Series, checked_flip, checked_spacing, volume_steps, with_notes

__all__ = [
    "Series",
    "checked_flip",
    "checked_spacing",
    "keeps_geometry",
    "list_series",
    "list_series_steps",
    "read_volume",
    "read_volume_steps",
    "segmentation_sibling",
]

PathLike = str | os.PathLike[str]


def read_volume(
    path: PathLike,
    spacing: float | Sequence[float] | None = None,
    series: str | int | None = None,
    strict: bool = False,
    flip: str = "",
    threads: int | None = None,
) -> Volume:
    """Read a CT, or its labels, from a file or folder.

    Parameters
    ----------
    path : path
        A folder of PNG, JPEG, BMP or TIFF slices; a multi-page TIFF; a DICOM folder, file or DICOMDIR;
        `.nii`, `.nii.gz`, `.nrrd`, `.nhdr` or `.npy`. A lone slice stands for its folder.
    spacing : (x, y, z) float, optional
        Millimetres between samples, in place of the file's own or of 1 mm.
    series : str or int, optional
        SeriesInstanceUID, or its number in `list_series`; by default the series with the most slices.
    strict : bool
        Refuse uneven gaps between DICOM slices instead of resampling.
    flip : str
        Index axes to mirror in place, such as 'xz'.
    threads : int, optional
        Threads that decode PNG, JPEG, BMP and TIFF slices; by default one for each processor, at most 8.

    Returns
    -------
    Volume
        Whose notes say what was assumed.

    Raises
    ------
    ReadError
        If there is no readable volume at `path`.
    SettingsError
        If spacing, flip or threads are outside their limits.
    MemoryLimitError
        If the volume would not fit; said before it is read.
    """
    return finish(read_volume_steps(path, spacing, series, strict, flip, threads))


def read_volume_steps(
    path: PathLike,
    spacing: float | Sequence[float] | None = None,
    series: str | int | None = None,
    strict: bool = False,
    flip: str = "",
    threads: int | None = None,
) -> Steps[Volume]:
    """`read_volume` as steps; closing the generator cancels.

    Between steps there is a thread only while a library is imported for the first time.
    """
    sides, axes, workers = checked_spacing(spacing), checked_flip(flip), worker_count(threads)
    place = existing(path)
    yield Step(0.0, f"Looking at {place.name}")
    try:
        reading, name = yield from within(_reading_steps(place, sides, series, strict, workers), 0.0, 0.9)
    except OSError as error:
        raise unreadable(place, error) from error
    return (yield from within(volume_steps(reading, name, sides, axes), 0.9, 1.0))


def list_series(path: PathLike) -> tuple[Series, ...]:
    """The series of a DICOM folder or file, or the one volume of any other path, from headers alone."""
    return finish(list_series_steps(path))


def list_series_steps(path: PathLike) -> Steps[tuple[Series, ...]]:
    """`list_series` as steps."""
    place = existing(path)
    try:
        if place.is_dir():
            kind = folder_format(place)
            return (stacks.describe_folder(place),) if kind == "images" else (yield from dicom.describe_steps(place))
        kind = file_format(place)
        if kind == "dicom":
            return (yield from dicom.describe_steps(place))
        if kind == "nifti":
            yield from nifti.library_steps()
        describe = {"nifti": nifti.describe, "nrrd": nrrd.describe, "npy": stacks.describe_npy}.get(kind)
        if describe is not None:
            return (describe(place),)
        return (tiff.describe_tiff(place) if kind == "tiff" else stacks.describe_folder(place.parent),)
    except OSError as error:
        raise unreadable(place, error) from error


def _reading_steps(
    place: Path,
    spacing: tuple[float, float, float] | None,
    series: str | int | None,
    strict: bool,
    threads: int,
) -> Steps[tuple[Reading, str]]:
    """What the format's reader found, and the volume's name."""
    kind = folder_format(place) if place.is_dir() else file_format(place)
    if kind == "dicom":
        reading = yield from dicom.read_steps(place, series, strict, spacing)
        return reading, stem(dicom.named_after(place))
    if series is not None and str(series).strip():
        raise ReadError(f"{place.name} has no series, as only DICOM has; leave out the series '{series}'")
    if kind == "images":
        return (yield from stacks.folder_steps(place, threads)), stem(place)
    if kind == "image":
        reading = yield from stacks.folder_steps(place.parent, threads)
        note = f"{place.name} is one slice: its folder was read, {len(reading.values)} slices"
        return with_notes(reading, note), stem(place.absolute().parent)
    if kind == "nifti":
        yield from nifti.library_steps()
    readers = {"nifti": nifti.read_steps, "nrrd": nrrd.read_steps, "npy": stacks.npy_steps, "tiff": tiff.tiff_steps}
    return (yield from readers[kind](place)), stem(place)


def keeps_geometry(path: PathLike) -> bool:
    """Whether the format at `path` says spacing and orientation; PNG, JPEG, BMP, TIFF and npy do not."""
    place = existing(path)
    try:
        kind = folder_format(place) if place.is_dir() else file_format(place)
    except OSError as error:
        raise unreadable(place, error) from error
    return kind in {"dicom", "nifti", "nrrd"}


def existing(path: PathLike) -> Path:
    """The path, or a `ReadError` if nothing is there."""
    place = Path(path)
    try:
        found = bool(str(path).strip()) and place.exists()
    except OSError as error:
        raise unreadable(place, error) from error
    if not found:
        raise ReadError(f"there is no file or folder '{path}'; check the path")
    return place if place.name.strip(".") else place.resolve()  # '.' and '..' have no name to show


def unreadable(place: Path, error: OSError) -> ReadError:
    """What the system says of a file that cannot be opened."""
    name = Path(error.filename).name if isinstance(error.filename, str) else place.name
    return ReadError(f"{name} cannot be read ({error.strerror or error}); check the file and its permissions")


def file_format(place: Path) -> str:
    """'dicom', 'nifti', 'nrrd', 'npy', 'tiff' (several pages) or 'image' (one slice)."""
    if place.is_file() and not place.stat().st_size:
        raise ReadError(f"{place.name} is empty (0 bytes); copy it again")
    end = format_of(place)
    if end in DICOM_SUFFIXES or place.name.upper() == "DICOMDIR" or (not end and dicom.may_be_dicom(place)):
        return "dicom"
    for known, kind in ((".nii", "nifti"), (".n", "nrrd")):
        if end.startswith(known) and end != ".npy":
            return kind
    if end == ".npy":
        return "npy"
    if end in TIFF_SUFFIXES:
        return "tiff" if stacks.header_of(place).pages > 1 else "image"
    if end:
        return "image"
    said = f"has the unknown suffix '{suffix(place)}'" if suffix(place) else "has no suffix and no known content"
    raise ReadError(f"{place.name} {said}; choose a folder, or a file that ends in {', '.join(KNOWN_SUFFIXES)}")


def folder_format(place: Path) -> str:
    """'images' or 'dicom', whichever the folder holds more of; a `ReadError` if it holds neither."""
    images = stacks.images_in(place)
    files = 0
    dicoms = 0
    for file in files_below(place):
        files += 1
        dicoms += dicom.may_be_dicom(file)
        if dicoms > len(images):
            return "dicom"
    if images:
        return "images"
    if not files:
        raise ReadError(f"the folder {place.name} is empty; choose the folder that holds the slices")
    volumes = sorted(file.name for file in place.iterdir() if suffix(file) in VOLUME_SUFFIXES)
    folders = sorted(folder.name for folder in place.iterdir() if folder.is_dir() and stacks.images_in(folder))
    hint = "choose the folder that holds the slices"
    if volumes or folders:
        hint = f"choose {' or '.join(repr(name) for name in [*volumes, *folders][:5])} in it"
    held = f"{files} file{'s' * (files > 1)}, and none is a DICOM image or a slice"
    raise ReadError(f"the folder {place.name} has {held}; {hint}")
