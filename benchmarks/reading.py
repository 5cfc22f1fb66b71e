# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading DICOM folders and masks, against SimpleITK's series reader. The files are in the system's cache."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.cli.phantom.files import dicom_name, dicom_slice, write_dicom_steps
from ctmc_addon.core import Budget, Volume
from ctmc_addon.core.progress import finish
from ctmc_addon.readers import read_volume

from . import scenes
from .measuring import Session

PATIENTS = ("ircadb01_abdomen", "lidc0314_thorax")  # Whole series.
PEER = "SimpleITK's series reader"
ORGANS = ("ts_nifti", "example_seg_fast_force_split.nii.gz")  # Labels of a patient.
MASKS, WIDER = 8, 4  # Number of organs; mask pixels per label pixel along each side.


def measure(session: Session) -> None:
    """Measure the phantom's folder, and those of patients, on one thread each."""
    compare(session, "the phantom", dicom_folder(session.scratch))
    for name in PATIENTS:
        if (session.data / name).is_dir():
            compare(session, name, session.data / name)
    for folder in session.also:
        if folder.is_dir():
            compare(session, folder.name, folder)
    organs = session.data.joinpath(*ORGANS)
    if organs.exists():
        masks(session, mask_folders(organs, session.scratch / "masks"))
    else:
        session.say(f"No {organs.name} in {session.data}: the row of masks is left out")


def masks(session: Session, folder: Path) -> None:
    """Measure a folder of masks read as one label volume; the peer reads each mask."""
    folders = sorted(folder.iterdir())
    labels = read_volume(folder)
    assert set(labels.label_names.values()) == {each.name for each in folders}, "a mask is missing"
    slices, rows, columns = labels.shape
    session.compare(
        f"reading {len(folders)} folders of {slices} DICOM slices of {columns} x {rows} with a mask each",
        lambda: read_volume(folder, budget=Budget(threads=1)),
        {f"{PEER}, each folder": (lambda: [simple_itk(each) for each in folders], 1.0)},
    )


def mask_folders(organs: Path, folder: Path) -> Path:
    """Write a DICOM series for each of the largest organs of a label volume."""
    import pydicom

    values = read_volume(organs).values
    counts = np.bincount(values.ravel())
    largest = 1 + np.argsort(-counts[1:], kind="stable")[:MASKS]
    for label in largest.tolist():
        mask = (values == label).astype(np.int16).repeat(WIDER, axis=1).repeat(WIDER, axis=2)
        volume = Volume(mask, np.diag([0.75, 0.75, 3.0, 1.0]))
        own = folder / f"organ_{label}"
        own.mkdir(parents=True)
        for k, plane in enumerate(mask):
            dicom_slice(pydicom, volume, plane, k, own.name).save_as(own / dicom_name(k + 1), enforce_file_format=True)
    return folder


def compare(session: Session, name: str, folder: Path) -> None:
    """Add a row after checking that both readers gave the same values."""
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
    """Return mean values of the first and the last slice, the lower first, because readers differ in order."""
    return np.sort(values[:: len(values) - 1].mean(axis=(1, 2)))


def dicom_folder(scratch: Path) -> Path:
    """Write the phantom as a DICOM series, once per run."""
    folder = scratch / "dicom"
    if not folder.exists():
        phantom = scenes.abdomen_phantom()
        np.save(scratch / "abdomen.npy", phantom.volume.values)
        finish(write_dicom_steps(phantom, scratch))
    return folder


def simple_itk(folder: Path) -> tuple[Any, NDArray[np.int16]]:
    """Read the series as users of SimpleITK do; the values live as long as the image."""
    import SimpleITK

    reader = SimpleITK.ImageSeriesReader()
    reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(folder)))
    image = reader.Execute()
    return image, SimpleITK.GetArrayViewFromImage(image)
