# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading a DICOM folder of 250 slices, against SimpleITK's series reader. The files are in the system's cache."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.cli.phantom.files import write_dicom_steps
from ctmc_addon.core.progress import finish
from ctmc_addon.readers import read_volume

from . import scenes
from .measuring import Session


def measure(session: Session) -> None:
    """The row of this part."""
    folder = dicom_folder(session.scratch)
    _image, theirs = simple_itk(folder)
    assert np.array_equal(read_volume(folder).values, theirs), "the two readers do not agree"
    session.compare(
        "reading a DICOM folder, 250 slices of 512 x 512",
        lambda: read_volume(folder),
        {"SimpleITK's series reader": (lambda: simple_itk(folder), 1.0)},
    )


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
