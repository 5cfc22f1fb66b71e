# SPDX-License-Identifier: GPL-3.0-or-later
"""Solids from the command line, made for real: small phantoms, volumes by closed forms, files and tables."""

from __future__ import annotations

import csv
import json
import struct

import nibabel
import numpy as np
import pytest

from ctmc_addon.core import ReconstructionSettings
from ctmc_addon.core.solid import SolidRequest, solid_parts
from ctmc_addon.readers import read_volume

RADIUS = 12.0
BALL = 4 / 3 * np.pi * RADIUS**3
THRESHOLD = ("--threshold", "100")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A ball of 12 mm about the origin in voxels of 1 mm, and labels of two boxes of 10 x 10 x 12 mm side by side."""
    folder = tmp_path_factory.mktemp("parts")
    axes = np.arange(32) - 15.5
    x, y, z = np.meshgrid(axes, axes, axes, indexing="ij")
    affine = np.eye(4)
    affine[:3, 3] = -15.5
    values = np.clip(100 + 50 * (RADIUS - np.sqrt(x * x + y * y + z * z)), 0, 255)
    nibabel.save(nibabel.Nifti1Image(values.astype(np.uint8), affine), folder / "ball.nii")
    labels = np.zeros((12, 20, 24), np.uint8)
    labels[3:9, 4:14, 4:14], labels[3:9, 4:14, 14:20] = 1, 2
    nibabel.save(nibabel.Nifti1Image(labels.T, np.diag([1.0, 1.0, 2.0, 1.0])), folder / "boxes.nii")
    return folder


@pytest.fixture
def made(ctmc, folder, tmp_path):
    """Run `ctmc reconstruct` and return the reports of its surfaces."""

    def run(name, *words, output="a.stl"):
        report = tmp_path / "report.json"
        done = ctmc("reconstruct", folder / name, *words, "--report", report, "-o", f"{tmp_path}/{output}")
        assert done.code == 0, done.errors
        content = json.loads(report.read_text("utf-8"))
        return content.get("surfaces", [content])

    return run


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def names_in_glb(path):
    content = path.read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    return [node["name"] for node in json.loads(content[20 : 20 + length])["nodes"] if "mesh" in node]


def test_a_hollow_ball_has_the_volume_of_its_shell(made):
    [shell] = made("ball.nii", *THRESHOLD, "--hollow", "2")
    assert shell["volume_mm3"] == pytest.approx(BALL * (1 - (10 / 12) ** 3), rel=0.01)
    assert (shell["closed"], shell["components"], shell["cavities"]) == (True, 1, 1)


def test_drains_open_the_hollow_and_take_two_cylinders(made):
    [shell] = made("ball.nii", *THRESHOLD, "--hollow", "2")
    [drained] = made("ball.nii", *THRESHOLD, "--hollow", "2", "--drain", "auto")
    assert (drained["closed"], drained["components"], drained["cavities"]) == (True, 1, 0)
    removed = shell["volume_mm3"] - drained["volume_mm3"]
    assert removed == pytest.approx(2 * np.pi * 2**2 * 2, rel=0.1)
    [one] = made("ball.nii", *THRESHOLD, "--hollow", "2", "--drain", "0", "0", "-9", "4")
    assert shell["volume_mm3"] - one["volume_mm3"] == pytest.approx(removed / 2, rel=0.05)


def test_a_surface_moves_inward_by_a_negative_number(made):
    [inner] = made("ball.nii", *THRESHOLD, "--thicken", "-2")
    assert inner["volume_mm3"] == pytest.approx(BALL * (10 / 12) ** 3, rel=0.02)
    [outer] = made("ball.nii", *THRESHOLD, "--thicken", "1.5")
    assert outer["volume_mm3"] == pytest.approx(BALL * (13.5 / 12) ** 3, rel=0.02)


def test_a_cut_makes_two_parts_of_a_ball_that_fill_it(made, tmp_path):
    [whole] = made("ball.nii", *THRESHOLD)
    upper, lower = made("ball.nii", *THRESHOLD, "--cut", "0", "0", "6", "0", "0", "1", output="out/")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["ball a.stl", "ball b.stl"]
    cap = np.pi * 6**2 * (3 * RADIUS - 6) / 3
    assert upper["volume_mm3"] == pytest.approx(cap, rel=0.02)
    assert upper["volume_mm3"] + lower["volume_mm3"] == pytest.approx(whole["volume_mm3"], rel=0.002)
    assert all(part["closed"] and part["self_intersections"] == 0 for part in (upper, lower))


def test_pegs_stand_on_part_a_and_have_room_in_part_b(made):
    cut = ("--cut", "0", "0", "0", "0", "0", "1")
    half, _ = made("ball.nii", *THRESHOLD, *cut, output="plain/")
    words = ("--pegs", "2", "--peg-mm", "5", "6", "--clearance", "0.5")
    upper, lower = made("ball.nii", *THRESHOLD, *cut, *words, output="pegs/")
    pegs = 2 * (np.pi * 2.5**2 * 3.5 + 2 / 3 * np.pi * 2.5**3)
    holes = 2 * (np.pi * 3**2 * 3.5 + 2 / 3 * np.pi * 3**3)
    assert upper["volume_mm3"] - half["volume_mm3"] == pytest.approx(pegs, rel=0.1)
    assert half["volume_mm3"] - lower["volume_mm3"] == pytest.approx(holes, rel=0.1)


def test_parts_of_several_labels_have_files_and_objects_with_their_names(made, tmp_path):
    cut = ("--cut", "0", "0", "11", "0", "0", "1")
    names = ["label 1 a", "label 1 b", "label 2 a", "label 2 b"]
    parts = made("boxes.nii", "--label", "1", "2", "--smoothing", "none", *cut, output="out/")
    assert [part["name"] for part in parts] == names
    assert [path.stem for path in sorted((tmp_path / "out").iterdir())] == names
    made("boxes.nii", "--label", "1", "2", "--smoothing", "none", *cut, output="a.glb")
    assert names_in_glb(tmp_path / "a.glb") == names


def test_merged_labels_have_the_surface_of_one_label(made, folder):
    volume = nibabel.load(folder / "boxes.nii")
    nibabel.save(
        nibabel.Nifti1Image((np.asarray(volume.dataobj) > 0).astype(np.uint8), volume.affine), folder / "1.nii"
    )
    [merged] = made("boxes.nii", "--smoothing", "none", "--merge", "both=1,2")
    [one] = made("1.nii", "--smoothing", "none", "--label", "1")
    assert merged["volume_mm3"] == pytest.approx(one["volume_mm3"], rel=1e-6)
    assert merged["area_mm2"] == pytest.approx(one["area_mm2"], rel=1e-6)
    assert (merged["label_name"], merged["components"], merged["closed"]) == ("both", 1, True)


def test_a_combination_takes_its_structures_and_leaves_the_others(ctmc, folder, tmp_path):
    names = nibabel.load(folder / "boxes.nii")
    labels = np.asarray(names.dataobj).copy()
    labels[20:22, 4:14, 3:9] = 3
    nibabel.save(nibabel.Nifti1Image(labels, names.affine), folder / "three.nii")
    words = ("--label", "all", "--smoothing", "none", "--subtract", "rest=1,2")
    done = ctmc("reconstruct", folder / "three.nii", *words, "-o", f"{tmp_path}/out/")
    assert done.code == 0, done.errors
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["label 3.stl", "rest.stl"]
    assert "settings: --smoothing none --subtract rest=1,2" in done.out


def test_two_structures_do_not_go_into_a_file_of_one_surface(refused, folder, tmp_path):
    words = ("--label", "1", "2", "--hollow", "2", "-o", tmp_path / "a.stl")
    assert "a.stl can hold one surface" in refused("reconstruct", folder / "boxes.nii", *words)
    assert list(tmp_path.iterdir()) == []


def test_a_report_makes_the_same_solid_again(made, folder):
    cut = ("--cut", "0", "0", "0", "0", "0", "1", "--pegs", "2", "--base", "1")
    first, second = made("ball.nii", *THRESHOLD, *cut, output="out/")
    assert first["solid"] == second["solid"]
    volume = read_volume(folder / "ball.nii")
    parts = solid_parts(
        volume, ReconstructionSettings.from_dict(first["settings"]), SolidRequest.from_dict(first["solid"])
    )
    assert [part.report()["volume_mm3"] for part in parts] == [first["volume_mm3"], second["volume_mm3"]]


def test_simplified_parts_stay_closed(made):
    words = ("--cut", "0", "0", "1", "0", "0", "1", "--simplify", "0.8")
    parts = made("ball.nii", *THRESHOLD, *words, output="out/")
    assert all(part["closed"] and part["self_intersections"] == 0 for part in parts)
    assert all(part["faces"] < 0.3 * part["full_faces"] for part in parts)


def test_measure_has_the_volumes_of_parts_and_their_walls(ctmc, folder, tmp_path):
    words = ("--cut", "0", "0", "0", "0", "0", "1", "--hollow", "2", "--thickness", "-o", tmp_path / "a.csv")
    done = ctmc("measure", folder / "ball.nii", *THRESHOLD, *words)
    assert done.code == 0, done.errors
    rows = rows_of(tmp_path / "a.csv")
    assert [row["name"] for row in rows] == ["ball a", "ball b"]
    shell = BALL * (1 - (10 / 12) ** 3) / 2000
    assert [float(row["volume_ml"]) for row in rows] == pytest.approx([shell, shell], rel=0.01)
    assert [float(row["thickness_mm_median"]) for row in rows] == pytest.approx([2, 2], abs=0.1)


def test_a_batch_has_a_row_for_each_part(ctmc, folder, tmp_path):
    out = tmp_path / "out"
    words = (*THRESHOLD, "--cut", "0", "0", "0", "0", "0", "1", "--no-thumbnails", "--quiet")
    assert ctmc("batch", folder / "ball.nii", "-o", out, *words).code == 0
    assert sorted(path.name for path in (out / "ball").iterdir()) == ["ball a.stl", "ball b.stl"]
    rows = rows_of(out / "labels.csv")
    assert [row["name"] for row in rows] == ["ball a", "ball b"]
    assert [float(row["volume_mm3"]) for row in rows] == pytest.approx([BALL / 2, BALL / 2], rel=0.02)
    record = (out / "ball.json").read_text("utf-8")
    assert ctmc("batch", folder / "ball.nii", "-o", out, *words, "--resume").code == 0
    assert (out / "ball.json").read_text("utf-8") == record
    assert ctmc("batch", folder / "ball.nii", "-o", out, *words, "--hollow", "3", "--resume").code == 0
    assert (out / "ball.json").read_text("utf-8") != record


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--cut", "0", "0", "40", "0", "0", "1"), "the cut at 0 0 40 misses the structure"),
        (("--hollow", "2", "--deviation"), "leave out --deviation, or the flags of the solid"),
        (("--hollow", "20"), "a wall of 20 mm leaves no hollow in ball"),
        (("--hollow", "2", "--drain", "0", "0", "20", "4"), "a drain at 0 0 20 lies 8.03 mm outside the surface"),
    ],
)
def test_what_makes_no_solid_is_refused_and_nothing_is_written(refused, folder, tmp_path, words, sentence):
    output = f"{tmp_path}/out/"
    assert sentence in refused("reconstruct", folder / "ball.nii", *THRESHOLD, *words, "-o", output)
    assert list(tmp_path.iterdir()) == []


def test_a_structure_that_cannot_be_made_is_left_out_of_all(ctmc, refused, made, folder, tmp_path):
    done = ctmc("reconstruct", folder / "boxes.nii", "--label", "all", "--hollow", "3.5", "-o", f"{tmp_path}/out/")
    assert done.code == 0
    assert "label 2 is left out: a wall of 3.5 mm leaves no hollow in label 2, which is " in " ".join(done.out.split())
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["label 1.stl"]
    several = ("--label", "1", "--label", "2", "--hollow", "3.5", "-o", f"{tmp_path}/both/")
    assert "leaves no hollow in label 2" in refused("reconstruct", folder / "boxes.nii", *several)
    assert not (tmp_path / "both").exists()
    out = tmp_path / "batch"
    words = ("--label", "all", "--hollow", "3.5", "--no-thumbnails", "--quiet")
    assert ctmc("batch", folder / "boxes.nii", "-o", out, *words).code == 0
    assert [path.name for path in (out / "boxes").iterdir()] == ["label 1.stl"]
    assert "label 2 is left out: " in " ".join(json.loads((out / "boxes.json").read_text("utf-8"))["notes"])


def test_a_merged_structure_is_a_label_and_combinations_in_the_wrong_order_say_so(made, misused, folder, tmp_path):
    [by_name] = made("boxes.nii", "--merge", "both=1,2", "--label", "both")
    [merged] = made("boxes.nii", "--merge", "both=1,2")
    assert by_name["volume_mm3"] == merged["volume_mm3"]
    wrong = ("--subtract", "rest=both,2", "--merge", "both=1,2", "-o", f"{tmp_path}/b.stl")
    assert "makes after it; give that one first" in misused("reconstruct", folder / "boxes.nii", *wrong)
