# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the phantom as a PNG series, as a DICOM series and as a LiTS pair of NIfTI files.

Each slice is a file, and each file is complete or missing. Nothing in them names a person, a time or a machine.
"""

from __future__ import annotations

import gzip
import importlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import VERSION, CtmcError, OutputError, Step, Steps
from ...core.files.atomic_write import create_folder, whole_file
from ...core.phantom import Phantom
from ...core.volume import Volume, transform_points

WINDOW = (-160, 240)  # These HU become 0 and 255 in a PNG.
CT_IMAGE_STORAGE = "1.2.840.10008.5.1.4.1.1.2"


def _png_name(number: int) -> str:
    """Return a name without leading zeros, as many tools write them: readers must sort by number."""
    return f"slice_{number}.png"


def dicom_name(number: int) -> str:
    """Return the file of the slice with this number, from 1."""
    return f"slice_{number:04d}.dcm"


def require_own_slices(folder: Path, formats: list[str], slices: int) -> None:
    """Refuse folders that hold slices of something else, which a reader would take for this phantom's.

    Parameters
    ----------
    folder : Path
    formats : list of str
        Folders in it, such as 'png'.
    slices : int
        How many the phantom has.

    Raises
    ------
    OutputError
        If a folder holds others.
    """
    for name, namer in (("png", _png_name), ("dicom", dicom_name)):
        if name not in formats or not (folder / name).is_dir():
            continue
        ours = {namer(number) for number in range(1, slices + 1)}
        foreign_files = sorted(path.name for path in (folder / name).iterdir() if path.name not in ours)
        if foreign_files:
            raise OutputError(
                f"{folder / name} holds {foreign_files[0]}, which is not a slice of this phantom; choose another folder"
            )


def _write_png_steps(phantom: Phantom, folder: Path) -> Steps[list[str]]:
    """Write 8 bit gray slices from the feet to the head, HU -160 to 240."""
    image = library("PIL.Image", "Pillow")
    png_folder = create_folder(folder / "png")
    low, high = WINDOW
    for k, plane in enumerate(phantom.volume.values):
        yield Step(k / len(phantom.volume.values), "Writing PNG")
        gray = (np.clip(plane, low, high).astype(np.int32) - low) * 255 // (high - low)
        buffer = io.BytesIO()
        image.fromarray(gray.astype(np.uint8)).save(buffer, "PNG")
        write_bytes(png_folder / _png_name(k + 1), buffer.getvalue())
    return ["png/"]


def write_nifti_steps(phantom: Phantom, folder: Path) -> Steps[list[str]]:
    """Write `volume-SEED.nii.gz` and `segmentation-SEED.nii.gz`, as in LiTS."""
    nibabel = library("nibabel", "nibabel")
    names = []
    for at, volume in enumerate((phantom.volume, phantom.labels)):
        name = f"{volume.name}.nii.gz"
        yield Step(at / 2, f"Writing {name}")
        image = nibabel.Nifti1Image(volume.values.transpose(2, 1, 0), volume.affine)
        image.header.set_xyzt_units("mm")
        image.set_sform(volume.affine, code=1)
        image.set_qform(volume.affine, code=1)
        # Level 3 is 4 times as fast as the usual 9 for a few per cent more; no time, no name in the header.
        write_bytes(folder / name, gzip.compress(image.to_bytes(), 3, mtime=0))
        names.append(name)
    return names


def write_dicom_steps(phantom: Phantom, folder: Path) -> Steps[list[str]]:
    """Write CT Image Storage (PS3.3 A.3), explicit VR little endian, with identifiers derived from the content."""
    pydicom = library("pydicom", "pydicom")
    dicom_folder = create_folder(folder / "dicom")
    # Phantoms of one seed but another grid are other series.
    root = f"ctmc phantom {phantom.seed} {phantom.volume.size} {phantom.volume.spacing}"
    for k, plane in enumerate(phantom.volume.values):
        yield Step(k / len(phantom.volume.values), "Writing DICOM")
        dataset = dicom_slice(pydicom, phantom.volume, plane, k, root)
        buffer = io.BytesIO()
        dataset.save_as(buffer, enforce_file_format=True)
        write_bytes(dicom_folder / dicom_name(k + 1), buffer.getvalue())
    return ["dicom/"]


def dicom_slice(pydicom: Any, volume: Volume, plane: NDArray[np.int16], k: int, root: str) -> Any:
    """Return the dataset of slice `k`, with the attributes that CT Image Storage asks for."""

    def uid(purpose: str) -> Any:
        return pydicom.uid.generate_uid(entropy_srcs=[root, purpose])

    meta = pydicom.dataset.FileMetaDataset()
    meta.MediaStorageSOPClassUID = CT_IMAGE_STORAGE
    meta.MediaStorageSOPInstanceUID = uid(f"slice {k}")
    meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
    meta.ImplementationClassUID = pydicom.uid.generate_uid(entropy_srcs=["ctmc"])
    meta.ImplementationVersionName = f"CTMC_{VERSION}"
    dataset = pydicom.dataset.Dataset()
    dataset.file_meta = meta
    dataset.SpecificCharacterSet = "ISO_IR 192"
    dataset.ImageType = ["DERIVED", "SECONDARY", "AXIAL"]
    dataset.SOPClassUID, dataset.SOPInstanceUID = CT_IMAGE_STORAGE, meta.MediaStorageSOPInstanceUID
    dataset.PatientName, dataset.PatientID = "Phantom^CTMC", "PHANTOM"
    dataset.StudyInstanceUID, dataset.SeriesInstanceUID = uid("study"), uid("series")
    dataset.FrameOfReferenceUID = uid("frame")
    for keyword in (
        "StudyDate",
        "StudyTime",
        "AccessionNumber",
        "ReferringPhysicianName",
        "PatientBirthDate",
        "PatientSex",
        "StudyID",
        "PositionReferenceIndicator",
        "AcquisitionNumber",
        "KVP",
    ):
        setattr(dataset, keyword, None)  # type 2: there, and empty
    dataset.Modality, dataset.Manufacturer, dataset.SeriesNumber = "CT", "CTMC phantom", 1
    dataset.PatientPosition, dataset.InstanceNumber = "HFS", k + 1
    x, y, z = volume.spacing
    right, front, height = transform_points(volume.affine, np.array([[0, 0, k]]))[0].tolist()
    dataset.ImagePositionPatient = [decimal(-right), decimal(-front), decimal(height)]  # PS3.3 C.7.6.2.1.1: LPS
    dataset.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
    # PS3.3 10.7.1.3: PixelSpacing is (between rows, between columns), so y before x.
    dataset.PixelSpacing, dataset.SliceThickness = [decimal(y), decimal(x)], decimal(z)
    dataset.SamplesPerPixel, dataset.PhotometricInterpretation = 1, "MONOCHROME2"
    dataset.Rows, dataset.Columns = plane.shape
    dataset.BitsAllocated, dataset.BitsStored, dataset.HighBit, dataset.PixelRepresentation = 16, 16, 15, 1
    dataset.RescaleIntercept, dataset.RescaleSlope, dataset.RescaleType = 0, 1, "HU"
    dataset.WindowCenter, dataset.WindowWidth = 40, 400
    dataset.PixelData = plane.astype("<i2").tobytes()
    return dataset


def decimal(number: float) -> str:
    """Return a decimal string, at most 16 characters long (PS3.5 6.2)."""
    text = f"{number:.10g}"
    return text if len(text) <= 16 else f"{number:.8g}"


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_bytes(content)


def library(module: str, package: str) -> Any:
    """Return the module, or a sentence about the package that is missing."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise CtmcError(f"writing this format needs the Python package {package}, which is missing") from error


WRITERS: dict[str, Callable[[Phantom, Path], Steps[list[str]]]] = {
    "png": _write_png_steps,
    "dicom": write_dicom_steps,
    "nifti": write_nifti_steps,
}
