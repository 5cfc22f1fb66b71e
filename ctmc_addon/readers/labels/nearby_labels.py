# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the labels near a CT: LiTS segmentations, DICOM SEG and RTSTRUCT files, and folders of masks."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from itertools import islice
from pathlib import Path

from ..dicom.header import ImageFile, read_header
from ..dicom.labels.classes import label_class
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
        beside = [entry for entry in inner if ct.is_dir() and entry.parent == ct.parent]
        labels = [file for file in below if file != ct and label_class(file)]
        if len(beside) <= FEW_FOLDERS:
            nearby = [file for entry in beside for file in _label_files(entry)]
            labels += _labels_of(below, nearby) if nearby else []
    except OSError:
        return ()
    holders = {around for file in labels for around in file.parents}
    masks = [entry for entry in inner if is_named_mask([entry.name]) and entry not in holders]
    return (*sorted(labels, key=natural_key), *sorted(masks, key=natural_key))


def _label_files(folder: Path) -> list[Path]:
    """Return the files of a folder if they are few and all of them labels, such as `mask` beside `image`."""
    files = [file for _, file in zip(range(FEW_FILES + 1), files_below(folder), strict=False)]
    return files if len(files) <= FEW_FILES and all(map(label_class, files)) else []


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
