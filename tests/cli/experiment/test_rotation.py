# SPDX-License-Identifier: GPL-3.0-or-later
import csv
import json
import statistics

import pytest

from ctmc_addon.cli.experiment.rotation import engine_of
from ctmc_addon.core.errors import CtmcError

pytestmark = pytest.mark.usefixtures("scene")
SMALL = ["--rounds", "2", "--step", "60", "--resolution", "64", "48"]


def rows_in(folder):
    return json.loads((folder / "table.json").read_text("utf-8"))


@pytest.fixture(scope="module")
def segmentation(phantom_folder):
    return phantom_folder / "segmentation-4.nii.gz"


@pytest.fixture
def engine(scene):
    """The engine of this machine, as the tables name it."""
    from ctmc_addon.blender.rotation import can_draw

    return "Workbench" if can_draw() else "Cycles"


def test_rotation_has_a_row_for_every_level_with_its_rounds(ctmc, segmentation, tmp_path, engine):
    words = ["--label", "2", "--levels", "50", "90", *SMALL, "-o", tmp_path / "a" / "b"]
    outcome = ctmc("experiment", "rotation", segmentation, *words)
    assert outcome.code == 0, outcome.errors
    assert outcome.errors == []
    assert sorted(path.name for path in (tmp_path / "a" / "b").iterdir()) == [
        "plot.png", "table.csv", "table.json", "table.md",
    ]  # fmt: skip
    rows = rows_in(tmp_path / "a" / "b")
    assert [row["level_percent"] for row in rows] == [0, 50, 90]
    full = rows[0]["faces"]
    for row in rows:
        assert row["engine"] == engine
        assert (row["frames"], row["resolution"]) == (6, [64, 48])
        assert row["faces"] == pytest.approx(full * (1 - row["level_percent"] / 100), abs=2)
        assert len(row["rounds"]) == 2
        assert min(row["rounds"]) > 0
        assert row["average"] == pytest.approx(statistics.fmean(row["rounds"]))
        assert row["saved_percent"] == pytest.approx(100 * (1 - row["average"] / rows[0]["average"]))
        assert len(row["draw_rounds"]) == (2 if engine == "Workbench" else 0)
    text = (tmp_path / "a" / "b" / "table.md").read_text("utf-8")
    for word in (f"{engine}, off screen, 64 x 48 px", "6 frames, 60 degrees", "not timed", "no modifier and no key"):
        assert word in text
        assert word in outcome.out
    with (tmp_path / "a" / "b" / "table.csv").open(encoding="utf-8", newline="") as file:
        flat = list(csv.DictReader(file))
    assert [float(one["rounds_2"]) for one in flat] == [row["rounds"][1] for row in rows]


def test_a_step_that_does_not_divide_the_turn_is_said(ctmc, segmentation, tmp_path):
    words = ["--label", "2", "--levels", "0", "--rounds", "1", "--step", "110", "--resolution", "64", "48"]
    outcome = ctmc("experiment", "rotation", segmentation, *words, "-o", tmp_path)
    assert outcome.code == 0, outcome.errors
    assert "330 degrees about z: 3 frames, 110 degrees apart" in outcome.out
    assert "one turn" not in (tmp_path / "table.md").read_text("utf-8").lower()


@pytest.mark.parametrize("suffix", [".stl", ".glb", ".blend"])
def test_rotation_takes_a_mesh(ctmc, segmentation, tmp_path, suffix):
    mesh, report = tmp_path / f"tumour{suffix}", tmp_path / "report.json"
    assert ctmc("reconstruct", segmentation, "--label", "2", "-o", mesh, "--report", report).code == 0
    outcome = ctmc("experiment", "rotation", mesh, "--levels", "0", *SMALL, "-o", tmp_path / "t")
    assert outcome.code == 0, outcome.errors
    assert [row["faces"] for row in rows_in(tmp_path / "t")] == [json.loads(report.read_text())["faces"]]
    assert f"tumour{suffix}" in outcome.out


def test_cycles_draws_where_it_is_asked_for(ctmc, segmentation, tmp_path):
    words = ["--label", "2", "--levels", "90", "--engine", "cycles", "--rounds", "1", "--step", "120"]
    outcome = ctmc("experiment", "rotation", segmentation, *words, "-o", tmp_path / "t")
    assert outcome.code == 0, outcome.errors
    rows = rows_in(tmp_path / "t")
    assert [(row["engine"], row["resolution"], row["draw_average"]) for row in rows] == [
        ("Cycles", [160, 120], None)
    ] * 2


def test_a_machine_without_egl_gets_cycles_and_says_so(monkeypatch):
    monkeypatch.setattr("ctmc_addon.blender.rotation.can_draw", lambda: False)
    name, why = engine_of(None)
    assert name == "CYCLES"
    assert "no EGL" in why
    with pytest.raises(CtmcError, match="libegl1"):
        engine_of("workbench")


def test_a_mesh_that_is_none_and_settings_for_a_mesh_are_refused(refused, misused, tmp_path):
    out = tmp_path / "out"
    assert "check the path" in refused("experiment", "rotation", tmp_path / "no.stl", "-o", out)
    (tmp_path / "noise.stl").write_bytes(b"noise")
    assert "noise.stl" in refused("experiment", "rotation", tmp_path / "noise.stl", "-o", out)
    (tmp_path / "noise.blend").write_bytes(b"noise")
    assert "noise.blend" in refused("experiment", "rotation", tmp_path / "noise.blend", "-o", out)
    (tmp_path / "noise.glb").write_bytes(b"noise")
    assert "noise.glb" in refused("experiment", "rotation", tmp_path / "noise.glb", "-o", out)
    assert "leave --label out" in misused("experiment", "rotation", tmp_path / "noise.stl", "--label", "2", "-o", out)
    assert not out.exists()
