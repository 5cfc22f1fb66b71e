# SPDX-License-Identifier: GPL-3.0-or-later
import csv
import json
import math
import re

import pytest

from ctmc_addon import readers
from ctmc_addon.cli import main
from ctmc_addon.cli.experiment.plot import ticks
from ctmc_addon.cli.experiment.table import as_csv
from ctmc_addon.core import ReconstructionSettings, reconstruct
from ctmc_addon.core.mesh import surface_distance

pytestmark = pytest.mark.usefixtures("scene")
SOFT = ["--label", "2", "--soften", "2"]
FILES = ["plot.png", "table.csv", "table.json", "table.md"]


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def rows_in(folder):
    return json.loads((folder / "table.json").read_text("utf-8"))


def is_png(path):
    return path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def segmentation(phantom_folder):
    return phantom_folder / "segmentation-4.nii.gz"


@pytest.fixture(scope="module")
def voxels(phantom_folder, tmp_path_factory):
    """Table 1 of a volume with its labels beside it, in a folder whose parents are made."""
    folder = tmp_path_factory.mktemp("voxels") / "new" / "table 1"
    words = ["--strides", "1", "2", "3", "2x1", "1x2", "2", "--repeats", "3", "--stride", "1", "1", "2", *SOFT]
    assert main(["experiment", "voxels", str(phantom_folder / "volume-4.nii.gz"), "-o", str(folder), *words]) == 0
    return folder


@pytest.mark.once
def test_voxels_writes_a_row_for_every_side_and_nothing_else(voxels):
    assert names_in(voxels) == FILES
    assert is_png(voxels / "plot.png")
    rows = rows_in(voxels)
    assert [row["stride"] for row in rows] == [1, 2, 3, "2x1", "1x2"]
    assert [row["sides_px"] for row in rows] == [[1, 1, 2], [2, 2, 2], [3, 3, 2], [2, 1, 2], [1, 2, 2]]
    for row in rows:
        assert set(row) >= {"stride", "seconds", "improved_percent", "voxels", "faces", "mean_mm", "max_mm"}
        assert sorted(row["runs"])[1] == row["seconds"]
        assert row["improved_percent"] == pytest.approx(100 * (1 - row["seconds"] / rows[0]["seconds"]))
    assert rows[0]["improved_percent"] == rows[0]["mean_mm"] == rows[0]["max_mm"] == 0


def test_voxels_counts_and_measures_what_python_reconstructs(voxels, segmentation):
    volume = readers.read_volume(segmentation)
    results = [
        reconstruct(volume, ReconstructionSettings(label=2, smoothing_mm=2, stride=(side, side, 2)))
        for side in (1, 2, 3)
    ]
    for row, result in zip(rows_in(voxels), results, strict=False):
        assert (row["faces"], row["voxels"]) == (len(result.mesh.faces), result.voxels_visited)
        assert row["volume_mm3"] == result.mesh.volume
        if row["stride"] > 1:
            apart = surface_distance(result.mesh, results[0].mesh)
            assert (row["mean_mm"], row["max_mm"]) == (apart.mean, apart.largest)


def test_larger_voxels_are_fewer_have_fewer_triangles_and_lie_farther_off(voxels):
    one, two, three, two_by_one, one_by_two = rows_in(voxels)
    assert one["voxels"] > two["voxels"] > three["voxels"]
    assert one["faces"] > two_by_one["faces"] > two["faces"] > three["faces"]
    assert two_by_one["voxels"] == one_by_two["voxels"]
    assert 0 < two["mean_mm"] < three["mean_mm"] < three["max_mm"]
    assert two["mean_mm"] < two["max_mm"] < 2 * math.hypot(*two["sides_mm"][:2])


def test_the_table_says_what_was_measured_where_and_how(voxels):
    text = (voxels / "table.md").read_text("utf-8")
    for word in (
        "segmentation-4", "--label 2 --stride 1 1 2 --smoothing-mm 2", "median of 3 runs", "extracting the surface",
        "20000 points", "seed 0", "cores", "Blender", "NumPy", "![",
    ):  # fmt: skip
        assert word in text
    table = [line for line in text.splitlines() if line.startswith("|")]
    assert len(table) == 2 + 5
    assert len({len(re.findall(r"(?<!\\)\|", line)) for line in table}) == 1


