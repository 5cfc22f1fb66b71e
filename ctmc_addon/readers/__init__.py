# SPDX-License-Identifier: GPL-3.0-or-later
"""Files to volumes: one door for every format, chosen by what the path holds.

Knows no Blender. `open_volume` reads headers alone; `read_volume` returns a `Volume` in RAS+ mm whose notes say all
that was assumed.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from ..core import CtmcError, ReadError, Stages, Step, Steps, finish, worker_count
from ..core.volume import Volume
from .dicom import series as dicom_series
from .dicom.header import is_multi_frame, may_be_dicom
from .dicom.labels.classes import SEGMENTATION, STRUCTURES, label_class
from .dicom.labels.segmentation import SegmentationSource
from .dicom.labels.structures import StructureSource
from .file_formats import (
    DICOM_SUFFIXES,
    IMAGE_SUFFIXES,
    KNOWN_SUFFIXES,
    TIFF_SUFFIXES,
    VOLUME_FORMATS,
    VOLUME_SUFFIXES,
    files_below,
    format_of,
    natural_key,
    segmentation_sibling,
    stem,
    suffix,
)
from .images import folder as image_folder
from .images import tiff
from .labels import masks
from .result import Series, VolumeSource, checked_flip, checked_spacing, checked_stride, out_of_memory, unreadable
from .volumes import analyze
from .volumes.metaimage import MetaImageFile
from .volumes.mgh import MghFile
from .volumes.nifti import NiftiFile
from .volumes.npy import NpyFile
from .volumes.nrrd import NrrdFile, outside_allowed

__all__ = [
    "KNOWN_SUFFIXES",
    "TIFF_SUFFIXES",
    "VOLUME_SUFFIXES",
    "Series",
    "VolumeSource",
    "checked_flip",
    "checked_spacing",
    "estimate_voxels",
    "existing_path",
    "files_below",
    "holds_slices",
    "is_volume_file",
    "natural_key",
    "open_volume",
    "open_volume_steps",
    "outside_allowed",
    "read_volume",
    "read_volume_steps",
    "segmentation_sibling",
    "stem",
    "suffix",
    "volume_name",
]

PathLike = str | os.PathLike[str]


def open_volume(path: PathLike) -> VolumeSource:
    """Find out what a file or folder holds, from headers alone.

    Parameters
    ----------
    path : path
        As in `read_volume`.

    Returns
    -------
    VolumeSource
        Its format, series and their sizes; `read_steps` or `read` reads the values.

    Raises
    ------
    ReadError
        If there is no readable volume at `path`.
    """
    return finish(open_volume_steps(path))


def open_volume_steps(path: PathLike) -> Steps[VolumeSource]:
    """`open_volume` as steps."""
    path = existing_path(path)
    yield Step(0.0, f"Opening {path.name}")
    try:
        if path.is_dir():
            return (yield from _open_folder_steps(path))
        format_name = file_format(path)
        if format_name == "dicom" and label_class(path) == SEGMENTATION:
            return (yield from SegmentationSource.open_steps(path))
        if format_name == "dicom" and label_class(path) == STRUCTURES:
            return (yield from StructureSource.open_steps(path))
        if format_name == "dicom":
            return (yield from dicom_series.open_steps(path))
        if format_name == "nifti":
            return (yield from NiftiFile.open_steps(path))
        if format_name == "nrrd":
            return NrrdFile(path)
        if format_name == "analyze":
            return (yield from analyze.open_steps(path))
        if format_name == "mgh":
            return (yield from MghFile.open_steps(path))
        if format_name == "metaimage":
            return MetaImageFile(path)
        if format_name == "npy":
            return NpyFile(path)
        if format_name == "tiff":
            source = tiff.opened_stack(path)
            if source is not None:
                return source
        return (yield from image_folder.open_steps(path.parent, path))
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
    threads: int | None = None,
    time: int | None = None,
    region: Sequence[float] | None = None,
    region_unit: str = "voxel",
    stride: Sequence[int] = (1, 1, 1),
) -> Volume:
    """Read a CT, or its labels, from a file or folder.

    Parameters
    ----------
    path : path
        A folder of PNG, JPEG, BMP or TIFF slices; a multi-page TIFF; a DICOM folder, file or DICOMDIR, segmentation
        or structure set; a folder of masks, a file or a folder of DICOM slices for each;
        `.nii`, `.nii.gz`, `.nrrd`, `.nhdr`, `.mha`, `.mhd`, `.mgh`, `.mgz`, `.hdr`, `.img` or `.npy`. A lone slice
        stands for its folder.
    spacing : (x, y, z) float, optional
        Millimeters between samples, in place of the file's own or of 1 mm.
    series : str or int, optional
        SeriesInstanceUID, or its number in `open_volume(path).series`; by default the series with the most slices.
    strict : bool
        Refuse uneven gaps between DICOM slices instead of resampling.
    flip : str
        Index axes to mirror in place, such as 'xz'.
    threads : int, optional
        Threads that decode PNG, JPEG, BMP and TIFF slices; by default one for each processor, at most 8.
    time : int, optional
        Which of several volumes at the same place, time points or cardiac phases, from 1 on; by default the first, or
        of DICOM the first of those with the most slices.
    region : lowest x, y, z, highest x, y, z, optional
        The part to read; nothing else is kept, and of uncompressed files nothing else is read.
    region_unit : {"voxel", "mm"}
        Whether the region is in voxel indices or RAS+ mm, in which every voxel that it touches belongs to it.
    stride : (x, y, z) int
        Keep every so many samples along each axis, from the region's first on.

    Returns
    -------
    Volume
        Whose notes say what was assumed. Of a region or stride it has the values, the type and the kind that these
        samples have in the whole volume.

    Raises
    ------
    ReadError
        If there is no readable volume at `path`.
    SettingsError
        If spacing, flip, threads, region or stride are outside their limits.
    MemoryLimitError
        If the volume would not fit; said before it is read.
    """
    return finish(read_volume_steps(path, spacing, series, strict, flip, threads, time, region, region_unit, stride))


def read_volume_steps(
    path: PathLike,
    spacing: float | Sequence[float] | None = None,
    series: str | int | None = None,
    strict: bool = False,
    flip: str = "",
    threads: int | None = None,
    time: int | None = None,
    region: Sequence[float] | None = None,
    region_unit: str = "voxel",
    stride: Sequence[int] = (1, 1, 1),
) -> Steps[Volume]:
    """`read_volume` as steps; closing the generator cancels.

    Between steps there is a thread only while a library is imported for the first time.
    """
    (
        checked_spacing(spacing),
        checked_flip(flip),
        worker_count(threads),
        checked_stride(stride),
    )  # refused before a file is opened
    stages = Stages({"Reading headers": 1, "Reading values": 4})
    source = yield from stages.run("Reading headers", open_volume_steps(path))
    values = source.read_steps(spacing, series, strict, flip, threads, time, region, region_unit, stride)
    return (yield from stages.run("Reading values", values))


def existing_path(path: PathLike) -> Path:
    """The path, or a `ReadError` if nothing is there, or neither a file nor a folder."""
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


def file_format(path: Path) -> str:
    """'dicom', 'nifti', 'nrrd', 'npy', 'tiff' or 'image', by the file's suffix or its first bytes."""
    if not path.stat().st_size:
        raise ReadError(f"{path.name} is empty (0 bytes); copy it again")
    end = format_of(path)
    if end in DICOM_SUFFIXES or path.name.upper() == "DICOMDIR" or (not end and may_be_dicom(path)):
        return "dicom"
    if end:
        return VOLUME_FORMATS.get(end) or ("tiff" if end in TIFF_SUFFIXES else "image")
    reason = f"has the unknown suffix '{suffix(path)}'" if suffix(path) else "has no suffix and no known content"
    raise ReadError(f"{path.name} {reason}; choose a folder, or a file that ends in {', '.join(KNOWN_SUFFIXES)}")


