# SPDX-License-Identifier: GPL-3.0-or-later
"""What `ctmc reconstruct` refuses: in which words, with which exit code, and leaving nothing behind."""

import errno
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from ctmc_addon import core
from ctmc_addon.core.measures.reconstruction import Reconstruction

ROOT = Path(__file__).resolve().parents[3]
pytestmark = pytest.mark.usefixtures("scene")
WRONG_USAGE = [
    (["--threshold", "nan"], ["--threshold: must be a finite number"]),
    (["--stride", "0"], ["--stride: must be from 1 to 16, not 0"]),
    (["--min-part", "-1"], ["--min-part: must be 0 or more, not -1"]),
    (["--alpha", "1.5"], ["--alpha: must be from 0 to 1 or auto, not 1.5"]),
    (["--simplify", "1"], ["at least 0 and below 1"]),
    (["--simplify", "-0.5"], ["at least 0 and below 1"]),
    (["--triangles", "2"], ["4 or more, not 2"]),
    (["--soften", "-1"], ["from 0 to 50"]),
    (["--spacing", "0", "1", "1"], ["spacing", "from 1e-06 to 10000 mm, not 0"]),
    (["--spacing", "nan"], ["spacing"]),
    (["--flip", "q"], ["flip", "'q'"]),
    (["--region", "5", "5", "5", "1", "1", "1"], ["region"]),
    (["--simplifier", "decimate", "--max-error", "1"], ["--max-error", "decimate"]),
    (["--threads", "0"], ["--threads: must be 1 or more, not 0"]),
]
BAD_FLAGS = [
    (["--threshold", "5000"], ["5000", "range -1024 to"]),
    (["--threshold", "-5000"], ["-5000", "-1024"]),
    (["--stride", "1", "1", "16"], ["16", "stride"]),
    (["--region", "500", "500", "0", "600", "600", "5"], ["region"]),
    (["--label", "2", "--soften", "1"], []),
    (["--label", "9"], ["9", "1, 2"]),
    (["--min-part", "1e12"], ["1000000000 ml"]),
]


def files_in(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize(("flags", "words"), WRONG_USAGE, ids=lambda value: " ".join(value))
def test_flags_outside_their_limits_are_wrong_usage(misused, tmp_path, flags, words):
    sentence = misused("reconstruct", tmp_path / "no input", "-o", tmp_path / "x.stl", *flags)
    for word in words:
        assert word in sentence
    assert files_in(tmp_path) == []


@pytest.mark.parametrize(("flags", "words"), BAD_FLAGS, ids=lambda value: " ".join(value))
def test_bad_settings_get_one_sentence_and_leave_no_file(refused, ctmc, phantom_folder, tmp_path, flags, words):
    volume = phantom_folder / "volume-4.nii.gz"
    words_of_command = ["reconstruct", volume, "-o", tmp_path / "x.stl", "--report", tmp_path / "x.json", *flags]
    if not words:  # the control: nothing wrong with these
        assert ctmc(*words_of_command).code == 0
        return
    sentence = refused(*words_of_command)
    for word in words:
        assert word in sentence
    assert files_in(tmp_path) == []


def test_a_threshold_in_hu_on_8_bit_slices_gets_a_hint(refused, phantom_folder, tmp_path):
    sentence = refused("reconstruct", phantom_folder / "png", "-o", tmp_path / "x.stl", "--threshold", "300")
    assert "255" in sentence
    assert "8 bit slices" in sentence


def test_a_label_is_not_sought_among_hounsfield_units(refused, phantom_folder, tmp_path):
    sentence = refused("reconstruct", phantom_folder / "dicom", "-o", tmp_path / "x.stl", "--label", "2")
    assert "holds HU" in sentence
    assert "threshold" in sentence


def test_a_case_of_lits_without_its_labels_is_told_which_file_is_missing(refused, phantom_folder, tmp_path):
    shutil.copy(phantom_folder / "volume-4.nii.gz", tmp_path / "volume-6.nii.gz")
    sentence = refused("measure", tmp_path / "volume-6.nii.gz", "--label", "liver")
    assert "volume-6.nii.gz holds HU, and segmentation-6.nii.gz is not in its folder; put it there" in sentence
    assert "dicom holds HU, which are densities" in refused("measure", phantom_folder / "dicom", "--label", "liver")


def test_voxels_without_a_value_name_the_remedy(refused, ctmc, tmp_path):
    values = np.zeros((6, 6, 6), np.float32)
    values[2:4, 2:4, 2:4] = 100
    values[0, 0, 0] = np.nan
    np.save(tmp_path / "broken.npy", values)
    words = ["reconstruct", tmp_path / "broken.npy", "-o", tmp_path / "x.stl", "--threshold", "50"]
    assert "--nan-as" in refused(*words)
    assert ctmc(*words, "--nan-as", "0").code == 0


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("x.xyz", "suffixes .stl, .ply, .obj, .glb, .3mf, .html, .blend"),
        ("x", "suffixes .stl"),
        ("missing/x.stl", "the folder does not exist; make it first"),
        ("file/x.stl", "the folder is a file"),
        ("folder.stl", "a folder has that name"),
        ("materials.obj", "a folder has that name"),
    ],
)
def test_a_place_that_cannot_be_written_is_said_before_the_work(refused, tmp_path, name, words):
    (tmp_path / "folder.stl").mkdir()
    (tmp_path / "materials.mtl").mkdir()
    (tmp_path / "file").write_text("")
    # INPUT does not exist: had reading begun, the sentence would be about it.
    assert words in refused("reconstruct", tmp_path / "no input", "-o", tmp_path / name)
    assert "add --figure b.png" in refused("reconstruct", tmp_path / "no input", "-o", tmp_path / "b.png")
    assert "an empty name needs one of the suffixes" in refused("reconstruct", tmp_path / "no input", "-o", "")


