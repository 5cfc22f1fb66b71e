# SPDX-License-Identifier: GPL-3.0-or-later
"""A patient's folder with a CT and folders of masks, and a damaged slice, on the command line."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("pydicom")

from readers.conftest import save_slice as save_slice, save_stack as save_stack


@pytest.fixture
def patient(tmp_path, save_slice, save_stack):
    """A CT of six slices in a folder beside those of two masks, which sort before it."""
    for number, organ in enumerate(("artery", "liver"), 1):
        stored = np.zeros((6, 9, 9), np.uint8)
        stored[1:5, 2:6, number : number + 4] = 255
        for z, plane in enumerate(stored):
            place = {"SeriesInstanceUID": f"1.7.{number}", "InstanceNumber": z + 1, "RescaleIntercept": 0}
            save_slice(tmp_path / "MASKS_DICOM" / organ / f"image_{z}", plane, (0, 0, 2 * z), **place)
    save_stack(tmp_path / "PATIENT_DICOM", range(0, 12, 2), (9, 9), SeriesInstanceUID="1.7.9")
    return tmp_path


def test_info_describes_the_ct_names_each_series_and_the_labels_beside_it(ctmc, patient):
    outcome = ctmc("info", patient)
    assert (outcome.code, outcome.errors) == (0, [])
    assert "3 series found: series 3, which is not a mask, was read" in outcome.out
    assert ", HU" in outcome.out
    for folder in ("MASKS_DICOM/artery", "MASKS_DICOM/liver", "PATIENT_DICOM"):
        assert f"in {folder}" in outcome.out
    assert ["labels", "found", "MASKS_DICOM"] in [line.split() for line in outcome.out.splitlines()]
    assert json.loads(ctmc("info", patient, "--json").out)["labels_found"] == ["MASKS_DICOM"]
    assert json.loads(ctmc("info", patient / "MASKS_DICOM", "--json").out)["labels_found"] == []


@pytest.mark.parametrize("series", [None, "PATIENT_DICOM", "3"])
def test_reconstruct_makes_the_surface_of_the_ct(ctmc, patient, tmp_path, series):
    words = [] if series is None else ["--series", series]
    outcome = ctmc("reconstruct", patient, *words, "--threshold", "300", "-o", tmp_path / "a.stl")
    assert outcome.code == 0, outcome.errors
    alone = ctmc("reconstruct", patient / "PATIENT_DICOM", "--threshold", "300", "-o", tmp_path / "b.stl")
    assert alone.code == 0, alone.errors
    assert (tmp_path / "a.stl").read_bytes()[80:] == (tmp_path / "b.stl").read_bytes()[80:]


def test_a_damaged_slice_is_refused_with_the_flag_that_leaves_it_out(ctmc, patient, tmp_path):
    file = patient / "PATIENT_DICOM" / "2.dcm"
    file.write_bytes(file.read_bytes()[:-20])
    words = ("reconstruct", patient / "PATIENT_DICOM", "--threshold", "300", "-o", tmp_path / "a.stl")
    refused = ctmc(*words)
    assert refused.code == 1
    assert refused.errors[-1].endswith("copy it again, or leave it out with --skip-damaged")
    outcome = ctmc(*words, "--skip-damaged")
    assert outcome.code == 0, outcome.errors
    note = "slice 3 of 6, by file name, is damaged and was left out; the gap was filled by linear interpolation"
    assert note in outcome.out + " ".join(outcome.errors)
