# SPDX-License-Identifier: GPL-3.0-or-later
import hashlib
import json

import numpy as np
import pytest

from ctmc_addon import readers
from ctmc_addon.cli import main
from ctmc_addon.core.phantom.phantom import phantom


@pytest.fixture(scope="module")
def made():
    return phantom(slices=9, size=64, seed=4)


def test_it_writes_every_format_and_the_truth(phantom_folder, truth, made):
    assert sorted(path.name for path in phantom_folder.iterdir()) == [
        "dicom", "png", "segmentation-4.nii.gz", "truth.json", "volume-4.nii.gz",
    ]  # fmt: skip
    assert truth["tumour_volumes_mm3"] == list(made.tumour_volumes_mm3)
    assert truth["tumour_volume_mm3"] == pytest.approx(sum(made.tumour_volumes_mm3), abs=2e-3)
    assert truth["spacing_mm"] == pytest.approx(made.volume.spacing)


@pytest.mark.parametrize("name", ["dicom", "volume-4.nii.gz"])
def test_values_and_positions_come_back_from_the_files(phantom_folder, made, name):
    volume = readers.read_volume(phantom_folder / name)
    codes = volume.orientation
    # A reader may list the slices from either end.
    values = volume.values if codes == "LPS" else volume.values[::-1]
    assert codes in ("LPS", "LPI")
    assert (values == made.volume.values).all()
    assert volume.spacing == pytest.approx(made.volume.spacing, rel=1e-6)
    first = volume.affine @ [0, 0, 0 if codes == "LPS" else 8, 1]
    assert first[:3] == pytest.approx(made.volume.affine[:3, 3], abs=2e-3)
    assert volume.kind == "HU"


def test_labels_come_back_from_the_segmentation(phantom_folder, made):
    volume = readers.read_volume(phantom_folder / "segmentation-4.nii.gz")
    assert volume.kind == "label"
    assert (volume.values == made.labels.values).all()
    np.testing.assert_allclose(volume.affine, made.volume.affine, atol=1e-4)


def test_png_slices_are_the_window_from_feet_to_head(phantom_folder, made):
    volume = readers.read_volume(phantom_folder / "png", spacing=made.volume.spacing)
    gray = (np.clip(made.volume.values, -160, 240).astype(int) + 160) * 255 // 400
    assert (volume.values == gray).all()
    assert volume.orientation == "LPS"


def test_the_dicom_is_a_valid_ct_image_and_names_nobody(phantom_folder):
    pydicom = pytest.importorskip("pydicom", reason="pydicom is not installed")
    paths = sorted((phantom_folder / "dicom").iterdir())
    datasets = [pydicom.dcmread(path) for path in paths]
    assert len({dataset.SOPInstanceUID for dataset in datasets}) == 9
    assert len({dataset.SeriesInstanceUID for dataset in datasets}) == 1
    for dataset in datasets:
        assert dataset.SOPClassUID.name == "CT Image Storage"
        assert dataset.file_meta.MediaStorageSOPInstanceUID == dataset.SOPInstanceUID
        assert dataset.file_meta.TransferSyntaxUID.name == "Explicit VR Little Endian"
        assert str(dataset.PatientName) == "Phantom^CTMC"
        assert not dataset.StudyDate
        assert not dataset.PatientBirthDate


def test_the_same_seed_gives_the_same_files(tmp_path):
    def digests(folder):
        assert main(["phantom", str(folder), "--slices", "3", "--size", "32"]) == 0
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        return [(path.relative_to(folder), hashlib.sha256(path.read_bytes()).hexdigest()) for path in files]

    first = digests(tmp_path / "one")
    assert digests(tmp_path / "two" / "with parents") == first
    assert digests(tmp_path / "one") == first  # written over itself
    assert len(first) == 3 + 3 + 2 + 1


def test_one_format_alone_leaves_the_others_out(tmp_path, ctmc):
    outcome = ctmc("phantom", tmp_path, "--format", "png", "--slices", "3", "--size", "16")
    assert outcome.code == 0
    assert "png/, truth.json" in outcome.out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["png", "truth.json"]
    assert json.loads((tmp_path / "truth.json").read_text())["slices"] == 3


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--slices", "2"], "--slices: must be 3 or more, not 2"),
        (["--size", "4"], "--size: must be 16 or more, not 4"),
        (["--seed", "-1"], "--seed: must be 0 or more, not -1"),
        (["--spacing", "1", "0", "1"], "from 1e-06 to 10000 mm"),
    ],
)
def test_an_impossible_phantom_is_refused_and_leaves_no_file(tmp_path, misused, flags, words):
    assert words in misused("phantom", tmp_path, *flags)
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_slices_of_something_else_are_not_mixed_in(tmp_path, refused):
    (tmp_path / "png").mkdir()
    (tmp_path / "png" / "slice_10.png").write_bytes(b"")
    assert "holds slice_10.png" in refused("phantom", tmp_path, "--slices", "9", "--size", "16")


def test_a_file_where_the_folder_should_be_is_refused(tmp_path, refused):
    (tmp_path / "taken").write_text("")
    assert "the folder is a file" in refused("phantom", tmp_path / "taken")
    assert "the folder is a file" in refused("phantom", tmp_path / "taken" / "below")


def test_an_unknown_format_is_a_usage_error(tmp_path, ctmc):
    assert ctmc("phantom", tmp_path, "--format", "bmp").code == 2
