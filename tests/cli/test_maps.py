# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps from the command line: flags, tables, files, and a batch's manifest."""

from __future__ import annotations

import csv
import json

import nibabel
import numpy as np
import pytest

from ctmc_addon.core.maps.quantities import QUANTITIES


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """Labels of two boxes in voxels of 1 x 1 x 2 mm, and a volume of other voxels whose value is x + 2 y - z in mm."""
    folder = tmp_path_factory.mktemp("maps")
    labels = np.zeros((12, 20, 24), np.uint8)
    labels[3:9, 4:14, 4:14], labels[3:9, 4:14, 14:20] = 1, 2
    nibabel.save(nibabel.Nifti1Image(labels.T, np.diag([1.0, 1.0, 2.0, 1.0])), folder / "labels.nii")
    x, y, z = np.meshgrid(np.arange(30) * 1.5 - 5, np.arange(30) * 1.5 - 5, np.arange(30) * 1.5 - 5, indexing="ij")
    affine = np.diag([1.5, 1.5, 1.5, 1.0])
    affine[:3, 3] = -5
    nibabel.save(nibabel.Nifti1Image((x + 2 * y - z).astype(np.float32), affine), folder / "field.nii")
    return folder


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_every_quantity_has_a_flag_in_every_command_that_makes_surfaces(ctmc):
    for command in ("reconstruct", "measure", "batch", "figure"):
        words = ctmc(command, "--help").out
        for kind in QUANTITIES:
            assert f"--{kind.flag}" in words, (command, kind.flag)


def test_a_table_has_the_values_of_a_linear_field_at_every_vertex(ctmc, case, tmp_path):
    done = ctmc(
        *("reconstruct", case / "labels.nii", "--label", "1", "--paint", f"field={case / 'field.nii'}"),
        *("--map-limit", "field", "10", "none", "-o", tmp_path / "a.ply"),
        *("--map-table", tmp_path / "a.csv", "--report", tmp_path / "a.json"),
    )
    assert done.code == 0, done.errors
    rows = rows_of(tmp_path / "a.csv")
    assert list(rows[0]) == ["x_mm", "y_mm", "z_mm", "field"]
    x, y, z, field = (np.array([float(row[name]) for row in rows]) for name in rows[0])
    np.testing.assert_allclose(field, x + 2 * y - z, atol=1e-3 * np.ptp(field))
    report = json.loads((tmp_path / "a.json").read_text("utf-8"))
    assert len(rows) == report["vertices"]
    assert report["field"]["median"] == pytest.approx(np.median(field), abs=1e-4)
    assert 0 < report["field"]["share_below"] < 1
    assert report["field"]["share_above"] is None
    assert report["maps"][0]["limits"] == [10.0, None]
    assert "field" in done.out
    assert (tmp_path / "a.ply").read_bytes().split(b"end_header")[0].count(b"property float field") == 1


def test_measure_has_the_numbers_of_each_label(ctmc, case, tmp_path):
    words = ("--label", "all", "--paint", f"field={case / 'field.nii'}", "-o", tmp_path / "a.csv")
    done = ctmc("measure", case / "labels.nii", *words)
    assert done.code == 0, done.errors
    rows = rows_of(tmp_path / "a.csv")
    names = [f"field_{name}" for name in ("min", "p5", "median", "mean", "p95", "max", "share_without")]
    assert [name for name in rows[0] if name.startswith("field_")][:7] == names
    # The mean of a linear field over a box's surface is its value in the middle: (8.5, 8.5, 11) and (16.5, 8.5, 11).
    assert [float(row["field_mean"]) for row in rows] == pytest.approx([14.5, 22.5], abs=0.1)


def test_a_manifest_asks_for_maps_of_its_own(ctmc, case, tmp_path):
    manifest = case / "cases.csv"
    manifest.write_text(
        "input,case,label,paint,map-limit\nlabels.nii,one,1,field=field.nii,field 10 none\nlabels.nii,two,2,,\n",
        "utf-8",
    )
    out = tmp_path / "out"
    done = ctmc("batch", manifest, "-o", out, "--no-thumbnails", "--map-table", "--quiet")
    assert done.code == 0, done.errors
    one, two = rows_of(out / "summary.csv")
    assert float(one["field_mean"]) == pytest.approx(14.5, abs=0.1)
    assert two["field_mean"] == ""
    assert len(rows_of(out / "one-maps.csv")) == json.loads((out / "one.json").read_text("utf-8"))["vertices"]
    assert not (out / "two-maps.csv").exists()
    record = (out / "one.json").read_text("utf-8")
    assert json.loads(record)["asked_maps"]["quantities"] == [["paint", "field=field.nii"]]
    assert str(case) not in record
    again = ctmc("batch", manifest, "-o", out, "--no-thumbnails", "--map-table", "--quiet", "--resume")
    assert again.code == 0
    assert (out / "one.json").read_text("utf-8") == record


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (("--map-table", "a.csv"), 2, "limits, colors and a table of a map need a map; add one of --paint"),
        (("--map-limit", "dose", "1", "none"), 2, "limits, colors and a table of a map need a map; add one of --paint"),
        (("--paint", "dose"), 1, "--paint takes NAME=PATH, not 'dose'; such as --paint dose=RTDOSE.dcm"),
        (("--paint", "dose=nowhere.nii"), 1, "there is no file or folder 'nowhere.nii'; check the path"),
        (("--paint", "a={field}", "--map-limit", "b", "1", "2"), 1, "there is no map b; the maps are a"),
        (("--paint", "a={field}", "--paint", "A={field}"), 1, "two maps are called a; give each a name of its own"),
        (("--paint", "a={field}", "--map-limit", "a", "x", "2"), 2, "--map-limit takes a name and two numbers or none"),
        (
            ("--paint", "a={field}", "--simplifier", "decimate", "--simplify", "0.5"),
            2,
            "maps are made on surfaces of the built-in simplifier; leave out --simplifier decimate",
        ),
    ],
)
def test_what_makes_no_sense_is_refused_in_a_sentence(ctmc, case, tmp_path, words, code, message):
    given = [word.format(field=case / "field.nii") for word in words]
    given = [str(tmp_path / word) if word.endswith(".csv") else word for word in given]
    done = ctmc("reconstruct", case / "labels.nii", "--label", "1", *given, "-o", tmp_path / "a.ply")
    assert done.code == code
    assert message in done.errors[-1]
    assert "Traceback" not in "".join(done.errors)
    assert list(tmp_path.iterdir()) == []
