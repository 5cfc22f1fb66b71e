# SPDX-License-Identifier: GPL-3.0-or-later
"""`ctmc segment`: points to labels in a file that other programs read."""

from __future__ import annotations

import errno
import os
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
    voxels = int(masks["left kidney"].sum())
    assert lines[0].split(maxsplit=2)[2] == f"{voxels * 0.012:.4g} ml, {voxels} voxels, label 1"
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
        (("-o", "l.seg.nrrd", "--seed", "liver", 99, 0, 3), "the point 99 0 3 lies outside the volume"),
        (
            ("-o", "l.stl", "--seed", "liver", 20, 0, 3),
            "l.stl needs one of the suffixes .seg.nrrd, .nrrd, .nii, .nii.gz, .dcm; it",
        ),
        (("-o", "l.csv.gz", "--seed", "liver", 20, 0, 3), "needs one of the suffixes .seg.nrrd"),
        (
            ("-o", "l.nrrd", "--seed", "liver", 20, 0, 3, "--margin", "spleen", 2),
            "--margin names 'spleen', but no structure has that name",
        ),
        (("-o", "l.nrrd", "--seed", "liver", 20, 0, 3, "--margin", "liver", -90), "nothing is left of liver"),
        (("-o", "l.nrrd", "--seed", "liver", 20, 0, 3, "--max-mm", 0), "--max-mm must be from 0.01 to 10000, not 0"),
        (
            ("-o", "l.nrrd", "--seed", "liver", 20, 0, 3, "--hu-per-mm", -1),
            "--hu-per-mm must be from 0.01 to 10000, not -1",
        ),
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
    assert "has samples up to 1 mm away from those of the CT" in refused("segment", ct, *words)


def saved(values, affine, path):
    nibabel.save(nibabel.Nifti1Image(values.T, affine), path)
    return path


def test_labels_of_a_file_keep_their_numbers_and_a_new_one_comes_after_them(ctmc, ct, tmp_path):
    before = np.where(ball(0, -14, 3, 8), 9, np.where(ball(-18, 4, 6, 8), 5, 0)).astype(np.uint8)
    words = ("--from", saved(before, AFFINE, tmp_path / "labels.nii"), "--seed", "liver", 20, 0, 3)
    done = ctmc("segment", ct, "-o", tmp_path / "l.nii.gz", *words)
    assert [line.split()[-1] for line in done.out.splitlines()[:3]] == ["5", "9", "10"]
    after = readers.read_volume(tmp_path / "l.nii.gz").values
    assert ((after == 5) == (before == 5)).all()
    assert ((after == 9) == (before == 9)).all()
    assert dice(after == 10, ball(20, 0, 3, 12)) > 0.9


