# SPDX-License-Identifier: GPL-3.0-or-later
"""Sort file names in natural order, find their stems, and find their formats by suffix and content."""

from __future__ import annotations

import gzip
import os
import re
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path

from .registry import BY_FILE_NAME, BY_SUFFIX, BY_VALUES, FORMATS, HEAD, KNOWN_SUFFIXES, folder_format, marked

NAMELESS = ("image", "images")
"""Names of folders that do not tell one patient from another."""
TWO_DOTS = tuple(end for end in KNOWN_SUFFIXES if end.count(".") > 1)


def natural_key(path: Path) -> tuple[tuple[tuple[int, str, int], ...], str]:
    """Return a sort key that puts `slice_2` before `slice_10`, folder by folder.

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
    """Return the suffix in lower case; a known suffix with two dots, such as '.nii.gz', is one.

    Examples
    --------
    >>> suffix(Path("volume-3.NII.GZ")), suffix(Path("scan.ome.zarr"))
    ('.nii.gz', '.ome.zarr')
    """
    name = path.name.lower()
    if name.endswith(TWO_DOTS):
        return next(end for end in TWO_DOTS if name.endswith(end))
    return path.suffix.lower()


def stem(path: Path) -> str:
    """Return the name without a known suffix; a folder `scan.v2` keeps its whole name.

    Examples
    --------
    >>> stem(Path("volume-3.nii.gz")), stem(Path("scan.v2"))
    ('volume-3', 'scan.v2')
    """
    name = path.name or path.absolute().name
    end = suffix(path)
    return name[: -len(end)] if end in KNOWN_SUFFIXES and len(name) > len(end) else name


def volume_stem(path: Path) -> str:
    """Return the name of a volume at a path: a folder that is called `image` is named after the folder above it.

    Examples
    --------
    >>> volume_stem(Path("tumor/dicom/image")), volume_stem(Path("tumor/dicom"))
    ('tumor', 'dicom')
    """
    if path.name.casefold() not in NAMELESS:
        return stem(path)
    above = (folder.name for folder in path.absolute().parents)
    return next((name for name in above if name.casefold() not in (*NAMELESS, "dicom")), "") or path.name


def format_of(path: Path) -> str:
    """Return the name of a file's format by its suffix or name, else by its first bytes; empty if unknown."""
    end = suffix(path)
    name = BY_SUFFIX.get(end) or BY_FILE_NAME.get(path.name) or BY_FILE_NAME.get(path.name.upper())
    if name:
        return name
    if companion_text(path) is not None:  # some scanners write DICOM under the suffix .img
        return BY_VALUES[end]
    with path.open("rb") as file:
        head = file.read(HEAD)
    if head[:2] == b"\x1f\x8b" and end == ".gz":
        try:
            with gzip.open(path) as inside:
                head = inside.read(HEAD)
        except (OSError, EOFError, zlib.error):
            return ""
        packed = BY_SUFFIX[".nii.gz"]
        return packed if marked(head) == packed else ""
    return marked(head)


def companion_text(path: Path) -> Path | None:
    """Return the text that describes a file of flat values, whatever the case of its name; None of other files."""
    names = {path.stem.lower() + end for end in suffixes_of_text(path)}
    files = sorted(path.parent.iterdir()) if names else []
    return next((file for file in files if file.name.lower() in names and file.is_file()), None)


def suffixes_of_text(path: Path) -> tuple[str, ...]:
    """Return the suffixes of the texts that describe files of flat values; none for other files."""
    name = BY_VALUES.get(suffix(path))
    return () if name is None else FORMATS[name].suffixes


def files_below(folder: Path) -> Iterator[Path]:
    """Yield every file at any depth in natural order; hidden ones, and folders that are a volume, are passed over."""
    pending = [str(folder)]
    while pending:
        inner = Path(pending.pop())
        entries = list(os.scandir(inner))
        if inner != folder and folder_format(inner, {entry.name for entry in entries}):
            continue
        entries = [entry for entry in entries if not entry.name.startswith(".")]
        entries.sort(key=lambda entry: natural_key(Path(entry.name)))
        yield from (Path(entry.path) for entry in entries if entry.is_file())
        pending += [entry.path for entry in reversed(entries) if entry.is_dir(follow_symlinks=False)]


def segmentation_sibling(path: str | os.PathLike[str]) -> Path | None:
    """Return the LiTS label file `segmentation-N` beside `volume-N` (.nii or .nii.gz), or None."""
    siblings = (Path(path).with_name(name) for name in segmentation_names(path))
    return next((sibling for sibling in siblings if sibling.is_file()), None)


def segmentation_names(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """Return the possible names of the label file of a LiTS volume, the likelier one first; none for other files.

    Examples
    --------
    >>> segmentation_names("lits/volume-6.nii"), segmentation_names("liver.nii")
    (('segmentation-6.nii', 'segmentation-6.nii.gz'), ())
    """
    match = re.fullmatch(r"volume-(.+?)\.nii(\.gz)?", Path(path).name, re.IGNORECASE)
    if match is None:
        return ()
    return tuple(f"segmentation-{match[1]}{end}" for end in ((".nii.gz", ".nii") if match[2] else (".nii", ".nii.gz")))


MASK_WORDS = ("mask", "segment", "label")
"""Words in the name of a folder of masks, such as MASKS_DICOM or segmentations."""


def is_named_mask(names: Iterable[str]) -> bool:
    """Return whether one of these names of folders is that of masks.

    Examples
    --------
    >>> is_named_mask(["MASKS_DICOM", "liver"]), is_named_mask(["PATIENT_DICOM"])
    (True, False)
    """
    return any(word in name.casefold() for name in names for word in MASK_WORDS)
