# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of files: their natural order, their stem, and the format that suffix and content tell."""

from __future__ import annotations

import gzip
import os
import re
import zlib
from collections.abc import Iterator
from pathlib import Path

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".jp2", ".j2k", ".jpx", ".j2c")
TIFF_SUFFIXES = (".tif", ".tiff")
DICOM_SUFFIXES = (".dcm", ".dicom", ".ima")
VOLUME_FORMATS = {
    **{".nii": "nifti", ".nii.gz": "nifti", ".nrrd": "nrrd", ".nhdr": "nrrd", ".npy": "npy"},
    **{".mha": "metaimage", ".mhd": "metaimage", ".mgh": "mgh", ".mgz": "mgh", ".hdr": "analyze"},
}
VOLUME_SUFFIXES = tuple(VOLUME_FORMATS)
KNOWN_SUFFIXES = IMAGE_SUFFIXES + DICOM_SUFFIXES + VOLUME_SUFFIXES

# First bytes that tell a format where the suffix does not.
SIGNATURES = (
    (0, b"NRRD", ".nrrd"),
    (0, b"\x93NUMPY", ".npy"),
    (0, b"ObjectType =", ".mha"),
    (0, b"\x89PNG", ".png"),
    (0, b"\xff\xd8\xff", ".jpg"),
    (0, b"\x00\x00\x00\x0cjP  ", ".jp2"),
    (0, b"\xff\x4f\xff\x51", ".j2k"),
    (0, b"II*\x00", ".tif"),
    (0, b"MM\x00*", ".tif"),
    (0, b"II+\x00", ".tif"),
    (0, b"MM\x00+", ".tif"),
    (128, b"DICM", ".dcm"),
    (344, b"n+1\x00", ".nii"),
    (4, b"n+2\x00", ".nii"),
)


def natural_key(path: Path) -> tuple[tuple[tuple[int, str, int], ...], str]:
    """Sort key in which `slice_2` comes before `slice_10`, folder by folder.

    Examples
    --------
    >>> [path.name for path in sorted([Path("s_10"), Path("s_9"), Path("S_1")], key=natural_key)]
    ['S_1', 's_9', 's_10']
    """
    pieces: list[tuple[int, str, int]] = []
    for part in path.parts:
        for piece in re.findall(r"[0-9]+|[^0-9]+", part.casefold()):
            pieces.append((0, "", int(piece)) if piece[0] in "0123456789" else (1, piece, 0))
        pieces.append((-1, "", 0))
    return tuple(pieces), str(path)


def suffix(path: Path) -> str:
    """Suffix in lower case; `.nii.gz` counts as one.

    Examples
    --------
    >>> suffix(Path("volume-3.NII.GZ"))
    '.nii.gz'
    """
    name = path.name.lower()
    return ".nii.gz" if name.endswith(".nii.gz") else path.suffix.lower()


def stem(path: Path) -> str:
    """Name without a known suffix: a folder `scan.v2` keeps all of its name.

    Examples
    --------
    >>> stem(Path("volume-3.nii.gz")), stem(Path("scan.v2"))
    ('volume-3', 'scan.v2')
    """
    name = path.name or path.absolute().name
    end = suffix(path)
    return name[: -len(end)] if end in KNOWN_SUFFIXES and len(name) > len(end) else name


def format_of(path: Path) -> str:
    """The known suffix that tells the file's format: its own, else by content, else ''."""
    end = suffix(path)
    if end in KNOWN_SUFFIXES:
        return end
    if end == ".img" and path.with_suffix(".hdr").is_file():  # some scanners write DICOM under this name
        return ".hdr"
    with path.open("rb") as file:
        head = file.read(352)
    if head[:2] == b"\x1f\x8b" and end == ".gz":
        try:
            with gzip.open(path) as inside:
                head = inside.read(352)
        except (OSError, EOFError, zlib.error):
            return ""
        return ".nii.gz" if any(head[at : at + 3] in (b"n+1", b"n+2") for at in (4, 344)) else ""
    return next((kind for at, mark, kind in SIGNATURES if head[at : at + len(mark)] == mark), "")


def files_below(folder: Path) -> Iterator[Path]:
    """Every file at any depth in natural order; hidden files and folders are passed over."""
    pending = [str(folder)]
    while pending:
        entries = [entry for entry in os.scandir(pending.pop()) if not entry.name.startswith(".")]
        entries.sort(key=lambda entry: natural_key(Path(entry.name)))
        yield from (Path(entry.path) for entry in entries if entry.is_file())
        pending += [entry.path for entry in reversed(entries) if entry.is_dir(follow_symlinks=False)]


def segmentation_sibling(path: str | os.PathLike[str]) -> Path | None:
    """The LiTS label file `segmentation-N` beside `volume-N` (.nii or .nii.gz), or None."""
    volume = Path(path)
    match = re.fullmatch(r"volume-(.+?)\.nii(\.gz)?", volume.name, re.IGNORECASE)
    if match is None:
        return None
    ends = (".nii.gz", ".nii") if match[2] else (".nii", ".nii.gz")
    siblings = (volume.with_name(f"segmentation-{match[1]}{end}") for end in ends)
    return next((sibling for sibling in siblings if sibling.is_file()), None)
