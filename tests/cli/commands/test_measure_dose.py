# SPDX-License-Identifier: GPL-3.0-or-later
"""`ctmc measure` with a dose or a PET on a grid of its own; `ctmc info` and `ctmc reconstruct` of them."""

from __future__ import annotations

import csv
import json

import nibabel
import numpy as np
import pytest
from doses import write_dose, write_grams

AFFINE = np.array([[-2.0, 0, 0, 40], [0, -2.0, 0, 30], [0, 0, 3.0, -10], [0, 0, 0, 1]])


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """Labels, a linear dose of 0.5 Gy per mm to the left from 30 Gy in the middle, and a PET with a cone of uptake."""
    folder = tmp_path_factory.mktemp("case")
    labels = np.zeros((14, 20, 24), np.uint8)
    labels[3:11, 4:16, 4:20], labels[11:13, 17:19, 21:23] = 1, 2
    nibabel.save(nibabel.Nifti1Image(labels.T, AFFINE), folder / "labels.nii")
    x = -50 + 2.5 * np.arange(41)  # LPS mm
    dose = np.broadcast_to(30000 + 500 * x, (17, 41, 41)).astype(np.uint16)
    write_dose(folder / "rd.dcm", dose, 3.5 * np.arange(17), (-50, -50, -20), PixelSpacing=[2.5, 2.5])
    z, y, x = np.meshgrid(np.arange(25), np.arange(40), np.arange(40), indexing="ij")
    distance = 2 * np.sqrt((x - 20) ** 2 + (y - 20) ** 2 + (z - 12) ** 2)
    write_grams(folder / "pet", np.clip(10 - 0.5 * distance, 0, None), 2.0, (-50, -42, -10))
    return folder, labels


def test_a_dose_is_measured_inside_labels_of_another_grid(ctmc, case, tmp_path):
    folder, labels = case
    words = ("--label", "all", "--ct", folder / "rd.dcm", "--v-dose", 20, "--v-dose", 27.5, "-o", tmp_path / "t.csv")
    done = ctmc("measure", folder / "labels.nii", *words)
    assert done.code == 0, done.errors
    for row, label in zip(rows_of(tmp_path / "t.csv"), (1, 2), strict=True):
        index = np.argwhere(labels == label)[:, 2]
        exact = 30 + 0.5 * -(AFFINE[0, 0] * index + AFFINE[0, 3])  # x to the left is -x of RAS
        assert float(row["mean_gy"]) == pytest.approx(exact.mean(), abs=1e-3)
        assert float(row["sd_gy"]) == pytest.approx(exact.std(), abs=1e-3)
        assert float(row["max_gy"]) == pytest.approx(exact.max(), abs=1e-3)
        assert float(row["d95_gy"]) == pytest.approx(np.percentile(exact, 5), abs=1e-3)
        assert float(row["v20_gy_percent"]) == pytest.approx(100 * (exact >= 20).mean())
        assert float(row["v27.5_gy_percent"]) == pytest.approx(100 * (exact >= 27.5).mean())
        assert "suv_max" not in row
        assert "mean_hu" not in row


def test_a_pet_is_measured_inside_labels_of_another_grid(ctmc, case, tmp_path):
    folder, _ = case
    done = ctmc("measure", folder / "labels.nii", "--label", 1, "--ct", folder / "pet", "-o", tmp_path / "t.csv")
    assert done.code == 0, done.errors
    [row] = rows_of(tmp_path / "t.csv")
    assert set(row) >= {"mean_suv", "sd_suv", "suv_max", "suv_peak"}
    assert float(row["suv_max"]) == pytest.approx(10, abs=0.7)
    assert float(row["suv_peak"]) == pytest.approx(10 - 0.5 * 0.75 * 6.2035, abs=0.15)
    assert "d95_gy" not in row


def test_an_isodose_is_measured_by_its_own_samples(ctmc, case, tmp_path):
    folder, _ = case
    words = ("--threshold", 30, "--v-dose", 40, "-o", tmp_path / "t.csv")
    done = ctmc("measure", folder / "rd.dcm", *words)
    assert done.code == 0, done.errors
    [row] = rows_of(tmp_path / "t.csv")
    exact = 30 + 0.5 * (-50 + 2.5 * np.arange(41))
    exact = exact[exact >= 30]
    assert float(row["threshold_gy"]) == 30
    assert float(row["mean_gy"]) == pytest.approx(exact.mean(), abs=1e-3)
    assert float(row["v40_gy_percent"]) == pytest.approx(100 * (exact >= 40).mean())


def test_v_dose_needs_a_dose_above_nothing(misused, case):
    folder, _ = case
    sentence = "--v-dose needs a dose in Gy; give an RTDOSE with --ct, or as INPUT with --threshold"
    assert sentence in misused("measure", folder / "labels.nii", "--label", "1", "--v-dose", "20")
    words = ("--label", "1", "--ct", folder / "pet", "--v-dose", "20")
    assert sentence in misused("measure", folder / "labels.nii", *words)
    words = ("--label", "1", "--ct", folder / "rd.dcm", "--v-dose", "-1")
    assert "--v-dose takes a dose above 0 Gy, not -1" in misused("measure", folder / "labels.nii", *words)


def test_voxels_beyond_the_dose_are_said(ctmc, case, tmp_path):
    folder, labels = case
    affine = AFFINE.copy()
    affine[2, 3] += 40
    nibabel.save(nibabel.Nifti1Image(labels.T, affine), tmp_path / "high.nii")
    done = ctmc("measure", tmp_path / "high.nii", "--label", "all", "--ct", folder / "rd.dcm")
    assert done.code == 0, done.errors
    assert "voxels of label 1 lie outside the grid of the values" in done.out.lower()


def test_info_describes_a_dose_and_a_pet_and_finds_them_beside_a_ct(ctmc, case):
    folder, _ = case
    dose = json.loads(ctmc("info", folder / "rd.dcm", "--json").out)
    assert (dose["kind"], dose["high"], dose["dtype"]) == ("Gy", pytest.approx(55.0), "float32")
    pet = json.loads(ctmc("info", folder / "pet", "--json").out)
    assert (pet["kind"], pet["volumes_found"]) == ("SUVbw", [])
    ct = ctmc("info", folder / "labels.nii", "--json").out
    assert json.loads(ct)["volumes_found"] == []  # labels are no CT
    for text in (str(folder), "Muster", "4711"):
        assert text not in json.dumps(dose) + json.dumps(pet) + ct


def test_info_of_a_ct_lists_both_by_paths_from_its_own(ctmc, case, tmp_path):
    folder, _ = case
    values = np.random.default_rng(0).integers(-1000, 400, (8, 9, 10)).astype(np.int16)
    nibabel.save(nibabel.Nifti1Image(values.T, AFFINE), folder / "ct.nii")
    done = ctmc("info", folder / "ct.nii")
    (folder / "ct.nii").unlink()
    assert "dose, PET found" in done.out
    assert "rd.dcm" in done.out
    assert str(folder) not in done.out


def test_an_isodose_is_reconstructed(ctmc, case, tmp_path):
    folder, _ = case
    done = ctmc(
        "reconstruct", folder / "rd.dcm", "--threshold", 20, "-o", tmp_path / "iso.stl", "--report", tmp_path / "r.json"
    )
    assert done.code == 0, done.errors
    assert (tmp_path / "iso.stl").exists()
