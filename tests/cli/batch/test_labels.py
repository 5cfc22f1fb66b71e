# SPDX-License-Identifier: GPL-3.0-or-later
"""Batches of labels, and of CTs with labels beside them."""

import csv
import json
import shutil

import nibabel
import numpy as np
import pytest
from batches import page_content, summary


def test_each_label_of_lits_is_said_to_be_from_the_segmentation(ctmc, phantom_folder, tmp_path):
    words = ("--label", 1, 2, "--no-thumbnails", "--jobs", 1)
    done = ctmc("batch", phantom_folder / "volume-4.nii.gz", "-o", tmp_path / "out", *words)
    assert done.code == 0, done.errors
    for label in (1, 2):
        report = json.loads((tmp_path / "out" / f"volume-4-label-{label}.json").read_text("utf-8"))
        assert report["settings"]["label"] == label
        note = "volume-4.nii.gz holds gray values; labels come from segmentation-4.nii.gz beside it"
        assert [said for said in report["notes"] if "labels come from" in said] == [note]


@pytest.mark.usefixtures("scene")
def test_several_labels_come_from_one_reading_and_one_that_a_case_lacks_is_absent(ctmc, phantom_folder, tmp_path):
    words = ["-o", tmp_path, "--label", "1", "2", "9", "--close-border", "--output-format", "ply", "--no-thumbnails"]
    (tmp_path / "volume-4-label-9.ply").write_text("of an older run")
    (tmp_path / "volume-4-label-9.json").write_text('{"files": ["volume-4-label-9.ply"]}')
    outcome = ctmc("batch", phantom_folder, *words, "--overwrite")
    assert outcome.code == 0
    assert "absent  volume-4-label-9  label 9 is empty here; the labels are 1, 2" in outcome.out
    assert "3 outputs of 1 case: 2 done, 1 absent; see summary.html" in outcome.out
    assert "3 outputs of 1 case: 2 done, 1 absent" in (tmp_path / "summary.html").read_text("utf-8")
    again = ctmc("batch", phantom_folder, *words, "--resume")
    assert (again.code, again.out.splitlines()[0]) == (0, "cases  1, 1 done before")  # what is absent is not looked for
    again = ctmc("batch", phantom_folder, *words, "--resume", "--strict")
    assert (again.code, again.out.splitlines()[0]) == (1, "cases  1, 1 done before")
    assert again.errors == ["ctmc: 1 of 3 outputs lacks the label, which --strict refuses: volume-4-label-9"]
    liver, tumour, none = summary(tmp_path)
    assert (none["status"], none["faces"]) == ("absent", None)
    assert [row["case"] for row in (liver, tumour, none)] == [f"volume-4-label-{label}" for label in (1, 2, 9)]
    assert liver["volume_mm3"] > tumour["volume_mm3"] > 0
    assert sorted(path.name for path in tmp_path.glob("*.ply")) == ["volume-4-label-1.ply", "volume-4-label-2.ply"]


REMEDY = "without --label or --threshold, Otsu's threshold makes one surface; use --label 1 2 or --label all for labels"


def spoken(done):
    """Return the lines of a command with one space between words."""
    return [" ".join(line.split()) for line in done.out.splitlines()]


def test_labels_beside_a_ct_that_are_not_asked_for_are_said_before_and_after_the_work(ctmc, phantom_folder, tmp_path):
    words = ("batch", phantom_folder, "--no-thumbnails", "--jobs", 1)
    done = ctmc(*words, "-o", tmp_path / "otsu")
    said = f"labels found beside 1 of 1 case, such as segmentation-4.nii.gz, but not used: {REMEDY}"
    assert [words for words in spoken(done) if words.startswith("labels")] == [said] * 2
    assert "labels" not in ctmc(*words, "-o", tmp_path / "bone", "--threshold", 200).out


@pytest.mark.once
def test_label_files_alone_whose_labels_become_one_surface_are_said(ctmc, phantom_folder, tmp_path):
    for number in (1, 2):
        shutil.copy(phantom_folder / "segmentation-4.nii.gz", tmp_path / f"segmentation-{number}.nii.gz")
    words = ("batch", tmp_path, "--no-thumbnails", "--jobs", 1)
    done = ctmc(*words, "-o", tmp_path / "otsu")
    assert done.code == 0
    assert f"labels in 2 of 2 cases became one surface, such as that of segmentation-1: {REMEDY}" in spoken(done)
    assert done.out.count("  all labels as one\n") == 2
    for name, asked in (("threshold", ("--threshold", 0.5)), ("label", ("--label", 1)), ("all", ("--label", "all"))):
        assert "all labels as one" not in ctmc(*words, "-o", tmp_path / name, *asked).out


def test_the_hu_of_several_labels_in_a_row_stand_in_the_table_of_labels(ctmc, tmp_path):
    labels = np.zeros((12, 12, 12), np.uint8)
    labels[2:6, 2:10, 2:10], labels[6:10, 2:10, 2:10] = 1, 7
    hu = np.where(labels == 1, 40, -100).astype(np.int16)
    hu[labels == 7] = np.where(np.indices(labels.shape)[2] % 2, 110, 90)[labels == 7]
    for number, some in ((3, labels), (5, np.where(labels == 7, 7, 0).astype(np.uint8))):
        for name, values in (("volume", hu), ("segmentation", some)):
            nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), tmp_path / f"{name}-{number}.nii")
    out = tmp_path / "out"
    assert ctmc("batch", tmp_path, "-o", out, "--label", "all", "--hu", "--no-thumbnails", "--jobs", 1).code == 0
    with (out / "labels.csv").open(encoding="utf-8", newline="") as stream:
        rows = [[row[key] for key in ("case", "label", "mean_hu", "sd_hu")] for row in csv.DictReader(stream)]
    assert rows[:2] == [["volume-3", "1", "40.0", "0.0"], ["volume-3", "7", "100.0", "10.0"]]
    assert [(row["mean_hu"], row["sd_hu"]) for row in summary(out)] == [(None, None), (100.0, 10.0)]
    assert not any("mean_hu" in row["notes"] for row in summary(out))
    [one, _] = page_content((out / "summary.html").read_text("utf-8"))["rows"]
    assert "40" in one["surfaces"][0]["texts"]
