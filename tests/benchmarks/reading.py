# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading DICOM folders, against SimpleITK's series reader. The files are in the system's cache."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.cli.phantom.files import write_dicom_steps
from ctmc_addon.core import Budget
from ctmc_addon.core.progress import finish
from ctmc_addon.readers import read_volume

from . import scenes
from .measuring import Session

PATIENTS = ("ircadb01_abdomen", "lidc0314_thorax")  # whole series
PEER = "SimpleITK's series reader"


def measure(session: Session) -> None:
    """The phantom's folder, and those of patients, on one thread each."""
    compare(session, "the phantom", dicom_folder(session.scratch))
    for name in PATIENTS:
        if (session.data / name).is_dir():
            compare(session, name, session.data / name)
    for folder in session.also:
        if folder.is_dir():
            compare(session, folder.name, folder)


def compare(session: Session, name: str, folder: Path) -> None:
    """A row, once both readers gave the same values."""
    _image, theirs = simple_itk(folder)
    ours = read_volume(folder)
    assert ours.values.shape == theirs.shape, "the two readers do not agree"
    assert np.array_equal(np.sort(ours.values[:: len(theirs) - 1].mean(axis=(1, 2))), ends_of(theirs)), "nor in values"
    session.compare(
        f"reading a DICOM folder, {name}, {len(theirs)} slices",
        lambda: read_volume(folder, budget=Budget(threads=1)),
        {PEER: (lambda: simple_itk(folder), 1.0)},
    )


def ends_of(values: NDArray[np.int16]) -> NDArray[np.float64]:
    """Mean values of the first and the last slice, the lower first: which is first is the reader's choice."""
    return np.sort(values[:: len(values) - 1].mean(axis=(1, 2)))


def dicom_folder(scratch: Path) -> Path:
    """The phantom as a DICOM series, made once a run."""
    folder = scratch / "dicom"
    if not folder.exists():
        made = scenes.made_abdomen()
        np.save(scratch / "abdomen.npy", made.volume.values)
        finish(write_dicom_steps(made, scratch))
    return folder


def simple_itk(folder: Path) -> tuple[Any, NDArray[np.int16]]:
    """The series as its users read it: the image, and its values, which live as long as the image."""
    import SimpleITK

    reader = SimpleITK.ImageSeriesReader()
    reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(folder)))
    image = reader.Execute()
    return image, SimpleITK.GetArrayViewFromImage(image)
