# SPDX-License-Identifier: GPL-3.0-or-later
"""`ctmc segment`: points to labels in a file that other programs read."""

from __future__ import annotations

import sys
from types import ModuleType

import nibabel
import nrrd
import numpy as np
import pytest

from ctmc_addon import readers

AFFINE = np.array([[-2.0, 0.0, 0.0, 40.0], [0.0, -2.0, 0.0, 30.0], [0.0, 0.0, 3.0, -12.0], [0.0, 0.0, 0.0, 1.0]])
SHAPE = (12, 30, 40)  # x from 40 to -38 mm, y from 30 to -28, z from -12 to 21


@pytest.fixture(scope="module")
def ct(tmp_path_factory):
    """Two balls of 100 HU and one of 500 HU in water."""
    folder = tmp_path_factory.mktemp("ct")
    nibabel.save(nibabel.Nifti1Image(values().T, AFFINE), folder / "ct.nii")
    return folder / "ct.nii"


def ball(x_mm, y_mm, z_mm, radius_mm):
    z, y, x = np.indices(SHAPE)
    points = np.stack([x, y, z], axis=-1) @ AFFINE[:3, :3].T + AFFINE[:3, 3]
    return ((points - (x_mm, y_mm, z_mm)) ** 2).sum(axis=-1) <= radius_mm**2


def values():
    noise = np.random.default_rng(2).normal(0, 5, SHAPE)
    hu = np.where(ball(20, 0, 3, 12) | ball(-18, 4, 6, 11), 100, np.where(ball(0, -14, 3, 8), 500, 0)) + noise
    return hu.round().astype(np.int16)


def dice(first, second):
    return 2 * (first & second).sum() / (first.sum() + second.sum())


def masks_of(path):
    volume = readers.read_volume(path)
    assert np.allclose(volume.affine, AFFINE, atol=1e-4)
    return {
        name: np.any([layer.values == label for layer in volume.each_layer], axis=0)
        for label, name in volume.label_names.items()
    }


def test_points_become_structures_with_names_and_colors(ctmc, ct, tmp_path):
    out = tmp_path / "labels.seg.nrrd"
    done = ctmc("segment", ct, "-o", out, "--seed", "left kidney", -18, 4, 6, "--seed", "liver", 20, 0, 3)
    assert (done.code, done.errors) == (0, [])
    masks = masks_of(out)
    assert list(masks) == ["left kidney", "liver"]
    assert dice(masks["left kidney"], ball(-18, 4, 6, 11)) > 0.9
    assert dice(masks["liver"], ball(20, 0, 3, 12)) > 0.9
    lines = done.out.splitlines()
    assert lines[0].split() == ["left", "kidney", f"{masks['left kidney'].sum() * 0.012:.4g}", "ml,",
                                str(masks["left kidney"].sum()), "voxels"]  # fmt: skip
    assert lines[2].split() == ["file", "labels.seg.nrrd"]
    _, header = nrrd.read(str(out))
    assert [float(share) for share in header["Segment1_Color"].split()] == pytest.approx(
        [0.478, 0.110, 0.157], abs=1e-3
    )
    assert header["space"] == "left-posterior-superior"
    assert header["space directions"].tolist() == [[2, 0, 0], [0, 2, 0], [0, 0, 3]]
    assert header["space origin"].tolist() == [-40, -30, -12]


def test_the_same_points_give_the_same_bytes(ctmc, ct, tmp_path):
    for name in ("a.seg.nrrd", "b.seg.nrrd", "a.nii.gz", "b.nii.gz"):
        assert ctmc("segment", ct, "-o", tmp_path / name, "--seed", "liver", 20, 0, 3).code == 0
    for suffix in (".seg.nrrd", ".nii.gz"):
        assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


@pytest.mark.parametrize("name", ["labels.nii", "labels.nii.gz"])
def test_nifti_lies_where_the_ct_does(ctmc, ct, tmp_path, name):
    done = ctmc("segment", ct, "-o", tmp_path / name, "--seed", "liver", 20, 0, 3, "--seed", "spine", 0, -14, 3)
    assert done.code == 0
    image = nibabel.load(tmp_path / name)
    labels = np.asarray(image.dataobj).T
    assert np.allclose(image.affine, AFFINE)
    assert image.header.get_zooms() == (2.0, 2.0, 3.0)
    assert dice(labels == 1, ball(20, 0, 3, 12)) > 0.9
    assert dice(labels == 2, ball(0, -14, 3, 8)) > 0.8


def test_what_hangs_together_in_a_range_in_a_region(ctmc, ct, tmp_path):
    out = tmp_path / "l.nrrd"
    words = ("--method", "connected", "--range", 60, 2000, "--seed", "body", 20, 0, 3)
    assert ctmc("segment", ct, "-o", out, *words).code == 0
    whole = masks_of(out)["body"]
    assert dice(whole, ball(20, 0, 3, 12)) > 0.97
    region = ("--region", 16, -40, -40, 60, 40, 40, "--region-unit", "mm")
    assert ctmc("segment", ct, "-o", out, *words, *region).code == 0
    part = masks_of(out)["body"]
    assert (part == whole & (np.arange(40) <= 12)).all()
    assert ctmc("segment", ct, "-o", out, *words, "--max-mm", 6).code == 0
    assert (masks_of(out)["body"] <= ball(20, 0, 3, 6.01)).all()


