# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels that a file stores with a scale or as floats: every command makes the same of them as of integers."""

import csv
import json

import nibabel
import numpy as np
import pytest

from ctmc_addon.readers import read_volume

NOTE = "Values that are not whole were read as the nearest label"


def organs():
    values = np.zeros((12, 12, 12), np.uint8)
    values[1:5, 1:5, 1:5], values[6:11, 1:5, 1:5], values[1:5, 6:11, 6:11] = 1, 6, 117
    return values


def save(path, values, dtype=None, intent=0):
    image = nibabel.Nifti1Image(values, np.eye(4))
    if dtype is not None:
        image.set_data_dtype(dtype)  # nibabel finds the scale
    image.header["intent_code"] = intent
    nibabel.save(image, path)
    return path


@pytest.fixture(params=["scaled_int16", "scaled_uint8", "nearly_whole", "float_labels"])
def files(request, tmp_path):
    """Labels as they are stored, the same as integers, and whether the values are not exactly whole."""
    labels = organs().astype(np.float64)
    nearly = np.where(labels == 6, 5.9999995, labels).astype(np.float32)
    values, dtype, intent = {
        "scaled_int16": (labels, np.int16, 0),
        "scaled_uint8": (labels, np.uint8, 0),
        "nearly_whole": (nearly, None, 0),
        "float_labels": (labels.astype(np.float32), None, 1002),
    }[request.param]
    stored = save(tmp_path / "organs.nii", values, dtype, intent)
    return stored, save(tmp_path / "integers.nii", organs()), request.param != "float_labels"


def rows_of(path):
    return list(csv.DictReader(path.read_text().splitlines()))


def test_all_labels_are_measured_and_a_note_says_what_was_rounded(ctmc, files, tmp_path):
    tables = []
    for path, notes in ((files[0], files[2]), (files[1], False)):
        done = ctmc("measure", path, "--label", "all", "--close-border", "-o", tmp_path / "table.csv")
        assert done.code == 0, done.errors
        assert (NOTE in done.out) == notes
        tables.append(rows_of(tmp_path / "table.csv"))
    assert [row["label"] for row in tables[0]] == ["1", "6", "117"]
    assert tables[0] == tables[1]


@pytest.mark.parametrize("words", [("--label", "6"), ("--label", "6", "--smoothing", "gaussian"), ()])
def test_a_surface_has_the_bytes_of_integers(ctmc, files, tmp_path, words):
    surfaces = []
    for path, notes in ((files[0], files[2]), (files[1], False)):
        done = ctmc("reconstruct", path, *words, "-o", tmp_path / "o.stl", "--report", tmp_path / "o.json")
        assert done.code == 0, done.errors
        report = json.loads((tmp_path / "o.json").read_text())
        assert sum(NOTE in note for note in report["notes"]) == notes
        surfaces.append((report["threshold"], (tmp_path / "o.stl").read_bytes()[80:]))
    assert surfaces[0] == surfaces[1]


def test_a_batch_makes_every_label(ctmc, files, tmp_path):
    done = ctmc("batch", files[0], "-o", tmp_path / "out", "--label", "all", "--no-thumbnails", "--jobs", "1")
    assert done.code == 0, done.errors
    record = json.loads((tmp_path / "out" / "organs.json").read_text())
    assert [surface["name"] for surface in record["surfaces"]] == ["label 1", "label 6", "label 117"]
    assert any(NOTE in note for note in record["notes"]) == files[2]


def test_segment_goes_on_from_them(ctmc, files, tmp_path):
    ct = save(tmp_path / "ct.nii", (np.indices((12, 12, 12)).sum(axis=0) * 40 - 500).astype(np.int16))
    out = tmp_path / "out.seg.nrrd"
    done = ctmc("segment", ct, "--from", files[0], "-o", out, "--margin", "label 1", 0)
    assert done.code == 0, done.errors
    assert (NOTE in done.out) == files[2]
    np.testing.assert_array_equal(read_volume(out).values, read_volume(files[1]).values)


def test_info_lists_them(ctmc, files):
    done = ctmc("info", files[0], "--json")
    facts = json.loads(done.out)
    assert (facts["kind"], facts["low"], facts["high"]) == ("label", 0, 117)
    assert [label["value"] for label in facts["labels"]] == [0, 1, 6, 117]
    assert [label["voxels"] for label in facts["labels"][1:]] == [64, 80, 100]
    assert any(NOTE in note for note in facts["notes"]) == files[2]


def test_values_that_are_no_labels_are_refused_with_the_first_of_them(refused, tmp_path):
    values = organs().astype(np.float32)
    values[0, 0, 3], values[5, 5, 7] = 0.75, 0.25  # the first in the file has the lowest z
    path = save(tmp_path / "organs.nii", values)
    ct = save(tmp_path / "ct.nii", (np.indices((12, 12, 12)).sum(axis=0) * 40 - 500).astype(np.int16))
    sentence = (
        "ctmc: organs cannot be read as labels: its value 0.75 is not within 0.00075 of a whole number; "
        "give a threshold, or save its labels as integers without a scale"
    )
    for label in ("all", "6", "1,6"):
        assert refused("reconstruct", path, "--label", label, "-o", f"{tmp_path}/out/") == sentence
        assert refused("measure", path, "--label", label) == sentence
    told = refused("segment", ct, "--from", path, "-o", tmp_path / "o.nii", "--margin", "label 1", 0)
    assert told == "ctmc: organs holds gray values, such as 0.75, not labels; give a label volume to --from"
    assert refused("segment", ct, "--from", ct, "-o", tmp_path / "o.nii", "--margin", "label 1", 0) == (
        "ctmc: ct holds HU, not labels; give a label volume to --from"
    )
