# SPDX-License-Identifier: GPL-3.0-or-later
"""Read volumes from files of every format, chosen by the content of the path.

Knows no Blender. `open_volume` reads headers alone; `read_volume` returns a `Volume` in RAS+ mm whose notes say all
that was assumed.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..core import Budget, CtmcError, ReadError, Stages, Step, Steps, defaults, finish
from ..core.volume import Volume
from .dicom.labels.classes import DOSE, label_class, object_class
from .dicom.series.listing import series_names
from .file_formats import (
    files_below,
    format_of,
    natural_key,
    segmentation_names,
    segmentation_sibling,
    stem,
    suffix,
    suffixes_of_text,
    volume_stem,
)
from .labels.nearby_labels import labels_beside, volumes_beside
from .map_files import MapFiles
from .options import ReadingOptions, checked_flip, checked_spacing, options_of
from .registry import (
    FOLDER,
    FOLDER_SUFFIXES,
    FORMATS,
    IMAGE_SUFFIXES,
    KNOWN_SUFFIXES,
    PAGE_SUFFIXES,
    VOLUME_SUFFIXES,
    folder_format,
    is_whole_volume,
    open_steps,
)
from .result import VolumeSource, checked_budget, checked_stride, out_of_memory, unreadable
from .series import Series
from .surface_files import SURFACE_SUFFIXES, read_surface_steps

__all__ = [
    "FOLDER_SUFFIXES",
    "FORMATS",
    "KNOWN_SUFFIXES",
    "PAGE_SUFFIXES",
    "SURFACE_SUFFIXES",
    "VOLUME_SUFFIXES",
    "MapFiles",
    "ReadingOptions",
    "Series",
    "VolumeSource",
    "checked_flip",
    "checked_spacing",
    "estimate_voxels",
    "existing_path",
    "files_below",
    "folder_format",
    "holds_slices",
    "is_volume_file",
    "labels_beside",
    "natural_key",
    "open_volume",
    "open_volume_steps",
    "read_surface_steps",
    "read_volume",
    "read_volume_steps",
    "segmentation_names",
    "segmentation_sibling",
    "series_names",
    "stem",
    "suffix",
    "volume_name",
    "volume_place",
    "volume_stem",
    "volumes_beside",
]

PathLike = str | os.PathLike[str]


def open_volume(path: PathLike, allow_outside: bool = False) -> VolumeSource:
    """Read the headers of a file or folder and describe its volume.

    Parameters
    ----------
    path : path
        As in `read_volume`.
    allow_outside : bool
        As in `ReadingOptions`.

    Returns
    -------
    VolumeSource
        Its format, series and their sizes; `read_steps` or `read` reads the values.

    Raises
    ------
    ReadError
        If there is no readable volume at `path`.
    """
    return finish(open_volume_steps(path, allow_outside))


def open_volume_steps(path: PathLike, allow_outside: bool = False) -> Steps[VolumeSource]:
    """Do what `open_volume` does, as steps."""
    if allow_outside:
        from .volumes.nrrd import outside_allowed_steps

        return (yield from outside_allowed_steps(open_volume_steps(path)))
    path = existing_path(path)
    yield Step(0.0, f"Opening {path.name}")
    try:
        name = _format_at(path)
        if not name:
            return (yield from _open_folder_steps(path))
        inside = FORMATS[name].holds == FOLDER and path.name in FORMATS[name].names
        return (yield from open_steps(name, path.parent if inside else path))
    except OSError as error:
        raise unreadable(path, error) from error
    except MemoryError as error:
        raise out_of_memory(path) from error


def read_volume(
    path: PathLike,
    spacing: float | Sequence[float] | None = None,
    series: str | int | None = None,
    strict: bool = False,
    flip: str = "",
    budget: Budget | None = None,
    time: int | None = None,
    region: Sequence[float] | None = None,
    region_unit: str = "voxel",
    stride: Sequence[int] = (1, 1, 1),
    level: int | None = None,
    allow_outside: bool = False,
    name: str | None = None,
    options: ReadingOptions | None = None,
    anatomy_colors: bool = False,
    remove_table: bool = False,
    file_colors: bool = False,
    skip_damaged: bool = False,
) -> Volume:
    """Read a CT, or its labels, from a file or folder.

    Parameters
    ----------
    path : path
        A folder of PNG, JPEG, BMP or TIFF slices; a multi-page TIFF; a DICOM folder, file or DICOMDIR, segmentation
        or structure set; a folder of masks, a file or a folder of DICOM slices for each;
        a volume in a file or folder of its own, such as `.nii.gz`, `.nrrd`, `.mha` or `.ome.zarr` (`FORMATS` has all).
        A lone slice stands for its folder.
    spacing, series, strict, flip, time, level, allow_outside, name, anatomy_colors, file_colors, remove_table,
    skip_damaged
        As in `ReadingOptions`, which describes them.
    budget : Budget, optional
        The threads that decode PNG, JPEG, BMP and TIFF slices, and the memory that the values may take.
    region : lowest x, y, z, highest x, y, z, optional
        The part to read; nothing else is kept, and of uncompressed files nothing else is read.
    region_unit : {"voxel", "mm"}
        Whether the region is in voxel indices or RAS+ mm, in which every voxel that it touches belongs to it.
    stride : (x, y, z) int
        Steps between kept samples along each axis, from the first of the region on.
    options : ReadingOptions, optional
        How the path is read; of its fields, those that are given above win.

    Returns
    -------
    Volume
        Its notes report assumptions. With a region or stride, its samples have the values, type and kind that they have
        in the whole volume.

    Raises
    ------
    ReadError
        If there is no readable volume at `path`.
    SettingsError
        If a reading option, the budget's threads, region or stride are outside their limits.
    MemoryLimitError
        If the volume would not fit; said before it is read.
    """
    fields = {"spacing": spacing, "flip": flip, "series": series, "time": time, "strict": strict, "level": level}
    fields |= {"allow_outside": allow_outside, "name": name, "anatomy_colors": anatomy_colors}
    fields |= {"remove_table": remove_table, "file_colors": file_colors, "skip_damaged": skip_damaged}
    given = {field: value for field, value in fields.items() if value is not defaults(ReadingOptions)[field]}
    options = options_of(options, given)
    steps = read_volume_steps(path, options, budget=budget, region=region, region_unit=region_unit, stride=stride)
    return finish(steps)


def read_volume_steps(
    path: PathLike,
    options: ReadingOptions | None = None,
    *,
    budget: Budget | None = None,
    stride: Sequence[int] = (1, 1, 1),
    region: Sequence[float] | None = None,
    region_unit: str = "voxel",
    **fields: Any,
) -> Steps[Volume]:
    """Do what `read_volume` does, as steps; closing the generator cancels.

    Between steps there is a thread only while a library is imported for the first time.
    """
    # Settings are refused before a file is opened.
    options = options_of(options, fields)
    budget = checked_budget(budget)
    checked_stride(stride)
    stages = Stages({"Reading headers": 1, "Reading values": 4})
    source = yield from stages.run("Reading headers", open_volume_steps(path, options.allow_outside))
    values = source.read_steps(options, budget=budget, region=region, region_unit=region_unit, stride=stride)
    return (yield from stages.run("Reading values", values))


def existing_path(path: PathLike) -> Path:
    """Return a path at which there is a file or a folder.

    Parameters
    ----------
    path : path

    Raises
    ------
    ReadError
        If nothing is there, or neither a file nor a folder.
    """
    entry = Path(path)
    try:
        exists = bool(str(path).strip()) and entry.exists()
        readable = exists and (entry.is_file() or entry.is_dir())
    except OSError as error:
        raise unreadable(entry, error) from error
    except ValueError:  # a zero byte
        exists = readable = False
    if not exists:
        raise ReadError(f"there is no file or folder '{path}'; check the path")
    if not readable:
        raise ReadError(f"{entry.name} is neither a file nor a folder; choose the file or folder that holds the CT")
    return entry if entry.name.strip(".") else entry.resolve()  # '.' and '..' have no name to show


def _format_at(path: Path) -> str:
    """Return the name of the format at a path, such as 'NIfTI'; empty for a folder without a format of its own."""
    if path.is_dir():
        return folder_format(path)
    if not path.stat().st_size:
        raise ReadError(f"{path.name} is empty (0 bytes); copy it again")
    name = format_of(path)
    if name:
        return name
    from .dicom.header import may_be_dicom

    if may_be_dicom(path):
        return "DICOM"
    if text := suffixes_of_text(path):
        names = " or ".join(f"{path.stem}{end}" for end in text)
        raise ReadError(f"{path.name} holds values only; put {names}, which describes them, beside it")
    reason = f"has the unknown suffix '{suffix(path)}'" if suffix(path) else "has no suffix and no known content"
    raise ReadError(f"{path.name} {reason}; choose a folder, or a file that ends in {', '.join(KNOWN_SUFFIXES)}")


def _open_folder_steps(folder: Path) -> Steps[VolumeSource]:
    """Open the image slices or the DICOM files of a folder, whichever are more; `ReadError` without either."""
    from .dicom.series import series as dicom_series
    from .images import folder as image_folder
    from .labels import masks

    slices = image_folder.images_in(folder)
    files = list(files_below(folder))
    inner = sorted((entry for entry in folder.iterdir() if entry.is_dir()), key=natural_key)
    volumes = [entry.name for entry in inner if folder_format(entry)]
    if not files and not volumes:
        raise ReadError(f"the folder {folder.name} is empty; choose the folder that holds the slices")
    source = yield from dicom_series.open_steps(folder, files)
    if slices and len(source.files) <= len(slices):
        single_picture = len(slices) == 1 and not source.files  # such as TotalSegmentator's preview of its masks
        mask_folder = (yield from masks.in_files_steps(folder, open_volume_steps)) if single_picture else None
        return mask_folder or (yield from image_folder.open_folder_steps(folder))
    if source.files:
        return (yield from masks.in_folders_steps(source)) or source
    masks_in_files = yield from masks.in_files_steps(folder, open_volume_steps)
    if masks_in_files is not None:
        return masks_in_files
    labels = [file for file in files if label_class(file)]
    doses = [file for file in files if object_class(file) == DOSE]
    for candidates, what in ((labels, "segmentations or structure sets"), (doses, "doses")):
        if len(candidates) == 1:
            return (yield from open_volume_steps(candidates[0]))
        if candidates:
            names = ", ".join(file.relative_to(folder).as_posix() for file in candidates[:5])
            raise ReadError(
                f"the folder {folder.name} has {len(candidates)} {what} ({names}"
                f"{' and more' if len(candidates) > 5 else ''}); choose one of them"
            )
    volumes += sorted(file.name for file in folder.iterdir() if suffix(file) in VOLUME_SUFFIXES)
    folders = [entry.name for entry in inner if image_folder.images_in(entry)]
    hint = "choose the folder that holds the slices"
    if volumes or folders:
        hint = f"choose {' or '.join(repr(name) for name in [*volumes, *folders][:5])} in it"
    count = f"{len(files)} file{'s' * (len(files) > 1)}, and none is a DICOM image or a slice"
    raise ReadError(f"the folder {folder.name} has {count}; {hint}")


def holds_slices(folder: Path) -> bool:
    """Return whether image slices, or files that look like DICOM, lie in this folder itself."""
    from .dicom.header import may_be_dicom

    files = (file for file in folder.iterdir() if not file.name.startswith(".") and file.is_file())
    return any(suffix(file) in IMAGE_SUFFIXES or may_be_dicom(file) for file in files)


def is_volume_file(path: Path) -> bool:
    """Return whether a file is a volume by itself: by its suffix, and of a TIFF by its pages.

    Parameters
    ----------
    path : Path
    """
    if suffix(path) not in PAGE_SUFFIXES:
        return suffix(path) in VOLUME_SUFFIXES
    try:
        return is_whole_volume(format_of(path), path)
    except (CtmcError, OSError):
        return False


def volume_place(path: Path) -> Path:
    """Return the file or folder that holds all of the volume at `path`: for a slice, its folder.

    Parameters
    ----------
    path : Path
        Of a file or folder that exists.
    """
    if path.is_dir():
        return path
    try:
        is_volume = is_whole_volume(_format_at(path), path)
    except (CtmcError, OSError):
        is_volume = True
    return path if is_volume else path.absolute().parent


def volume_name(path: Path) -> str:
    """Return the name of the volume at `path`; for a slice, that of its folder, because its own often identifies.

    Parameters
    ----------
    path : Path
        Of a file or folder that exists.
    """
    place = volume_place(path)
    return volume_stem(place) if place.is_dir() else stem(place)


def estimate_voxels(path: Path, allow_outside: bool = False) -> int:
    """Return about how many voxels the volume at `path` has.

    Parameters
    ----------
    path : Path
        Of a DICOM folder one header is read instead of hundreds.
    allow_outside : bool
        As in `ReadingOptions`.

    Raises
    ------
    ReadError
        If there is no readable volume.
    """
    if path.is_dir() and not folder_format(path):
        from .dicom.series.folder import estimate_voxels as dicom_voxels

        voxels = dicom_voxels(path)
        if voxels:
            return voxels
    source = open_volume(path, allow_outside)
    return max((series.slices * series.size[0] * series.size[1] for series in source.series), default=0)