def test_the_csv_has_the_rows_of_the_json(voxels):
    with (voxels / "table.csv").open(encoding="utf-8", newline="") as file:
        read = list(csv.DictReader(file))
    for flat, row in zip(read, rows_in(voxels), strict=True):
        assert flat["stride"] == str(row["stride"])
        assert float(flat["seconds"]) == row["seconds"]
        assert [float(flat[f"runs_{run}"]) for run in (1, 2, 3)] == row["runs"]
        assert flat["machine"] == row["machine"]


def test_no_file_says_where_it_was_made_or_on_which_machine(voxels, phantom_folder):
    import platform

    for name in FILES[1:]:
        text = (voxels / name).read_text("utf-8")
        assert platform.node() not in text or len(platform.node()) < 4
        assert str(phantom_folder) not in text


def test_the_side_of_one_pixel_is_always_measured(ctmc, segmentation, tmp_path):
    words = ["--strides", "3", "--repeats", "1", "--label", "1", "-o", tmp_path / "t"]
    outcome = ctmc("experiment", "voxels", segmentation, *words)
    assert outcome.code == 0, outcome.errors
    assert [row["stride"] for row in rows_in(tmp_path / "t")] == [1, 3]
    assert "Alpha has no effect" in outcome.out
    assert "one run of each, after one that is not counted" in outcome.out
    assert "improved, %" in outcome.out


def test_a_surface_that_is_open_has_no_volume(ctmc, phantom_folder, tmp_path):
    words = ["--strides", "2", "--repeats", "1", "--threshold", "-300", "-o", tmp_path / "t"]
    assert ctmc("experiment", "voxels", phantom_folder / "dicom", *words).code == 0
    assert [row["volume_mm3"] for row in rows_in(tmp_path / "t")] == [None, None]


def test_alpha_has_figure_8_in_numbers(ctmc, segmentation, tmp_path):
    words = [*SOFT, "--alphas", "0", "0.25", "1", "--no-pictures", "-o", tmp_path]
    outcome = ctmc("experiment", "alpha", segmentation, *words)
    assert outcome.code == 0, outcome.errors
    assert names_in(tmp_path) == FILES
    rows = rows_in(tmp_path)
    assert [row["alpha"] for row in rows] == [0, 0.25, 1]
    assert len({row["faces"] for row in rows}) == 1
    roughness = [row["roughness_deg"] for row in rows]
    assert roughness == sorted(roughness, reverse=True)  # a softened label is smooth
    assert rows[0]["mean_mm"] > rows[1]["mean_mm"] > rows[2]["mean_mm"] == 0
    assert all(0 < row["shape_worst"] < row["shape_mean"] <= 1 for row in rows)
    angles = [row["smallest_angle_deg"] for row in rows]
    assert angles[0] > angles[1] > angles[2] > 0
    assert all((row["below_5_deg"] > 0) == (row["smallest_angle_deg"] < 5) for row in rows)
    assert all(1 < row["median_radius_ratio"] < 2 for row in rows)


@pytest.mark.once
def test_alpha_has_a_picture_of_every_alpha(ctmc, segmentation, small_pictures, tmp_path):
    outcome = ctmc("experiment", "alpha", segmentation, *SOFT, "--alphas", "0.25", "-o", tmp_path)
    assert outcome.code == 0, outcome.errors
    assert names_in(tmp_path) == sorted([*FILES, "alpha-0.25.png"])
    assert all(is_png(path) for path in tmp_path.glob("*.png"))
    assert "(alpha-0.25.png)" in (tmp_path / "table.md").read_text("utf-8")


def test_alpha_measures_the_simplified_surface_where_that_is_asked_for(ctmc, segmentation, tmp_path):
    words = [*SOFT, "--alphas", "0", "1", "--simplify", "0.5", "--no-pictures", "-o", tmp_path]
    assert ctmc("experiment", "alpha", segmentation, *words).code == 0
    volume = readers.read_volume(segmentation)
    for row in rows_in(tmp_path):
        settings = ReconstructionSettings(label=2, smoothing_mm=2, reduction=0.5, alpha=row["alpha"])
        assert row["faces"] == len(reconstruct(volume, settings).mesh.faces)
        assert row["max_mm"] > 0


