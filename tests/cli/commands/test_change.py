# SPDX-License-Identifier: GPL-3.0-or-later
"""`ctmc measure BEFORE AFTER` and `ctmc batch --pairs`: components of a label at two times, in tables."""

from __future__ import annotations

import csv
import json
import math

import nibabel
import numpy as np
import pytest

from ctmc_addon.core import CHANGE_HEADS

LATER = np.array([[-0.8, 0, 0, 60], [0, 0.8, 0, 0], [0, 0, 1.2, 0], [0, 0, 0, 1.0]])


def saved(path, balls, affine, shape, label=2):
    """Write a label volume in which balls are labeled; centers and radii in mm."""
    index = np.stack(np.indices(shape), -1).reshape(-1, 3)
    points = index @ affine[:3, :3].T + affine[:3, 3]
    values = np.zeros(len(points), np.uint8)
    for center, radius in balls:
        values[((points - center) ** 2).sum(axis=1) < radius**2] = label
    nibabel.save(nibabel.Nifti1Image(values.reshape(shape), affine), path)
    return path


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """One component that has grown, one that is gone, and a new one, on two grids."""
    folder = tmp_path_factory.mktemp("pair")
    before = [((12.3, 12.2, 12.4), 6), ((40.3, 12.2, 12.4), 6)]
    after = [((12.3, 12.2, 12.4), 9), ((40.3, 36.2, 12.4), 5)]
    saved(folder / "before.nii.gz", before, np.diag([1.0, 1, 1, 1]), (60, 48, 26))
    saved(folder / "after.nii.gz", after, LATER, (75, 60, 22))
    return folder


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_two_volumes_give_a_row_for_each_component(ctmc, pair, tmp_path):
    path = tmp_path / "change.csv"
    words = ("measure", pair / "before.nii.gz", pair / "after.nii.gz", "--label", 2, "--days", 90, "-o", path)
    done = ctmc(*words)
    assert (done.code, done.errors) == (0, [])
    rows = rows_of(path)
    assert tuple(rows[0]) == CHANGE_HEADS
    assert [row["status"] for row in rows] == ["grown", "new", "gone"]
    assert {row["name"] for row in rows} == {"label 2"}
    grown, new, gone = rows
    assert float(grown["volume_before_ml"]) == pytest.approx(4 / 3 * math.pi * 0.216, rel=0.025)
    assert float(grown["volume_after_ml"]) == pytest.approx(4 / 3 * math.pi * 0.729, rel=0.025)
    assert float(grown["doubling_time_days"]) == pytest.approx(90 * math.log(2) / math.log(1.5**3), rel=0.02)
    assert [gone[name] for name in ("volume_after_ml", "change_percent", "largest_diameter_after_mm")] == [
        "0",
        "-100",
        "0",
    ]
    assert (new["before"], new["change_percent"], new["doubling_time_days"]) == ("", "", "")
    for text in (
        "before  before: 60 x 48 x 26",
        "grown",
        "+23",
        "by 25 % of the volume or more",
        "written  change.csv",
    ):
        assert text in done.out


def test_the_volumes_are_those_of_the_table_of_each_volume(ctmc, pair, tmp_path):
    assert (
        ctmc("measure", pair / "before.nii.gz", pair / "after.nii.gz", "--label", "all", "-o", tmp_path / "c.csv").code
        == 0
    )
    rows = rows_of(tmp_path / "c.csv")
    for name in ("before", "after"):
        assert ctmc("measure", pair / f"{name}.nii.gz", "--label", "all", "-o", tmp_path / "one.csv").code == 0
        [one] = rows_of(tmp_path / "one.csv")
        total = sum(float(row[f"volume_{name}_ml"]) for row in rows)
        assert total == pytest.approx(float(one["volume_ml"]), rel=1e-6)


def test_the_limit_of_a_change_is_a_flag(ctmc, pair, tmp_path):
    words = ("measure", pair / "before.nii.gz", pair / "after.nii.gz", "--label", 2, "-o", tmp_path / "c.csv")
    done = ctmc(*words, "--change-percent", 300)
    assert done.code == 0
    assert "by 300 % of the volume or more" in done.out
    assert [row["status"] for row in rows_of(tmp_path / "c.csv")] == ["stable", "new", "gone"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ((), "compared by their labels; give --label"),
        (("--threshold", 1), "compared by their labels; give --label"),
        (("--label", 2, "--ct", "ct.nii"), "leave AFTER out"),
        (("--label", 2, "--thickness"), "leave other maps out"),
        (("--label", 2, "--days", -3), "must be above 0, not -3"),
        (("--label", 2, "--change-percent", -3), "must be 0 or more"),
        (("--label", 2, "--simplify", 0.5, "--simplifier", "decimate"), "leave out --simplifier decimate"),
    ],
)
def test_flags_that_do_not_fit_two_volumes_are_refused(misused, pair, words, sentence):
    assert sentence in misused("measure", pair / "before.nii.gz", pair / "after.nii.gz", *words)


def test_the_distance_of_each_vertex_to_the_earlier_surface_is_a_table(ctmc, pair, tmp_path):
    words = (
        "measure",
        pair / "before.nii.gz",
        pair / "after.nii.gz",
        "--label",
        2,
        "--map-table",
        tmp_path / "map.csv",
    )
    assert ctmc(*words).code == 0
    rows = rows_of(tmp_path / "map.csv")
    places = np.array([[float(row[axis]) for axis in ("x_mm", "y_mm", "z_mm")] for row in rows])
    near = np.sqrt(((places - (12.3, 12.2, 12.4)) ** 2).sum(axis=1)) < 12
    distances = np.array([float(row["distance_earlier_mm"]) for row in rows])
    assert distances[near] == pytest.approx(np.full(near.sum(), 3), abs=0.8)