def test_labels_are_gone_on_from_and_overlaps_are_kept(ctmc, ct, tmp_path):
    first, second = tmp_path / "first.seg.nrrd", tmp_path / "second.seg.nrrd"
    assert ctmc("segment", ct, "-o", first, "--seed", "liver", 20, 0, 3, "--seed", "spine", 0, -14, 3).code == 0
    words = ("--from", first, "--seed", "liver", -18, 4, 6, "--margin", "spine", 8, "--margin", "liver", -2)
    assert ctmc("segment", ct, "-o", second, *words).code == 0
    before, after = masks_of(first), masks_of(second)
    assert before["spine"].sum() * 2 < after["spine"].sum()
    assert (before["spine"] <= after["spine"]).all()
    assert after["liver"].sum() < before["liver"].sum() * 2
    assert (after["liver"] & ball(-18, 4, 6, 8)).any()
    assert (after["liver"] & after["spine"]).any()


def test_a_background_point_takes_voxels_away(ctmc, ct, tmp_path):
    out = tmp_path / "l.seg.nrrd"
    assert ctmc("segment", ct, "-o", out, "--seed", "liver", 20, 0, 3, "--background", 28, 0, 3).code == 0
    assert masks_of(out)["liver"].sum() < 0.8 * ball(20, 0, 3, 12).sum()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("-o", "l.seg.nrrd", "--seed", "liver", 99, 0, 3), "the point 99 0 3 lies outside of the volume"),
        (
            ("-o", "l.stl", "--seed", "liver", 20, 0, 3),
            "l.stl needs one of the suffixes .seg.nrrd, .nrrd, .nii, .nii.gz, .dcm; they",
        ),
        (("-o", "l.csv.gz", "--seed", "liver", 20, 0, 3), "needs one of the suffixes .seg.nrrd"),
        (("-o", "l.nrrd", "--seed", "liver", 20, 0, 3, "--margin", "spleen", 2), "there is no structure 'spleen'"),
        (("-o", "l.nrrd", "--seed", "liver", 20, 0, 3, "--margin", "liver", -90), "nothing is left of liver"),
        (("-o", "l.nrrd", "--seed", "liver", 20, 0, 3, "--max-mm", 0), "numbers above 0"),
        (("-o", "l.nrrd", "--seed", "liver", 20, 0, 3, "--hu-per-mm", -1), "numbers above 0, not -1"),
        (
            ("-o", "l.nii", "--seed", "a", 20, 0, 3, "--seed", "b", 0, -14, 3, "--margin", "b", 30),
            "structures overlap, and l.nii has one label a voxel",
        ),
    ],
)
def test_refusals_leave_no_file(refused, ct, tmp_path, monkeypatch, words, sentence):
    monkeypatch.chdir(tmp_path)
    assert sentence in refused("segment", ct, *words)
    assert list(tmp_path.iterdir()) == []


def test_labels_of_another_grid_are_refused(refused, ct, tmp_path):
    moved = AFFINE.copy()
    moved[0, 3] += 1
    nibabel.save(nibabel.Nifti1Image(ball(20, 0, 3, 9).astype(np.uint8).T, moved), tmp_path / "labels.nii")
    words = ("-o", tmp_path / "l.nrrd", "--from", tmp_path / "labels.nii", "--margin", "label 1", 3)
    assert "do not lie on one grid" in refused("segment", ct, *words)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ((), "give a point, --seed NAME X Y Z"),
        (("--seed", "liver", 20, 0, "three"), "--seed takes finite numbers, not 20 0 three"),
        (("--seed", " ", 20, 0, 3), "--seed begins with the structure's name"),
        (("--seed", "liver", 20, 0, 3, "--method", "connected"), "needs --range LOW HIGH"),
        (
            ("--seed", "a", 20, 0, 3, "--method", "connected", "--range", 0, 9, "--hu-per-mm", 3),
            "--hu-per-mm is for --method compete",
        ),
        (("--seed", "liver", 20, 0, 3, "--opening-mm", 3), "--opening-mm is for --method connected"),
        (("--seed", "liver", 20, 0, 3, "-o", "l.dcm"), "allow it by --with-identity, or write a .seg.nrrd"),
        (("--seed", "liver", 20, 0, 3, "--with-identity"), "--with-identity is for a DICOM segmentation"),
    ],
)
def test_flags_that_cannot_be_are_refused_before_the_ct_is_read(misused, tmp_path, words, sentence):
    assert sentence in misused("segment", tmp_path / "none.nii", "-o", tmp_path / "l.nrrd", *words)


def test_a_dicom_segmentation_needs_highdicom_and_dicom_images(refused, ct, tmp_path, monkeypatch):
    words = ("segment", ct, "-o", tmp_path / "l.dcm", "--with-identity", "--seed", "liver", 20, 0, 3)
    monkeypatch.setitem(sys.modules, "highdicom", None)
    assert "pip install 'ctmc-addon[dicom-seg]', or write a .seg.nrrd" in refused(*words)
    monkeypatch.setitem(sys.modules, "highdicom", ModuleType("highdicom"))
    assert "the DICOM images it was made on, and ct.nii is NIfTI" in refused(*words)
    assert not (tmp_path / "l.dcm").exists()
