# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the labels near a CT: LiTS segmentations, DICOM SEG and RTSTRUCT files, and folders of masks.

Doses (RTDOSE) and PET near it are found here too.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from itertools import islice
from pathlib import Path

from ..dicom.header import ImageFile, read_header
from ..dicom.labels.classes import DOSE, PET, label_class, object_class
from ..file_formats import files_below, is_named_mask, natural_key, segmentation_sibling
from ..optional_imports import quiet

MOST_FILES = 5000  # Only this many files of a folder are examined.
FEW_FILES = 10  # A folder beside the CT with more files is that of another CT, or of masks.
FEW_FOLDERS = 10  # More folders beside that of the CT are those of other patients.
HEAD = 1 << 20  # Bytes of a label file in which it names its CT.


def labels_beside(path: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Return the files and folders of labels near a CT; reading them shows whether they fit it.

    Parameters
    ----------
    path : path
        File or folder of the CT; of slices their folder.
    """
    ct = Path(path).absolute()
    sibling = segmentation_sibling(ct)
    if sibling is not None:
        return (sibling,)
    try:
        folder = ct if ct.is_dir() else ct.parent
        below = [file for _, file in zip(range(MOST_FILES), files_below(folder), strict=False)]
        folders = [ct.parent, ct] if ct.is_dir() else [ct.parent]
        inner = [entry for around in folders for entry in around.iterdir() if entry.is_dir() and entry != ct]
        neighbors = [entry for entry in inner if ct.is_dir() and entry.parent == ct.parent]
        labels = [file for file in below if file != ct and label_class(file)]
        if len(neighbors) <= FEW_FOLDERS:
            nearby = [file for entry in neighbors for file in _label_files(entry)]
            labels += _labels_of(below, nearby) if nearby else []
    except OSError:
        return ()
    holders = {around for file in labels for around in file.parents}
    masks = [entry for entry in inner if is_named_mask([entry.name]) and entry not in holders]
    return (*sorted(labels, key=natural_key), *sorted(masks, key=natural_key))


def _label_files(folder: Path) -> list[Path]:
    """Return the labels of a folder if its files are few and labels or doses, such as `mask` beside `image`."""
    files = _few_files(folder)
    return [file for file in files if label_class(file)] if all(map(_is_not_an_image, files)) else []


def _is_not_an_image(file: Path) -> bool:
    return object_class(file) not in ("", PET)


def _few_files(folder: Path) -> list[Path]:
    """Return the files of a folder; none where they are many."""
    files = [file for _, file in zip(range(FEW_FILES + 1), files_below(folder), strict=False)]
    return files if len(files) <= FEW_FILES else []


def volumes_beside(path: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Return the doses (RTDOSE) and PET near a CT: files, and folders of one series alone.

    Those in the folder of the CT are taken as they are; those in folders beside it share its frame of reference.

    Parameters
    ----------
    path : path
        File or folder of the CT; of slices their folder.
    """
    ct = Path(path).absolute()
    folder = ct if ct.is_dir() else ct.parent
    try:
        below = [file for _, file in zip(range(MOST_FILES), files_below(folder), strict=False) if file != ct]
        classes = {file: object_class(file) for file in below}
        volumes = [file for file, kind in classes.items() if kind == DOSE]
        if not all(kind == PET for kind in classes.values()):  # else it is what was asked for itself
            volumes += _series_of([file for file, kind in classes.items() if kind == PET], below, ct)
        if ct.is_dir():
            neighbors = [entry for entry in ct.parent.iterdir() if entry.is_dir() and entry != ct]
            images = [file for file, kind in classes.items() if not kind]
            volumes += _volumes_in(neighbors, images) if len(neighbors) <= FEW_FOLDERS else []
    except OSError:
        return ()
    return tuple(sorted(volumes, key=natural_key))


def _volumes_in(folders: list[Path], images: list[Path]) -> list[Path]:
    """Return the doses in folders of few files, and the folders that begin with a PET, that name the CT of images."""
    doses = [file for folder in folders for file in _few_files(folder) if object_class(file) == DOSE]
    first = {}
    for folder in folders:
        files = list(islice(files_below(folder), FEW_FILES))
        if files and all(object_class(file) == PET for file in files):
            first[files[0]] = folder
    named = _labels_of(images, [*doses, *first]) if doses or first else []
    return [first.get(file, file) for file in named]


def _series_of(files: list[Path], below: list[Path], ct: Path) -> list[Path]:
    """Return a path for each PET series: its folder if nothing else lies in it, else its first file."""
    with quiet():
        headers = [header for header in map(read_header, files) if isinstance(header, ImageFile)]
    series: dict[str, list[Path]] = {}
    for header in headers:
        series.setdefault(header.series, []).append(header.path)
    paths = []
    for members in series.values():
        folder = members[0].parent
        is_alone = folder != ct and {file for file in below if file.parent == folder} == set(members)
        paths.append(folder if is_alone else min(members, key=natural_key))
    return paths


def _labels_of(slices: Iterable[Path], labels: list[Path]) -> list[Path]:
    """Return the labels that name the CT of these slices: by its series or its frame of reference."""
    with quiet():
        headers = [read_header(file) for file in islice(slices, FEW_FILES)]
    images = [header for header in headers if isinstance(header, ImageFile)]
    names = {name for image in images for name in (image.series, image.frame_of_reference) if name}
    if not names:
        return []
    named = re.compile(rb"(?<![0-9.])(?:%s)(?![0-9.])" % b"|".join(re.escape(name.encode()) for name in names))
    of_ct = []
    for label in labels:
        with label.open("rb") as file:
            if named.search(file.read(HEAD)):
                of_ct.append(label)
    return of_ct
