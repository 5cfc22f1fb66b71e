# SPDX-License-Identifier: GPL-3.0-or-later
"""PET series and doses made for the tests, with pydicom alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

AXIAL = (1, 0, 0, 0, 1, 0)
EXPLICIT = "1.2.840.10008.1.2.1"
PET = "1.2.840.10008.5.1.4.1.1.128"
DOSE = "1.2.840.10008.5.1.4.1.1.481.2"
PATIENT = "Muster^Erika"


def item(**values: Any) -> Any:
    """Return a dataset; what is None is left out."""
    from pydicom.dataset import Dataset

    dataset = Dataset()
    for name, value in values.items():
        if value is not None:
            setattr(dataset, name, value)
    return dataset


def _write(path: Path, stored: np.ndarray, sop_class: str, compress: str | None = None, **tags: Any) -> Any:
    import pydicom
    from pydicom import uid
    from pydicom.dataset import FileMetaDataset

    pixels = {
        "SOPClassUID": sop_class,
        "SOPInstanceUID": uid.generate_uid(),
        "PatientName": PATIENT,
        "PatientID": "ID-4711",
        "StudyInstanceUID": "1.2.3.4",
        "Rows": stored.shape[-2],
        "Columns": stored.shape[-1],
        "SamplesPerPixel": 1,
        "PhotometricInterpretation": "MONOCHROME2",
        "BitsAllocated": 8 * stored.dtype.itemsize,
        "BitsStored": 8 * stored.dtype.itemsize,
        "HighBit": 8 * stored.dtype.itemsize - 1,
        "PixelRepresentation": 0,
    }
    dataset = item(**{**pixels, **tags})
    dataset.file_meta = FileMetaDataset()
    dataset.file_meta.TransferSyntaxUID = uid.UID(EXPLICIT)
    dataset.file_meta.MediaStorageSOPClassUID = sop_class
    dataset.file_meta.MediaStorageSOPInstanceUID = dataset.SOPInstanceUID
    dataset.add_new("PixelData", "OW", stored.astype(stored.dtype.newbyteorder("<")).tobytes())
    if compress is not None:
        dataset.compress(compress, generate_instance_uid=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    pydicom.dcmwrite(path, dataset, enforce_file_format=True)
    return dataset


def write_dose(
    path: Path,
    stored: np.ndarray,
    offsets: Any,
    position: Any = (-10.0, -20.0, 30.0),
    scaling: float | None = 0.001,
    compress: str | None = None,
    **tags: Any,
) -> Any:
    """Write a dose; `stored` is (frames, rows, columns). Tags are given by keyword, None leaves one out."""
    about = {
        "Modality": "RTDOSE",
        "SeriesInstanceUID": "1.2.3.4.8",
        "FrameOfReferenceUID": "1.2.3.99",
        "NumberOfFrames": len(stored),
        "ImagePositionPatient": list(position),
        "ImageOrientationPatient": list(AXIAL),
        "PixelSpacing": [2.5, 1.5],
        "GridFrameOffsetVector": None if offsets is None else list(offsets),
        "DoseGridScaling": scaling,
        "DoseUnits": "GY",
        "DoseType": "PHYSICAL",
        "DoseSummationType": "PLAN",
    }
    return _write(path, stored, DOSE, compress, **{**about, **tags})


def write_grams(folder: Path, suv: np.ndarray, spacing: float = 2.0, position: Any = (0.0, 0.0, 0.0)) -> None:
    """Write a PET whose values are SUVbw already, in steps of 0.001; `suv` is (slices, rows, columns)."""
    for number, plane in enumerate(suv):
        x, y, z = position
        _write(
            folder / f"{number}.dcm",
            np.rint(plane * 1000).astype(np.uint16),
            PET,
            Modality="PT",
            SeriesInstanceUID="1.2.3.4.9",
            FrameOfReferenceUID="1.2.3.99",
            InstanceNumber=number + 1,
            ImagePositionPatient=[x, y, z + spacing * number],
            ImageOrientationPatient=list(AXIAL),
            PixelSpacing=[spacing, spacing],
            RescaleSlope=0.001,
            RescaleIntercept=0,
            Units="GML",
        )
