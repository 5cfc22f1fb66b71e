# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user of a cohort waits for: the start of `ctmc`, and livers from labels to STL against 3D Slicer's recipe."""

from __future__ import annotations

import numpy as np

from ctmc_addon.core.phantom.phantom import LIVER

from . import scenes
from .measuring import Row, Session
from .processes import REMOVED, compare, reconstruct, run, written

TARGETS = {0.0: 0.9, REMOVED: 0.6}  # Targets against Slicer's recipe.
VERSION_SECONDS, TINY_SECONDS = 0.15, 0.45
INSIDE = ["--label", "1"]
PATIENT = ("ts_nifti", "example_seg_dicom.nii.gz", 5)  # Folder of the real CT, file, and label of the liver.


def measure(session: Session) -> None:
    """Measure all rows of this part."""
    start(session)
    phantom = scenes.abdomen_phantom()
    labels = written(session.scratch / "labels.nii", phantom.labels.values, phantom.labels.affine)
    compare(session, "the phantom's liver", labels, ["--label", str(LIVER)], TARGETS)
    folder, name, liver = PATIENT
    if (session.data / folder / name).exists():
        compare(session, "a patient's liver, 20 slices", session.data / folder / name, ["--label", str(liver)], TARGETS)


def start(session: Session) -> None:
    """Measure the start of a process, and a process for a tiny label."""
    mask = np.zeros((24, 40, 40), np.uint8)
    mask[6:18, 10:30, 10:30] = 1
    tiny = written(session.scratch / "tiny.nii", mask, np.eye(4))
    out = session.scratch / "tiny.stl"
    starts = {
        "ctmc --version, whole process": (VERSION_SECONDS, lambda: run(["ctmc_addon", "--version"], None)),
        "a label of 24 x 40 x 40 to STL, whole process": (TINY_SECONDS, lambda: reconstruct(tiny, out, INSIDE)),
    }
    for work, (limit, call) in starts.items():
        session.add(Row(session.part, work, f"{limit:g} s", session.seconds(call), limit, 1.0))