def _open_folder_steps(folder: Path) -> Steps[VolumeSource]:
    """Image slices or DICOM, whichever the folder holds more of; a `ReadError` if it holds neither."""
    slices = image_folder.images_in(folder)
    files = list(files_below(folder))
    if not files:
        raise ReadError(f"the folder {folder.name} is empty; choose the folder that holds the slices")
    source = yield from dicom_series.open_steps(folder, files)
    if slices and len(source.files) <= len(slices):
        alone = len(slices) == 1 and not source.files  # such as TotalSegmentator's preview of its masks
        masks_beside = (yield from masks.in_files_steps(folder, open_volume_steps)) if alone else None
        return masks_beside or (yield from image_folder.open_steps(folder))
    if source.files:
        return (yield from masks.in_folders_steps(source)) or source
    masks_in_files = yield from masks.in_files_steps(folder, open_volume_steps)
    if masks_in_files is not None:
        return masks_in_files
    labels = [file for file in files if label_class(file)]
    if len(labels) == 1:
        return (yield from open_volume_steps(labels[0]))
    if labels:
        names = ", ".join(file.relative_to(folder).as_posix() for file in labels[:5])
        raise ReadError(
            f"the folder {folder.name} has {len(labels)} segmentations or structure sets ({names}"
            f"{' and more' if len(labels) > 5 else ''}); choose one of them"
        )
    volumes = sorted(file.name for file in folder.iterdir() if suffix(file) in VOLUME_SUFFIXES)
    folders = sorted(inner.name for inner in folder.iterdir() if inner.is_dir() and image_folder.images_in(inner))
    hint = "choose the folder that holds the slices"
    if volumes or folders:
        hint = f"choose {' or '.join(repr(name) for name in [*volumes, *folders][:5])} in it"
    count = f"{len(files)} file{'s' * (len(files) > 1)}, and none is a DICOM image or a slice"
    raise ReadError(f"the folder {folder.name} has {count}; {hint}")


def holds_slices(folder: Path) -> bool:
    """Whether image slices, or files that look like DICOM, lie in this folder itself."""
    files = (file for file in folder.iterdir() if not file.name.startswith(".") and file.is_file())
    return any(suffix(file) in IMAGE_SUFFIXES or may_be_dicom(file) for file in files)


def is_volume_file(path: Path) -> bool:
    """Whether a file is a volume by itself: by its suffix, and of a TIFF by its pages."""
    if suffix(path) not in TIFF_SUFFIXES:
        return suffix(path) in VOLUME_SUFFIXES
    try:
        return tiff.page_count(path) > 1
    except (CtmcError, OSError):
        return False


def volume_name(path: Path) -> str:
    """What the volume at `path` will be called; of a folder's slice it is the folder's name.

    A slice's own name often is an identifier.
    """
    if path.is_dir():
        return stem(path)
    try:
        format_name = file_format(path)
        alone = bool(label_class(path)) or is_multi_frame(path) if format_name == "dicom" else format_name != "image"
        alone = alone and (format_name != "tiff" or tiff.page_count(path) > 1)
    except (CtmcError, OSError):
        alone = True
    return stem(path if alone else path.absolute().parent)


def estimate_voxels(path: Path) -> int:
    """About how many voxels the volume at `path` has; of a DICOM folder one header is read instead of hundreds."""
    if path.is_dir():
        voxels = dicom_series.estimate_voxels(path)
        if voxels:
            return voxels
    return max((series.slices * series.size[0] * series.size[1] for series in open_volume(path).series), default=0)