@pytest.mark.parametrize(
    ("flag", "name", "words"),
    [("--report", "r.txt", ".json"), ("--figure", "f.jpg", ".png"), ("--report", "no/r.json", "does not exist")],
)
def test_report_and_figure_are_checked_before_the_work_too(refused, tmp_path, flag, name, words):
    sentence = refused("reconstruct", tmp_path / "no input", "-o", tmp_path / "x.stl", flag, tmp_path / name)
    assert words in sentence


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_read_only_folder_is_said_before_the_work(refused, tmp_path):
    tmp_path.chmod(0o500)
    assert "not allowed" in refused("reconstruct", tmp_path / "no input", "-o", tmp_path / "x.stl")


def test_a_full_disk_leaves_the_old_file_as_it_was(refused, phantom_folder, tmp_path, monkeypatch):
    (tmp_path / "x.json").write_text("old")

    def full(self, content):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    words = ["-o", tmp_path / "x.stl", "--report", tmp_path / "x.json", "--label", "2"]
    assert "the disk is full" in refused("reconstruct", phantom_folder / "segmentation-4.nii.gz", *words)
    assert (tmp_path / "x.json").read_text() == "old"
    assert files_in(tmp_path) == ["x.json"]


def test_an_interrupt_is_quiet_and_leaves_no_file(ctmc, phantom_folder, tmp_path, monkeypatch):
    def interrupted(self):
        raise KeyboardInterrupt

    monkeypatch.setattr(Reconstruction, "report", interrupted)
    words = ["-o", tmp_path / "x.stl", "--report", tmp_path / "x.json", "--label", "2"]
    outcome = ctmc("reconstruct", phantom_folder / "segmentation-4.nii.gz", *words)
    assert (outcome.code, outcome.out, outcome.errors) == (130, "", ["ctmc: interrupted"])
    assert files_in(tmp_path) == []


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["dance"],
        ["reconstruct"],
        ["reconstruct", "in"],
        ["reconstruct", "in", "-o", "x.stl", "--alpha", "much"],
        ["reconstruct", "in", "-o", "x.stl", "--stride", "1", "2"],
        ["reconstruct", "in", "-o", "x.stl", "--threshold", "1", "--label", "2"],
        ["reconstruct", "in", "-o", "x.stl", "--simplify", "0.5", "--triangles", "100"],
        ["reconstruct", "in", "-o", "x.stl", "--normals", "none"],
    ],
    ids=" ".join,
)
def test_wrong_usage_has_exit_code_2(ctmc, words):
    outcome = ctmc(*words)
    assert outcome.code == 2
    assert outcome.errors[0].startswith("usage: ctmc")


@pytest.mark.once
@pytest.mark.parametrize(
    ("fails", "there"),
    [
        ("core.files.mesh_files.write_mesh", True),
        ("blender.figure.rendering.render.render_figure_steps", True),
        ("cli.outputs.write_json", True),
        ("cli.outputs.write_json", False),
    ],
)
def test_when_one_output_fails_none_is_left(ctmc, phantom_folder, small_pictures, tmp_path, monkeypatch, fails, there):
    names = ["f.png", "r.json", "t.stl"]
    if there:
        for name in names:
            (tmp_path / name).write_text("older")

    def full(*_args, **_options):
        raise core.CtmcError("the disk is full")

    monkeypatch.setattr(f"ctmc_addon.{fails}", full)
    flags = ["--figure", tmp_path / "f.png", "--report", tmp_path / "r.json"]
    outcome = ctmc("reconstruct", phantom_folder / "volume-4.nii.gz", "--label", "2", "-o", tmp_path / "t.stl", *flags)
    assert outcome.code == 1
    assert outcome.errors == ["ctmc: the disk is full"]
    assert files_in(tmp_path) == (names if there else [])
    assert all((tmp_path / name).read_text() == "older" for name in files_in(tmp_path))
