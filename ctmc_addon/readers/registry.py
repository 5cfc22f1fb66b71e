# SPDX-License-Identifier: GPL-3.0-or-later
"""List every format: its name, the marks that identify it, and the module that opens it.

A new format is a line of `FORMATS` and a module of this package. If its files or folders are volumes, the module has
`open_source(path)`, which reads a header and returns a `VolumeSource`. If they may be slices, it has
`open_steps(path)`, which reads the headers of many files, and `is_whole_volume(path)`, which says whether a file is a
volume by itself. Modules are imported when they are first needed, so that they may import this table too.
"""

from __future__ import annotations

import importlib
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core import Steps
from .optional_imports import imported_steps

VOLUME, FOLDER, SLICE, PAGES, SERIES = "volume", "folder", "slice", "pages", "series"


@dataclass(frozen=True)
class Format:
    """The suffixes and marks that identify a format.

    Parameters
    ----------
    module : str
        The module of this package that opens it.
    suffixes : tuple of str
        In small letters, with their dot; one may have two.
    marks : tuple of (int, bytes)
        Bytes and where they stand in a file, one of which tells the format where the suffix does not.
    holds : {"volume", "folder", "slice", "pages", "series"}
        What a file of it is: a volume; a part of the folder that is one; a slice of the stack in its folder; a slice,
        or of several pages a volume; an image of one of the series in its folder.
    names : tuple of str
        Names of files that tell the format; one of them lies in each folder of a folder format.
    values : str
        Suffix of the file of values beside a text of such a suffix, which opens the pair too.
    may_be_mask : bool
        Whether a folder of such files may be a folder of masks: they say where their voxels lie.
    library : tuple of str
        The module that reads a volume's header, its package, and where it is optional how to install it.
    """

    module: str
    suffixes: tuple[str, ...]
    marks: tuple[tuple[int, bytes], ...] = ()
    holds: str = VOLUME
    names: tuple[str, ...] = ()
    values: str = ""
    may_be_mask: bool = False
    library: tuple[str, ...] = ()


def _at_start(*marks: bytes) -> tuple[tuple[int, bytes], ...]:
    """Return marks that stand at the start of a file."""
    return tuple((0, mark) for mark in marks)


