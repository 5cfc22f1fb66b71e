# SPDX-License-Identifier: GPL-3.0-or-later
"""PET series and doses made for the tests, with pydicom alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from doses import PET, item, write_dose

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
    """Write a dose; see `write_dose`."""
    return write_dose
