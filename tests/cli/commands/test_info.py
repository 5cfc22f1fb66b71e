# SPDX-License-Identifier: GPL-3.0-or-later
import json

import nibabel
import numpy as np
import pytest

from ctmc_addon import readers


def facts(outcome):
    assert outcome.code == 0, outcome.errors
    assert outcome.errors == []
    return outcome.out


def test_it_says_shape_spacing_orientation_and_values(ctmc, phantom_folder):
    out = facts(ctmc("info", phantom_folder / "volume-4.nii.gz"))
    for fact in ("64 x 64 x 9 (columns x rows x slices)", "5.92 x 5.92 x 5 mm", "LPS", "int16", "HU"):
        assert fact in out
    assert "segmentation-4.nii.gz beside it" in out


def test_it_counts_the_labels(ctmc, phantom_folder):
    out = facts(ctmc("info", phantom_folder / "segmentation-4.nii.gz"))
    counts = [int(line.split(": ")[1].split()[0]) for line in out.splitlines() if line.endswith(" voxels")]
    assert len(counts) == 3
    assert sum(counts) == 64 * 64 * 9


def test_it_lists_the_dicom_series_with_its_uid(ctmc, phantom_folder):
    out = facts(ctmc("info", phantom_folder / "dicom"))
    assert "9 slices of 64 x 64" in out
    assert "UID 1.2.826." in out


def test_the_operators_words_are_on_the_screen_and_not_in_json(ctmc, phantom_folder, tmp_path):
    pydicom = pytest.importorskip("pydicom")
    for file in (phantom_folder / "dicom").glob("*.dcm"):
        dataset = pydicom.dcmread(file)
        dataset.SeriesNumber, dataset.SeriesDescription, dataset.ConvolutionKernel = 7, "THORAX MUSTER", "B70f"
        dataset.save_as(tmp_path / file.name)
    assert "5 mm apart, no. 7, THORAX MUSTER, B70f" in facts(ctmc("info", tmp_path))
    said = facts(ctmc("info", tmp_path, "--json"))
    assert "MUSTER" not in said
    assert json.loads(said)["series"][0]["spacing_mm"] == 5


def test_it_says_what_was_assumed(ctmc, phantom_folder):
    out = facts(ctmc("info", phantom_folder / "png"))
    assert "1 mm is assumed" in out
    assert "1 mm is assumed" not in facts(ctmc("info", phantom_folder / "png", "--spacing", "2"))


def test_a_slice_of_a_folder_is_not_said_to_hold_its_labels(ctmc, phantom_folder):
    first = sorted((phantom_folder / "png").iterdir())[0]
    out = facts(ctmc("info", first))
    assert f"{first.name} is one slice: its folder was read" in out
    assert "labels come from" not in out


def test_flip_and_spacing_change_what_is_said(ctmc, phantom_folder):
    out = facts(ctmc("info", phantom_folder / "png", "--spacing", "0.7", "0.7", "5", "--flip", "z"))
    assert "0.7 x 0.7 x 5 mm" in out
    assert "LPI" in out


def test_json_has_the_same_facts_for_programs(ctmc, phantom_folder):
    said = json.loads(facts(ctmc("info", phantom_folder / "volume-4.nii.gz", "--json")))
    volume = readers.read_volume(phantom_folder / "volume-4.nii.gz")
    assert (said["size"], said["orientation"], said["kind"]) == ([64, 64, 9], "LPS", "HU")
    assert said["spacing_mm"] == list(volume.spacing)
    assert said["affine"] == volume.affine.tolist()
    assert (said["low"], said["high"]) == (volume.values.min(), volume.values.max())
    assert said["label_file"] == "segmentation-4.nii.gz"
    labels = json.loads(facts(ctmc("info", phantom_folder / "segmentation-4.nii.gz", "--json")))["labels"]
    assert [label["value"] for label in labels] == [0, 1, 2]
    assert sum(label["voxels"] for label in labels) == 64 * 64 * 9


def test_it_says_where_the_volume_lies(ctmc, tmp_path):
    affine = np.array([[-0.5, 0, 0, 100], [0, -0.5, 0, 0], [0, 0, 3, -40], [0, 0, 0, 1]])
    nibabel.save(nibabel.Nifti1Image(np.zeros((11, 21, 5), np.int16), affine), tmp_path / "ct.nii")
    assert "place        x 95 to 100, y -10 to 0, z -40 to -28 (RAS+ mm, centers of the outermost samples)" in facts(
        ctmc("info", tmp_path / "ct.nii")
    )
    said = json.loads(facts(ctmc("info", tmp_path / "ct.nii", "--json")))
    assert said["place_ras_mm"] == [95, -10, -40, 100, 0, -28]  # in the order of --region


def test_voxels_without_a_value_are_counted(ctmc, tmp_path):
    values = np.zeros((3, 4, 5), np.float32)
    values[1, 1, 1:3] = np.nan, np.inf
    np.save(tmp_path / "broken.npy", values)
    assert "2 are NaN or infinite: replace them with --nan-as" in facts(ctmc("info", tmp_path / "broken.npy"))
    np.save(tmp_path / "broken.npy", np.full((3, 4, 5), np.nan))
    assert "no finite value, gray values; 60 are NaN" in facts(ctmc("info", tmp_path / "broken.npy"))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda folder: folder / "missing.nii", "there is no file or folder"),
        (lambda folder: folder, "is empty"),
        (lambda folder: written(folder / "noise.nrrd", b"\x00\x01noise" * 40), "noise.nrrd"),
        (lambda folder: written(folder / "noise.dcm", b"\x07\x01noise" * 40), "noise.dcm"),
        (lambda folder: written(folder / "short.nii.gz", b"\x1f\x8b\x08\x00\x00"), "short.nii.gz"),
        (lambda folder: written(folder / "notes.docx", b"words"), "unknown suffix '.docx'"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_sentence(refused, tmp_path, make, words):
    assert words in refused("info", make(tmp_path))


def written(path, content):
    path.write_bytes(content)
    return path
