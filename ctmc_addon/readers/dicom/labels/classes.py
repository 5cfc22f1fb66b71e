# SPDX-License-Identifier: GPL-3.0-or-later
"""Recognize DICOM files of labels, doses and PET by their first bytes."""

from __future__ import annotations

import re
from pathlib import Path

SEGMENTATION, STRUCTURES, DOSE, PET = "segmentation", "structure set", "dose", "PET"
CLASSES = {
    b"1.2.840.10008.5.1.4.1.1.66.4": SEGMENTATION,
    b"1.2.840.10008.5.1.4.1.1.66.7": SEGMENTATION,  # Label maps.
    b"1.2.840.10008.5.1.4.1.1.481.3": STRUCTURES,
    b"1.2.840.10008.5.1.4.1.1.481.2": DOSE,
    b"1.2.840.10008.5.1.4.1.1.128": PET,
    b"1.2.840.10008.5.1.4.1.1.130": PET,  # Of many frames.
}
# SOPClassUID of the meta information or of the dataset, explicit or implicit.
CLASS_ELEMENT = re.compile(rb"(?:\x02\x00\x02\x00|\x08\x00\x16\x00)(?:UI..|..\x00\x00)([0-9.]{10,64})", re.DOTALL)
HEAD = 2048  # The element lies in these first bytes.


def label_class(path: Path) -> str:
    """Return 'segmentation' or 'structure set' for such a DICOM file, else empty text."""
    kind = object_class(path)
    return kind if kind in (SEGMENTATION, STRUCTURES) else ""


def object_class(path: Path) -> str:
    """Return 'segmentation', 'structure set', 'dose' or 'PET' for such a DICOM file, else empty text."""
    try:
        with path.open("rb") as file:
            head = file.read(HEAD)
    except OSError:
        return ""
    if head[128:132] != b"DICM" and head[:2] != b"\x08\x00":
        return ""
    match = CLASS_ELEMENT.search(head)
    return CLASSES.get(match[1].rstrip(b"."), "") if match else ""
