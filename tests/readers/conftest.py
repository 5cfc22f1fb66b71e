# SPDX-License-Identifier: GPL-3.0-or-later
"""DICOM files made for the tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

AXIAL = (1, 0, 0, 0, 1, 0)
CT = "1.2.840.10008.5.1.4.1.1.2"
ENHANCED_CT = "1.2.840.10008.5.1.4.1.1.2.1"
EXPLICIT = "1.2.840.10008.1.2.1"
PATIENT = "Muster^Erika"


def _dataset(stored: np.ndarray, syntax: str, sop_class: str, tags: dict[str, Any]) -> Any:
    from pydicom import uid
    from pydicom.dataset import Dataset, FileMetaDataset

    dataset = Dataset()
    dataset.file_meta = FileMetaDataset()
    dataset.file_meta.TransferSyntaxUID = uid.UID(syntax)
    dataset.SOPClassUID = dataset.file_meta.MediaStorageSOPClassUID = sop_class
    dataset.SOPInstanceUID = dataset.file_meta.MediaStorageSOPInstanceUID = uid.generate_uid()
    dataset.PatientName, dataset.PatientID = PATIENT, "ID-4711"
    dataset.StudyInstanceUID, dataset.Modality = "1.2.3.4", "CT"
    dataset.Rows, dataset.Columns = stored.shape[-2:]
    dataset.SamplesPerPixel, dataset.PhotometricInterpretation = 1, "MONOCHROME2"
    dataset.BitsAllocated = dataset.BitsStored = 8 * stored.dtype.itemsize
    dataset.PixelRepresentation = int(stored.dtype.kind == "i")
    for name, value in tags.items():
        if value is None and name in dataset:
            delattr(dataset, name)
        elif value is not None:
            setattr(dataset, name, value)
    dataset.HighBit = tags.get("HighBit", dataset.BitsStored - 1)
    order = ">" if syntax == uid.ExplicitVRBigEndian else "<"
    dataset.PixelData = stored.astype(stored.dtype.newbyteorder(order)).tobytes()
    dataset["PixelData"].VR = "OW" if stored.dtype.itemsize > 1 else "OB"
    return dataset


@pytest.fixture
def save_slice() -> Callable[..., Any]:
    """Write one CT slice; tags are given by keyword, None leaves one out."""

    def save(
        path: Path,
        stored: np.ndarray,
        position: tuple[float, float, float] = (0, 0, 0),
        syntax: str = EXPLICIT,
        compress: str | None = None,
        **tags: Any,
    ) -> Any:
        import pydicom

        place = {
            "ImagePositionPatient": list(position),
            "ImageOrientationPatient": list(AXIAL),
            "PixelSpacing": [0.8, 0.5],
            "SeriesInstanceUID": "1.2.3.4.5",
            "RescaleSlope": 1,
            "RescaleIntercept": -1024,
        }
        dataset = _dataset(stored, syntax, CT, {**place, **tags})
        if compress is not None:
            dataset.compress(compress, generate_instance_uid=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        pydicom.dcmwrite(path, dataset, enforce_file_format=True)
        return dataset

    return save


@pytest.fixture
def save_stack(save_slice: Callable[..., Any]) -> Callable[..., np.ndarray]:
    """Write slices at heights `z` with random pixels; returns those in HU, in the order given."""

    def save(folder: Path, z: Any, shape: tuple[int, int] = (5, 7), seed: int = 0, **tags: Any) -> np.ndarray:
        random = np.random.default_rng(seed)
        stored = random.integers(0, 3000, (len(z), *shape)).astype(np.uint16)
        for number, height in enumerate(z):
            save_slice(
                folder / f"{number}.dcm", stored[number], (-10, -20, height), **{"InstanceNumber": number + 1, **tags}
            )
        return stored.astype(np.int16) - 1024

    return save


@pytest.fixture
def save_frames() -> Callable[..., Any]:
    """Write an enhanced multi-frame CT; geometry is per frame, what is given once is shared."""

    def save(
        path: Path,
        stored: np.ndarray,
        positions: Any,
        orientation: Any = AXIAL,
        slopes: Any = None,
        intercepts: Any = None,
        **tags: Any,
    ) -> Any:
        import pydicom
        from pydicom.dataset import Dataset

        def item(**values: Any) -> list[Any]:
            dataset = Dataset()
            for name, value in values.items():
                setattr(dataset, name, value)
            return [dataset]

        frames = []
        for number, position in enumerate(positions):
            frame = Dataset()
            frame.PlanePositionSequence = item(ImagePositionPatient=list(position))
            if slopes is not None:
                frame.PixelValueTransformationSequence = item(
                    RescaleSlope=slopes[number], RescaleIntercept=intercepts[number], RescaleType="HU"
                )
            frames.append(frame)
        shared = Dataset()
        shared.PlaneOrientationSequence = item(ImageOrientationPatient=list(orientation))
        shared.PixelMeasuresSequence = item(PixelSpacing=[0.8, 0.5])
        if slopes is None:
            shared.PixelValueTransformationSequence = item(RescaleSlope=1, RescaleIntercept=-1000, RescaleType="HU")
        groups = {
            "NumberOfFrames": len(stored),
            "SeriesInstanceUID": "1.2.3.4.6",
            "SharedFunctionalGroupsSequence": [shared],
            "PerFrameFunctionalGroupsSequence": frames,
        }
        dataset = _dataset(stored, EXPLICIT, ENHANCED_CT, {**groups, **tags})
        pydicom.dcmwrite(path, dataset, enforce_file_format=True)
        return dataset

    return save


def pixel_ras(dataset: Any, row: int, column: int) -> np.ndarray:
    """Center of a pixel in RAS+ mm by DICOM PS3.3 C.7.6.2.1.1, written out on its own."""
    position = np.array(dataset.ImagePositionPatient, float)
    orientation = np.array(dataset.ImageOrientationPatient, float)
    between_rows, between_columns = (float(value) for value in dataset.PixelSpacing)
    lps = position + orientation[:3] * between_columns * column + orientation[3:] * between_rows * row
    return lps * (-1, -1, 1)


@pytest.fixture(name="pixel_ras")
def _pixel_ras() -> Callable[..., np.ndarray]:
    return pixel_ras