JPEG_2000, JPEG_2000_MARKS = (".jp2", ".j2k", ".jpx", ".j2c"), _at_start(b"\0\0\0\x0cjP  ", b"\xff\x4f\xff\x51")
TIFF_MARKS = _at_start(b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
ZARR = ("zarr.json", ".zattrs", ".zgroup", ".zarray")
ZARR_LIBRARY = ("zarr", "zarr", "install it by `pip install 'zarr>=3'`")
# The first import of nibabel takes long; that of NIfTI-2 brings NIfTI-1.
NIFTI_LIBRARY = ("nibabel.nifti2", "nibabel")
MGH_LIBRARY, ANALYZE_LIBRARY = ("nibabel.freesurfer.mghformat", "nibabel"), ("nibabel.spm2analyze", "nibabel")

# By the name that users see. DICOM's mark is asked before TIFF's, as a DICOM file may begin like a TIFF (PS3.10, 7.1).
FORMATS = {
    "DICOM": Format("dicom.opening", (".dcm", ".dicom", ".ima"), ((128, b"DICM"),), SERIES, ("DICOMDIR",)),
    "PNG": Format("images.folder", (".png",), _at_start(b"\x89PNG"), SLICE),
    "JPEG": Format("images.folder", (".jpg", ".jpeg"), _at_start(b"\xff\xd8\xff"), SLICE),
    "BMP": Format("images.folder", (".bmp",), (), SLICE),
    "TIFF": Format("images.folder", (".tif", ".tiff"), TIFF_MARKS, PAGES),
    "JPEG 2000": Format("images.folder", JPEG_2000, JPEG_2000_MARKS, SLICE),
    "NIfTI": Format(
        *("volumes.nifti", (".nii", ".nii.gz"), ((344, b"n+1\0"), (4, b"n+2\0"))),
        may_be_mask=True,
        library=NIFTI_LIBRARY,
    ),
    "NRRD": Format("volumes.nrrd", (".nrrd", ".nhdr"), _at_start(b"NRRD"), may_be_mask=True),
    "NumPy": Format("volumes.npy", (".npy",), _at_start(b"\x93NUMPY")),
    "MetaImage": Format("volumes.metaimage", (".mha", ".mhd"), _at_start(b"ObjectType ="), may_be_mask=True),
    "MGH": Format("volumes.mgh", (".mgh", ".mgz"), may_be_mask=True, library=MGH_LIBRARY),
    "Analyze": Format("volumes.analyze", (".hdr",), values=".img", library=ANALYZE_LIBRARY),
    "VFF": Format("volumes.vff", (".vff",), _at_start(b"ncaa")),
    "VOL": Format("volumes.vol", (".vgi", ".vol.info"), values=".vol"),
    "OME-Zarr": Format("volumes.ome_zarr", (".ome.zarr", ".zarr"), (), FOLDER, ZARR, library=ZARR_LIBRARY),
}


def _suffixes_of(*holds: str) -> tuple[str, ...]:
    """Return the suffixes of all formats, or of those whose files hold this.

    Examples
    --------
    >>> _suffixes_of("pages")
    ('.tif', '.tiff')
    """
    return tuple(end for about in FORMATS.values() if not holds or about.holds in holds for end in about.suffixes)


IMAGE_SUFFIXES = _suffixes_of(SLICE, PAGES)
PAGE_SUFFIXES = _suffixes_of(PAGES)
VOLUME_SUFFIXES = _suffixes_of(VOLUME)
FOLDER_SUFFIXES = _suffixes_of(FOLDER)
KNOWN_SUFFIXES = _suffixes_of()
MASK_SUFFIXES = tuple(end for about in FORMATS.values() if about.may_be_mask for end in about.suffixes)
BY_SUFFIX = {end: name for name, about in FORMATS.items() for end in about.suffixes}
BY_FILE_NAME = {word: name for name, about in FORMATS.items() for word in about.names}
BY_VALUES = {about.values: name for name, about in FORMATS.items() if about.values}
HEAD = max(at + len(mark) for about in FORMATS.values() for at, mark in about.marks)  # Every mark ends here.


def marked(head: bytes) -> str:
    r"""Return the format whose mark is among a file's first `HEAD` bytes, or ''.

    Examples
    --------
    >>> marked(b"NRRD0004"), marked(b"II*\0" + bytes(124) + b"DICM"), marked(b"words")
    ('NRRD', 'DICOM', '')
    """
    marks = ((name, at, mark) for name, about in FORMATS.items() for at, mark in about.marks)
    return next((name for name, at, mark in marks if head[at : at + len(mark)] == mark), "")


def folder_format(folder: Path, names: Collection[str] | None = None) -> str:
    """Return the format whose volume a folder is, by the `names` of its files, or ''."""
    for word, name in BY_FILE_NAME.items():
        if FORMATS[name].holds == FOLDER and (word in names if names is not None else (folder / word).is_file()):
            return name
    return ""


def open_steps(name: str, path: Path) -> Steps[Any]:
    """Open a file or folder of the format `name`: steps that return its `VolumeSource`."""
    about, module = FORMATS[name], _module(name)
    if about.holds not in (VOLUME, FOLDER):
        return (yield from module.open_steps(path))
    is_misplaced = about.holds == FOLDER and not path.is_dir()  # No package helps a file that should be a folder.
    if about.library and not is_misplaced:
        library, package, *remedy = about.library
        yield from imported_steps(library, package, name, *remedy)
    return module.open_source(path)


def is_whole_volume(name: str, path: Path) -> bool:
    """Return whether a file of the format `name` is a volume by itself, and not a slice of its folder."""
    return FORMATS[name].holds in (VOLUME, FOLDER) or bool(_module(name).is_whole_volume(path))


def _module(name: str) -> Any:
    return importlib.import_module(f".{FORMATS[name].module}", __package__)