def test_days_without_a_later_volume_are_refused(misused, pair):
    assert "need two volumes" in misused("measure", pair / "before.nii.gz", "--label", 2, "--days", 3)


def test_what_cannot_be_compared_is_one_sentence_and_leaves_no_file(refused, pair, tmp_path):
    moved = LATER.copy()
    moved[2, 3] = 500
    far = saved(tmp_path / "far.nii.gz", [((12, 12, 512), 5)], moved, (75, 60, 22))
    for after, label, sentence in ((far, 2, "lie 475 mm apart"), (pair / "after.nii.gz", 7, "after, the labels are 2")):
        words = ("measure", pair / "before.nii.gz", after, "--label", label, "-o", tmp_path / "change.csv")
        assert sentence in refused(*words)
    region = ("--region", 0, 0, 0, 20, 20, 20)
    assert "--region-unit mm" in refused("measure", *pair.glob("*.nii.gz"), "--label", 2, *region)
    assert [path.name for path in tmp_path.iterdir()] == ["far.nii.gz"]


@pytest.fixture
def manifest(pair, tmp_path):
    path = tmp_path / "pairs.csv"
    own, other = pair / "before.nii.gz", pair / "after.nii.gz"
    lines = [
        "case,before,after,label,days",
        f"p01,{own},{other},2,90",
        f"p02,{other},{own},all,",
        f"p03,{own},{other},7,9",
    ]
    path.write_text("\n".join(lines), "utf-8")
    return path


@pytest.mark.once
def test_a_batch_of_pairs_writes_a_table_for_each_and_one_of_all_and_resumes(ctmc, pair, manifest, tmp_path):
    out = tmp_path / "out"
    done = ctmc("batch", "--pairs", manifest, "-o", out, "--jobs", 1)
    assert (done.code, done.errors) == (0, [])
    assert "1 grown, 1 new, 1 gone" in done.out
    assert (
        ctmc("measure", *sorted(pair.glob("*.nii.gz"))[::-1], "--label", 2, "--days", 90, "-o", tmp_path / "c.csv").code
        == 0
    )
    assert (out / "p01" / "change.csv").read_bytes() == (tmp_path / "c.csv").read_bytes()
    rows = rows_of(out / "changes.csv")
    assert [(row["case"], row["status"]) for row in rows] == [
        ("p01", "grown"),
        ("p01", "new"),
        ("p01", "gone"),
        ("p02", "shrunk"),
        ("p02", "new"),
        ("p02", "gone"),
        ("p03", "absent"),
    ]
    assert "no voxel has the label 7" in rows[-1]["error"]
    assert {row["doubling_time_days"] for row in rows[3:]} == {""}
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*.json")}
    assert "is not empty" in ctmc("batch", "--pairs", manifest, "-o", out).errors[0]
    (out / "p02" / "change.csv").unlink()
    again = ctmc("batch", "--pairs", manifest, "-o", out, "--resume", "--jobs", 1)
    assert (again.code, again.errors) == (0, [])
    assert "2 done before" in again.out
    assert {path.name for path, time in before.items() if path.stat().st_mtime_ns != time} == {"p02.json"}
    assert rows_of(out / "changes.csv") == rows
    other = ctmc("batch", "--pairs", manifest, "-o", out, "--resume", "--jobs", 1, "--change-percent", 300)
    assert "done before" not in other.out
    assert json.loads((out / "p01.json").read_text("utf-8"))["rows"][0]["status"] == "stable"


def test_a_pair_that_fails_is_in_the_table_and_the_others_are_compared(ctmc, pair, tmp_path):
    (tmp_path / "broken.nii.gz").write_bytes((pair / "after.nii.gz").read_bytes()[:300])
    own, other = pair / "before.nii.gz", pair / "after.nii.gz"
    lines = ["case,before,after,label", f"a,{own},broken.nii.gz,2", f"b,{own},{other},2"]
    (tmp_path / "pairs.csv").write_text("\n".join(lines), "utf-8")
    done = ctmc("batch", "--pairs", tmp_path / "pairs.csv", "-o", tmp_path / "out", "--jobs", 1)
    assert done.code == 1
    assert done.errors[-1] == "ctmc: 1 of 2 pairs failed: a"
    rows = rows_of(tmp_path / "out" / "changes.csv")
    assert [(row["case"], row["status"]) for row in rows][:2] == [("a", "failed"), ("b", "grown")]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("case,before,label\na,before.nii.gz,2", "there is no column 'after'"),
        ("before,after,label\nbefore.nii.gz,none.nii.gz,2", "there is no file or folder 'none.nii.gz'"),
        ("before,after\nbefore.nii.gz,after.nii.gz", "give --label"),
        (
            "case,before,after,label,days\na,before.nii.gz,after.nii.gz,2,x",
            "days cannot be 'x'; write a number of days",
        ),
        ("case,before,after,label\n" + "a,before.nii.gz,after.nii.gz,2\n" * 2, "two cases would write a/change.csv"),
        ("case,before,after,label\nchanges,before.nii.gz,after.nii.gz,2", "would write the combined table"),
    ],
)
def test_a_manifest_that_is_wrong_is_refused_before_the_start(refused, pair, tmp_path, text, sentence):
    path = pair / "wrong.csv"
    path.write_text(text, "utf-8")
    assert sentence in refused("batch", "--pairs", path, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_pairs_take_a_manifest_and_no_flags_of_surfaces(misused, pair, tmp_path):
    assert "takes a .csv" in misused("batch", "--pairs", pair / "before.nii.gz", "-o", tmp_path / "out", "--label", 2)
    assert "leave out --html" in misused("batch", "--pairs", pair / "x.csv", "-o", tmp_path / "out", "--html")