def test_simplify_sets_both_simplifiers_beside_each_other(ctmc, segmentation, tmp_path):
    words = [*SOFT, "--levels", "50", "90", "50", "--repeats", "1", "-o", tmp_path]
    outcome = ctmc("experiment", "simplify", segmentation, *words)
    assert outcome.code == 0, outcome.errors
    assert names_in(tmp_path) == FILES
    assert "one run of each" in outcome.out
    rows = rows_in(tmp_path)
    assert [(row["level_percent"], row["simplifier"]) for row in rows] == [
        (50, "built-in"), (50, "Decimate"), (90, "built-in"), (90, "Decimate"),
    ]  # fmt: skip
    for ours, theirs in (rows[:2], rows[2:]):
        assert abs(ours["faces"] - theirs["faces"]) <= 2
        assert ours["closed"]
        assert 0 < ours["mean_mm"] < ours["max_mm"]
    assert rows[0]["mean_mm"] < rows[2]["mean_mm"]
    assert rows[1]["mean_mm"] < rows[3]["mean_mm"]


def test_a_folder_that_holds_something_is_refused_unless_it_may_be_overwritten(ctmc, refused, segmentation, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    words = ["experiment", "simplify", segmentation, "--label", "2", "--levels", "50", "--repeats", "1", "-o", tmp_path]
    sentence = refused(*words)
    assert "notes.txt" in sentence
    assert "--overwrite" in sentence
    assert ctmc(*words, "--overwrite").code == 0
    assert names_in(tmp_path) == sorted([*FILES, "notes.txt"])
    assert (tmp_path / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["voxels", "--strides", "0"], "1 to 16"),
        (["voxels", "--strides", "1", "17"], "17"),
        (["voxels", "--repeats", "0"], "repeats"),
        (["voxels", "--simplifier", "decimate", "--simplify", "0.5"], "decimate"),
        (["alpha", "--alphas", "1.5", "--soften", "1"], "from 0 to 1"),
        (["alpha"], "--smoothing"),
        (["simplify", "--levels", "100"], "0 to 99"),
        (["rotation", "--levels", "50", "100"], "0 to 99"),
        (["rotation", "--rounds", "0"], "rounds"),
        (["rotation", "--step", "0"], "1 to 180"),
        (["rotation", "--resolution", "0", "100"], "16 to 8192"),
        (["simplify", "--levels", "-1"], "0 to 99"),
    ],
)
def test_flags_that_cannot_be_measured_with_are_wrong_usage_and_leave_no_folder(
    misused, segmentation, tmp_path, words, said
):
    out = tmp_path / "out"
    assert said in misused("experiment", words[0], segmentation, "--label", "2", "-o", out, *words[1:])
    assert not out.exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["voxels", "--label", "7"], "label 7"),
        (["voxels", "--label", "2", "--min-part", "9e9"], "no component has a volume of 9000000 ml or more"),
        (["alpha", "--threshold", "9"], "threshold"),
        (["simplify", "--threshold", "9"], "threshold"),
        (["rotation", "--threshold", "9"], "threshold"),
    ],
)
def test_no_surface_at_these_settings_is_refused_and_leaves_no_folder(refused, segmentation, tmp_path, words, said):
    assert said in refused("experiment", words[0], segmentation, *words[1:], "-o", tmp_path / "new" / "t")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "mine").mkdir()
    assert said in refused("experiment", words[0], segmentation, *words[1:], "-o", tmp_path / "mine")
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]  # it was there before


def test_a_word_that_is_no_side_is_a_usage_error(ctmc, segmentation, tmp_path):
    outcome = ctmc("experiment", "voxels", segmentation, "-o", tmp_path, "--strides", "2y1")
    assert outcome.code == 2
    assert "not a stride" in outcome.errors[-1]


@pytest.mark.parametrize("most", [1e-6, 0.0037, 0.83, 1.0, 9.99, 4211.0])
def test_an_axis_ends_at_the_first_mark_that_holds_the_highest_bar(most):
    marks = ticks(most)
    assert marks[0] == 0
    assert marks[-2] < most <= marks[-1] * (1 + 1e-9)
    assert 4 <= len(marks) <= 8


def test_lists_become_columns_even_where_rows_differ():
    assert as_csv([{"a": [1, 2]}, {"a": [3], "b": None}]) == "a_1,a_2,b\n1,2,\n3,,\n"
