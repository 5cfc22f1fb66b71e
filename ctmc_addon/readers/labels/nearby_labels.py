# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the labels near a CT: LiTS segmentations, DICOM SEG and RTSTRUCT files, and folders of masks."""

from __future__ import annotations

import os
from pathlib import Path

from ..dicom.labels.classes import label_class
from ..file_formats import files_below, natural_key, segmentation_sibling

NAMES = ("mask", "segment", "label")
"""Words in the name of a folder of masks, such as MASKS_DICOM or segmentations."""
MOST_FILES = 5000  # Only this many files of a folder are examined.


def labels_beside(path: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Return the files and folders of labels near a CT; reading them shows whether they fit it.

    Parameters
    ----------
    path : path
        File or folder of the CT.
    """
    ct = Path(path).absolute()
    sibling = segmentation_sibling(ct)
    if sibling is not None:
        return (sibling,)
    try:
        folder = ct if ct.is_dir() else ct.parent
        below = [file for _, file in zip(range(MOST_FILES), files_below(folder), strict=False)]
        labels = [file for file in below if file != ct and label_class(file)]
        folders = [ct.parent, ct] if ct.is_dir() else [ct.parent]
        inner = [entry for around in folders for entry in around.iterdir() if entry.is_dir() and entry != ct]
    except OSError:
        return ()
    holders = {around for file in labels for around in file.parents}
    named = [entry for entry in inner if any(word in entry.name.casefold() for word in NAMES)]
    masks = [entry for entry in named if entry not in holders]
    return (*sorted(labels, key=natural_key), *sorted(masks, key=natural_key))
