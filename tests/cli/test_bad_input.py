# SPDX-License-Identifier: GPL-3.0-or-later
"""The drawer of broken files: each gets exit code 1 and one sentence, and leaves nothing behind."""

import gzip
import shutil

import numpy as np
import pytest

from ctmc_addon.core.machine import memory

pytestmark = pytest.mark.usefixtures("scene")


def save_png(path, values):
    image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    image.fromarray(values).save(path)


def save_nifti(path, values):
    nibabel = pytest.importorskip("nibabel", reason="nibabel is not installed")
    nibabel.Nifti1Image(values, np.eye(4)).to_filename(path)


def change_dicom(path, change):
    pydicom = pytest.importorskip("pydicom", reason="pydicom is not installed")
    dataset = pydicom.dcmread(path)
    change(dataset)
    dataset.save_as(path)


def one_png(folder, phantom):
    shutil.copy(phantom / "png" / "slice_1.png", folder)
    return folder


def one_dicom(folder, phantom):
    shutil.copy(phantom / "dicom" / "slice_0001.dcm", folder)
    return folder


def one_nifti_slice(folder, phantom):
    save_nifti(folder / "one.nii", np.zeros((8, 8, 1), np.int16))
    return folder / "one.nii"


def two_sizes(folder, phantom):
    for number, side in enumerate((8, 8, 9)):
        save_png(folder / f"slice_{number}.png", np.zeros((side, 8), np.uint8))
    return folder


def colors(folder, phantom):
    for number in range(3):
        values = np.zeros((8, 8, 3), np.uint8)
        values[2:4, 2:4, 0] = 200
        save_png(folder / f"slice_{number}.png", values)
    return folder


def cut_png(folder, phantom):
    shutil.copytree(phantom / "png", folder / "png")
    path = folder / "png" / "slice_3.png"
    path.write_bytes(path.read_bytes()[:300])
    return folder / "png"


def cut_dicom(folder, phantom):
    shutil.copytree(phantom / "dicom", folder / "dicom")
    path = folder / "dicom" / "slice_0003.dcm"
    path.write_bytes(path.read_bytes()[:-3000])
    return folder / "dicom"


def cut_gzip(folder, phantom):
    content = (phantom / "volume-4.nii.gz").read_bytes()
    (folder / "cut.nii.gz").write_bytes(content[: len(content) // 2])
    return folder / "cut.nii.gz"


def cut_inside_gzip(folder, phantom):
    content = gzip.decompress((phantom / "volume-4.nii.gz").read_bytes())
    (folder / "cut.nii.gz").write_bytes(gzip.compress(content[: len(content) // 2]))
    return folder / "cut.nii.gz"


def noise_dicom(folder, phantom):
    (folder / "noise.dcm").write_bytes(np.random.default_rng(0).bytes(5000))
    return folder / "noise.dcm"


def noise_nrrd(folder, phantom):
    (folder / "noise.nrrd").write_bytes(np.random.default_rng(0).bytes(5000))
    return folder / "noise.nrrd"


def five_dimensions(folder, phantom):
    save_nifti(folder / "film.nii", np.zeros((5, 5, 5, 3, 2), np.int16))
    return folder / "film.nii"


def color_voxels(folder, phantom):
    save_nifti(folder / "color.nii", np.zeros((5, 5, 5), [("R", "u1"), ("G", "u1"), ("B", "u1")]))
    return folder / "color.nii"


def flat_affine(folder, phantom):
    save_nifti(folder / "flat.nii", np.zeros((5, 5, 5), np.int16))
    content = bytearray((folder / "flat.nii").read_bytes())
    content[254:256] = b"\x01\x00"  # sform_code: the affine is in the file
    content[312:328] = bytes(16)  # srow_z
    (folder / "flat.nii").write_bytes(content)
    return folder / "flat.nii"


def no_images(folder, phantom):
    def without_pixels(dataset):
        dataset.SOPClassUID = dataset.file_meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.481.5"
        dataset.Modality = "RTPLAN"
        del dataset.PixelData, dataset.Rows, dataset.Columns

    for number in (1, 2, 3):
        shutil.copy(phantom / "dicom" / f"slice_000{number}.dcm", folder)
        change_dicom(folder / f"slice_000{number}.dcm", without_pixels)
    return folder


def words_only(folder, phantom):
    (folder / "letter.txt").write_text("no CT here")
    return folder


DRAWER = [
    (one_png, ["one slice", "at least 2"]),
    (one_dicom, ["one slice", "at least 2"]),
    (one_nifti_slice, ["one slice", "at least 2"]),
    (two_sizes, ["8 x 8", "8 x 9"]),
    (colors, ["slice_0.png", "200"]),
    (cut_png, ["slice_3.png"]),
    (cut_dicom, ["slice_0003.dcm"]),
    (cut_gzip, ["cut.nii.gz"]),
    (cut_inside_gzip, ["cut.nii.gz"]),
    (noise_dicom, ["noise.dcm"]),
    (noise_nrrd, ["noise.nrrd"]),
    (five_dimensions, ["film.nii", "5 dimensions"]),
    (color_voxels, ["RGB"]),
    (flat_affine, ["a spacing of 1 x 1 x 0 mm"]),
    (no_images, ["image"]),
    (words_only, ["none is a DICOM image or a slice"]),
]


@pytest.mark.parametrize(("make", "words"), DRAWER, ids=lambda value: getattr(value, "__name__", ""))
def test_a_broken_input_gets_one_sentence_and_leaves_no_file(refused, phantom_folder, tmp_path, make, words):
    place, out = tmp_path / "in", tmp_path / "out"
    place.mkdir()
    out.mkdir()
    path = make(place, phantom_folder)
    sentence = refused("reconstruct", path, "-o", out / "x.stl", "--report", out / "x.json", "--threshold", "0.5")
    for word in words:
        assert word in sentence
    assert list(out.iterdir()) == []


def test_magnetic_resonance_is_read_and_said(ctmc, phantom_folder, tmp_path):
    shutil.copytree(phantom_folder / "dicom", tmp_path / "mr")
    for path in (tmp_path / "mr").iterdir():
        change_dicom(path, lambda dataset: setattr(dataset, "Modality", "MR"))
    outcome = ctmc("reconstruct", tmp_path / "mr", "-o", tmp_path / "x.stl", "--threshold", "0")
    assert outcome.code == 0, outcome.errors
    assert "MR" in outcome.out


def test_a_volume_that_would_not_fit_is_said_before_it_is_read(refused, phantom_folder, tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "available_bytes", lambda: 50_000)
    sentence = refused("reconstruct", phantom_folder / "volume-4.nii.gz", "-o", tmp_path / "x.stl")
    assert "MiB of memory" in sentence
    assert "reading" in sentence


def test_a_volume_gone_missing_is_said(refused, tmp_path):
    assert "check the path" in refused("reconstruct", tmp_path / "gone.nii.gz", "-o", tmp_path / "x.stl")
