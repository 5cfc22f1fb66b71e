# SPDX-License-Identifier: GPL-3.0-or-later
"""No command writes over a file that it reads, whichever flag names the file."""

import os
import shutil

import numpy as np
import pytest

from ctmc_addon.core.files.atomic_write import write_csv


def content(folder):
    return {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def pictures(tmp_path):
    """A ball in pictures."""
    image = pytest.importorskip("PIL.Image")
    folder = tmp_path / "pictures"
    folder.mkdir()
    z, y, x = np.ogrid[:8, :16, :16]
    ball = np.where((x - 8) ** 2 + (y - 8) ** 2 + 4 * (z - 4) ** 2 < 30, 200, 0).astype(np.uint8)
    for number, plane in enumerate(ball, 1):
        image.fromarray(plane).save(folder / f"frame_{number:04d}.png")
    return folder


@pytest.fixture
def dicom(phantom_folder, tmp_path):
    """A DICOM folder whose slices have the suffixes of every output: DICOM needs none."""
    names = ["a.stl", "a.ply", "a.obj", "a.json", "a.blend", "a.mp4", "table.csv", "a.toml"]
    folder = tmp_path / "dicom"
    folder.mkdir()
    slices = sorted((phantom_folder / "dicom").iterdir())
    for number, file in enumerate(slices):
        shutil.copy(file, folder / (names[number] if number < len(names) else file.name))
    return folder


def test_a_figure_replaces_no_slice(refused, pictures, tmp_path, scene):
    before, slice_path = content(pictures), pictures / "frame_0001.png"
    out = tmp_path / "a.stl"
    sentence = refused("reconstruct", pictures, "--threshold", 100, "-o", out, "--figure", slice_path)
    assert sentence == (
        f"ctmc: {slice_path} is a file of the input and would be replaced; choose another name or folder"
    )
    assert content(pictures) == before
    assert not out.exists()


@pytest.mark.parametrize(
    "words",
    [
        ["reconstruct", "-o", "a.stl"],
        ["reconstruct", "-o", "a.ply"],
        ["reconstruct", "-o", "a.obj"],
        ["reconstruct", "-o", "{out}/x.stl", "--report", "a.json"],
        ["figure", "-o", "{out}/x.png", "--blend", "a.blend"],
        ["figure", "-o", "{out}/a.png", "--blend", "{out}/../dicom/a.blend"],
        ["experiment", "voxels", "--overwrite", "-o", "."],
    ],
    ids=lambda words: " ".join(words),
)
def test_no_flag_names_a_file_of_the_input(refused, dicom, tmp_path, monkeypatch, scene, words):
    out = tmp_path / "out"
    out.mkdir()
    before = content(dicom)
    monkeypatch.chdir(dicom)
    count = 1 + (words[1] == "voxels")
    command = [word.format(out=out) for word in words]
    sentence = refused(*command[:count], dicom, "--threshold", 50, *command[count:])
    assert sentence.endswith(" is a file of the input and would be replaced; choose another name or folder")
    assert content(dicom) == before
    assert content(out) == {}


TURNTABLE = ("--threshold", 50, "--width-mm", 40, "--dpi", 40, "--seconds", 1, "--fps", 5, "--overwrite")


def test_a_video_replaces_no_slice(ctmc, dicom, scene):
    before = content(dicom)
    done = ctmc("figure", "turntable", dicom, *TURNTABLE, "-o", dicom / "a.mp4")
    assert (done.code, done.errors[-1]) == (
        1, f"ctmc: {dicom / 'a.mp4'} is a file of the input and would be replaced; choose another name or folder"
    )  # fmt: skip
    assert content(dicom) == before


@pytest.mark.parametrize(("name", "output"), [("scan", "scan"), ("scan.frames", "scan.mp4")])
def test_frames_of_an_older_turntable_that_are_the_input_are_not_removed(ctmc, pictures, scene, name, output):
    folder = pictures.rename(pictures.with_name(name))
    (folder / "turntable.json").write_text("{}")
    before = content(folder)
    done = ctmc("figure", "turntable", folder, *TURNTABLE, "-o", folder.with_name(output))
    assert done.code == 1
    assert "is a file of the input and would be replaced" in done.errors[-1]
    assert content(folder) == before


def test_settings_are_an_input_too(refused, phantom_folder, tmp_path):
    settings = tmp_path / "case.json"
    settings.write_text("threshold = 100.0\n")
    words = ("--settings", settings, "-o", tmp_path / "a.stl", "--report", settings)
    sentence = refused("reconstruct", phantom_folder / "volume-4.nii.gz", *words)
    assert "case.json is a file of the input" in sentence
    assert settings.read_text() == "threshold = 100.0\n"


def manifest_in(folder, name, phantom_folder):
    folder.mkdir()
    rows = [{"input": str(phantom_folder / "volume-4.nii.gz"), "case": "a", "threshold": "50"}]
    write_csv(folder / name, rows, ["input", "case", "threshold"])
    return folder / name


def test_a_batch_does_not_replace_the_manifest_that_it_reads(refused, phantom_folder, tmp_path):
    manifest = manifest_in(tmp_path / "man", "summary.csv", phantom_folder)
    before = content(tmp_path)
    sentence = refused("batch", manifest, "-o", manifest.parent, "--overwrite")
    assert sentence == (f"ctmc: {manifest} is a file of the input and would be replaced; choose another name or folder")
    assert content(tmp_path) == before


def test_a_batch_is_told_of_a_second_name_of_its_manifest(refused, phantom_folder, tmp_path):
    manifest = manifest_in(tmp_path / "man", "cases.csv", phantom_folder)
    (tmp_path / "out").mkdir()
    os.link(manifest, tmp_path / "out" / "summary.csv")
    sentence = refused("batch", manifest, "-o", tmp_path / "out", "--overwrite")
    assert "summary.csv is a file of the input" in sentence
    assert manifest.read_text().startswith("input,case,threshold")


def test_the_thumbnail_of_a_case_does_not_replace_a_slice(refused, pictures, tmp_path, scene):
    out = tmp_path / "out"
    out.mkdir()
    folder = pictures.rename(out / "thumbnails")
    (folder / "frame_0001.png").rename(folder / "thumbnails.png")
    before = content(folder)
    sentence = refused("batch", folder, "--threshold", 100, "-o", out, "--overwrite")
    assert "thumbnails.png is a file of the input" in sentence
    assert content(folder) == before


def test_an_output_beside_the_input_is_written(ctmc, pictures):
    before = content(pictures)
    done = ctmc("reconstruct", pictures, "--threshold", 100, "-o", pictures / "a.stl", "--report", pictures / "a.json")
    assert done.code == 0, done.errors
    again = ctmc("reconstruct", pictures, "--threshold", 100, "-o", pictures / "a.stl", "--report", pictures / "a.json")
    assert again.code == 0, again.errors
    after = content(pictures)
    assert sorted(after.keys() - before.keys()) == ["a.json", "a.stl"]
    assert {name: after[name] for name in before} == before