def test_labels_in_another_order_of_the_axes_are_put_on_the_grid_of_the_ct(ctmc, ct, tmp_path):
    mask = ball(20, 0, 3, 9)
    flipped = AFFINE @ np.array([[1, 0, 0, 0], [0, -1, 0, SHAPE[1] - 1], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    labels = saved(mask[:, ::-1].astype(np.uint8), flipped, tmp_path / "labels.nii")
    assert ctmc("segment", ct, "-o", tmp_path / "l.nii", "--from", labels, "--margin", "label 1", 3).code == 0
    after = readers.read_volume(tmp_path / "l.nii").values == 1
    assert dice(after, ball(20, 0, 3, 12)) > 0.94


def test_labels_above_255_are_numbered_anew_with_a_note(ctmc, ct, tmp_path):
    labels = saved(np.where(ball(20, 0, 3, 9), 4000, 0).astype(np.int16), AFFINE, tmp_path / "labels.nii")
    done = ctmc("segment", ct, "-o", tmp_path / "l.nii", "--from", labels, "--margin", "label 4000", 3)
    assert "renumbered, because one is 4000" in done.out
    assert set(np.unique(readers.read_volume(tmp_path / "l.nii").values)) == {0, 1}


def test_segments_of_a_file_keep_their_colors_and_stay_two_where_they_have_one_name(ctmc, ct, tmp_path):
    first = tmp_path / "first.seg.nrrd"
    points = ("--seed", "liver", 20, 0, 3, "--seed", "spleen", -18, 4, 6)
    assert ctmc("segment", ct, "-o", first, *points).code == 0
    content = first.read_bytes().replace(b"Name:=spleen", b"Name:=liver").replace(b"0.478431", b"0.200000")
    first.write_bytes(content)
    done = ctmc("segment", ct, "-o", tmp_path / "l.seg.nrrd", "--from", first, "--margin", "liver", 4)
    assert "has two structures called liver; the second is renamed liver 2" in done.out
    _, header = nrrd.read(str(tmp_path / "l.seg.nrrd"))
    assert [header[f"Segment{at}_Name"] for at in (0, 1)] == ["liver", "liver 2"]
    assert header["Segment0_Color"].startswith("0.2 ")


def test_names_that_are_made_up_are_taken_by_none(ctmc, ct, tmp_path):
    first = tmp_path / "first.seg.nrrd"
    points = ("--seed", "a 3", 20, 0, 3, "--seed", "b", -18, 4, 6, "--seed", "c", 0, -14, 3)
    assert ctmc("segment", ct, "-o", first, *points).code == 0
    first.write_bytes(first.read_bytes().replace(b"Name:=b", b"Name:=a").replace(b"Name:=c", b"Name:=a"))
    assert ctmc("segment", ct, "-o", tmp_path / "l.seg.nrrd", "--from", first, "--margin", "a", 2).code == 0
    assert list(masks_of(tmp_path / "l.seg.nrrd")) == ["a 3", "a", "a 3 3"]


def test_notes_say_what_a_person_may_not_expect(ctmc, ct, tmp_path):
    points = ("--seed", "liver", 20, 0, 3, "--margin", "liver", 0.5)
    done = ctmc("segment", ct, "-o", tmp_path / "l.nrrd", *points)
    notes = " ".join(done.out.split())
    assert "A margin of 0.5 mm does not change liver, because voxels are 2 mm apart" in notes
    np.save(tmp_path / "ct.npy", values())
    done = ctmc("segment", tmp_path / "ct.npy", "-o", tmp_path / "m.nrrd", "--seed", "liver", -10, -15, 5)
    assert done.out.split("note")[1].split()


def test_a_point_out_of_range_region_or_values_is_named(refused, tmp_path):
    hu = values().astype(np.float32)
    hu[ball(-18, 4, 6, 4)] = np.nan
    ct = saved(hu, AFFINE, tmp_path / "nan.nii")
    out = ("-o", tmp_path / "l.nrrd")
    both = ("--method", "connected", "--range", 60, 140, "--seed", "liver", 20, 0, 3, "--seed", "liver", 0, -14, 3)
    sentence = refused("segment", ct, *out, *both)
    assert "the point 0 -14 3 of liver has the value" in sentence
    assert "outside the range 60 to 140" in sentence
    assert "the CT is NaN at the point -18 4 6" in refused("segment", ct, *out, "--seed", "liver", -18, 4, 6)
    region = ("--region", 10, -20, -10, 38, 20, 10, "--region-unit", "mm", "--seed", "liver", 0, 0, 3)
    assert "the point 0 0 3 lies outside the region" in refused("segment", ct, *out, *region)


def test_a_full_disk_is_one_sentence(refused, ct, tmp_path, monkeypatch):
    def full(*_args, **_kwargs):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    sentence = refused("segment", ct, "-o", tmp_path / "l.seg.nrrd", "--seed", "liver", 20, 0, 3)
    assert sentence.endswith("l.seg.nrrd cannot be written: the disk is full; free some space or choose another disk")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ((), "give a point with --seed NAME X Y Z"),
        (("--seed", "liver", 20, 0, "three"), "--seed takes finite numbers, not 20 0 three"),
        (("--seed", " ", 20, 0, 3), "--seed begins with the structure's name"),
        (("--seed", "liver", 20, 0, 3, "--method", "connected"), "needs --range LOW HIGH"),
        (
            ("--seed", "a", 20, 0, 3, "--method", "connected", "--range", 0, 9, "--hu-per-mm", 3),
            "--hu-per-mm is for --method compete",
        ),
        (("--from", "l.nrrd", "--margin", "a", 2, "--background", 20, 0, 3), "give the structure a point"),
        (("--seed", "a", 20, 0, 3, "--margin", "a", 2, "--margin", "a", 3), "--margin is given twice"),
        (("--seed", "liver", 20, 0, 3, "--opening-mm", 3), "--opening-mm is for --method connected"),
        (("--seed", "liver", 20, 0, 3, "-o", "l.dcm"), "allow it with --with-identity, or write a .seg.nrrd"),
        (("--seed", "liver", 20, 0, 3, "--with-identity"), "--with-identity is for a DICOM segmentation"),
    ],
)
def test_flags_that_cannot_be_are_refused_before_the_ct_is_read(misused, tmp_path, words, sentence):
    assert sentence in misused("segment", tmp_path / "none.nii", "-o", tmp_path / "l.nrrd", *words)


def test_a_dicom_segmentation_needs_highdicom_and_dicom_images(refused, ct, tmp_path, monkeypatch):
    words = ("segment", ct, "-o", tmp_path / "l.dcm", "--with-identity", "--seed", "liver", 20, 0, 3)
    monkeypatch.setitem(sys.modules, "highdicom", None)
    assert "pip install 'ctmc-addon[dicom-seg]', or write a .seg.nrrd" in refused(*words)
    highdicom = ModuleType("highdicom")
    highdicom.__version__ = "0.26.1"
    monkeypatch.setitem(sys.modules, "highdicom", highdicom)
    assert "a DICOM segmentation needs highdicom 0.27 or newer, not 0.26.1" in refused(*words)
    highdicom.__version__ = "0.28.2"
    assert "must refer to DICOM images, and ct.nii is NIfTI" in refused(*words)
    assert not (tmp_path / "l.dcm").exists()
