# SPDX-License-Identifier: GPL-3.0-or-later
"""PET series and doses made for the tests, with pydicom alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

AXIAL = (1, 0, 0, 0, 1, 0)
PET = "1.2.840.10008.5.1.4.1.1.128"
DOSE = "1.2.840.10008.5.1.4.1.1.481.2"
TRACER = {"RadionuclideTotalDose": 350e6, "RadionuclideHalfLife": 6586.2, "RadiopharmaceuticalStartTime": "090000.00"}
FDG = {
    "Modality": "PT",
    "SOPClassUID": PET,
    "Units": "BQML",
    "DecayCorrection": "START",
    "CorrectedImage": ["DECY", "ATTN", "SCAT"],
    "SeriesDate": "20240229",
    "SeriesTime": "100000",
    "AcquisitionDate": "20240229",
    "AcquisitionTime": "100000",
    "PatientWeight": 70,
    "RescaleIntercept": 0,
}


def item(**values: Any) -> Any:
    from pydicom.dataset import Dataset

    dataset = Dataset()
    for name, value in values.items():
        if value is not None:
            setattr(dataset, name, value)
    return dataset


@pytest.fixture
def save_pet(save_slice: Callable[..., Any]) -> Callable[..., np.ndarray]:
    """Write a PET series of three slices, each with a slope of its own; returns slope times stored, float64.

    Tags are given by keyword, None leaves one out; so are those of the tracer. `private` are (tag, VR, value), and
    `each` gives further tags of a slice by its number.
    """

    def save(
        folder: Path,
        tracer: dict[str, Any] | None = None,
        private: Any = (),
        slopes: Any = (0.5, 1.25, 2.0),
        each: Callable[[int], dict[str, Any]] = lambda number: {},
        **tags: Any,
    ) -> np.ndarray:
        import pydicom

        stored = np.random.default_rng(2).integers(0, 30000, (len(slopes), 5, 7)).astype(np.uint16)
        for number, slope in enumerate(slopes):
            path = folder / f"{number}.dcm"
            own = {**FDG, "SeriesInstanceUID": "1.2.3.4.9", "InstanceNumber": number + 1, "RescaleSlope": slope}
            sequence = [item(**{**TRACER, **(tracer or {})})]
            all_tags = {"RadiopharmaceuticalInformationSequence": sequence, **own, **tags, **each(number)}
            dataset = save_slice(path, stored[number], (-10, -20, 3.0 * number), **all_tags)
            for tag, vr, value in private:
                dataset.add_new(tag, vr, value)
            if private:
                pydicom.dcmwrite(path, dataset, enforce_file_format=True)
        return stored * np.array(slopes, float)[:, None, None]

    return save


@pytest.fixture
def save_dose() -> Callable[..., Any]:
    """Write a dose; `stored` is (frames, rows, columns). Tags are given by keyword, None leaves one out."""

    def save(
        path: Path,
        stored: np.ndarray,
        offsets: Any,
        position: Any = (-10.0, -20.0, 30.0),
        scaling: float | None = 0.001,
        compress: str | None = None,
        **tags: Any,
    ) -> Any:
        import pydicom

        from tests.readers.conftest import EXPLICIT, _dataset

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
        dataset = _dataset(stored, EXPLICIT, DOSE, {**about, **tags})
        if compress is not None:
            dataset.compress(compress, generate_instance_uid=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        pydicom.dcmwrite(path, dataset, enforce_file_format=True)
        return dataset

    return save
