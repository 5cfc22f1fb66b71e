# SPDX-License-Identifier: GPL-3.0-or-later
"""`ctmc measure`: the numbers of `ctmc reconstruct` in a table."""

from __future__ import annotations

import csv
import json

import nibabel
import numpy as np
import pytest

from ctmc_addon.cli.commands import measure

AFFINE = np.diag([-2.0, -2.0, 3.0, 1.0])


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A CT with two labels on its grid, named as LiTS names them, and labels on another grid."""
    folder = tmp_path_factory.mktemp("case")
    values = np.random.default_rng(5).integers(-1000, 400, (12, 20, 24)).astype(np.int16)
    labels = np.zeros(values.shape, np.uint8)
    labels[3:9, 4:14, 4:16], labels[8:11, 14:18, 17:22] = 1, 2
    half = AFFINE.copy()
    half[2, 3] += AFFINE[2, 2] / 2
    for name, array, affine in (
        ("volume-3", values, AFFINE),
        ("segmentation-3", labels, AFFINE),
        ("moved", labels, half),
    ):
        nibabel.save(nibabel.Nifti1Image(array.T, affine), folder / f"{name}.nii")
    return folder, values, labels


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_all_labels_have_the_numbers_of_the_report(ctmc, case, tmp_path):
    folder, values, labels = case
    path = tmp_path / "table.csv"
    done = ctmc("measure", folder / "segmentation-3.nii", "--ct", folder / "volume-3.nii", "--label", "all", "-o", path)
    assert (done.code, done.errors) == (0, [])
    report = tmp_path / "report.json"
    words = ("--label", "all", "-o", f"{tmp_path}/surfaces/", "--report", report)
    assert ctmc("reconstruct", folder / "segmentation-3.nii", *words).code == 0
    rows, surfaces = rows_of(path), json.loads(report.read_text("utf-8"))["surfaces"]
    assert len(rows) == len(surfaces) == 2
    for row, surface in zip(rows, surfaces, strict=True):
        assert int(row["label"]) == surface["label"]
        assert float(row["volume_ml"]) == pytest.approx(surface["volume_mm3"] / 1000, rel=1e-8)
        assert float(row["area_cm2"]) == pytest.approx(surface["area_mm2"] / 100, rel=1e-8)
        assert int(row["components"]) == surface["components"]
        assert float(row["mean_hu"]) == pytest.approx(values[labels == surface["label"]].mean(), rel=1e-8)
    beside = tmp_path / "beside.csv"  # the labels lie beside the CT
    assert ctmc("measure", folder / "volume-3.nii", "--label", "all", "-o", beside).code == 0
    assert beside.read_bytes() == path.read_bytes()


def test_labels_whose_rows_run_the_other_way_are_measured_in_their_ct(ctmc, case, tmp_path):
    """A DICOM series and the NIfTI that was made of it differ so."""
    folder, values, labels = case
    other = AFFINE @ np.array([[1, 0, 0, 0], [0, -1, 0, 19], [0, 0, 1, 0], [0, 0, 0, 1]])
    nibabel.save(nibabel.Nifti1Image(labels[:, ::-1].T, other), tmp_path / "labels.nii")
    words = ("--ct", folder / "volume-3.nii", "--label", "all", "-o", tmp_path / "t.csv")
    done = ctmc("measure", tmp_path / "labels.nii", *words)
    assert (done.code, done.errors) == (0, [])
    means = [float(row["mean_hu"]) for row in rows_of(tmp_path / "t.csv")]
    assert means == pytest.approx([values[labels == label].mean() for label in (1, 2)], rel=1e-8)


def test_a_ct_on_another_grid_is_refused_before_surfaces_are_made(refused, case, monkeypatch):
    folder, _, _ = case
    monkeypatch.setattr(measure, "surfaces_steps", lambda *_: pytest.fail("surfaces were made"))
    sentence = refused("measure", folder / "moved.nii", "--ct", folder / "volume-3.nii", "--label", "all")
    assert "away from those of the CT" in sentence


def test_a_threshold_is_measured_in_its_own_volume(ctmc, case, tmp_path):
    folder, values, _ = case
    done = ctmc("measure", folder / "volume-3.nii", "--threshold", 300, "-o", tmp_path / "t.csv")
    assert done.code == 0
    row = rows_of(tmp_path / "t.csv")[0]
    assert (row["name"], row["label"], row["threshold_hu"], row["volume_ml"]) == ("volume-3", "", "300", "")
    assert float(row["mean_hu"]) == pytest.approx(values[values >= 300].mean(), rel=1e-8)
    assert "1, open: --close-border" in done.out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            ["moved.nii", "--ct", "volume-3.nii", "--label", "all"],
            "moved has samples up to 1.5 mm away from those of the CT; resample it",
        ),
        (["moved.nii", "--ct", "segmentation-3.nii", "--label", "1"], "holds labels; give the CT with --ct"),
        (["moved.nii", "--label", "7"], "the labels are 1, 2"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_no_file(refused, case, tmp_path, words, sentence):
    folder, _, _ = case
    paths = [folder / word if word.endswith(".nii") else word for word in words]
    assert sentence in refused("measure", *paths, "-o", tmp_path / "t.csv")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--simplify", 0.5, "--simplifier", "decimate"], "leave out --simplifier decimate"),
        (["--ct", "none.nii", "--threshold", 2], "--ct needs labels"),
    ],
)
def test_flags_that_cannot_be_are_refused_before_anything_is_read(misused, tmp_path, words, sentence):
    assert sentence in misused("measure", tmp_path / "none.nii", *words)
