# SPDX-License-Identifier: GPL-3.0-or-later
"""`--alpha auto` on the command line, in a settings file, for several labels and in a batch."""

import json

import numpy as np
import pytest

from ctmc_addon.core import ReconstructionSettings, Volume, length_text, reconstruct
from ctmc_addon.reporting.command_line import command_of
from ctmc_addon.reporting.settings_toml import from_toml, to_toml

SPACING = ("--spacing", "0.7", "0.8", "2.5")


@pytest.fixture
def labels_file(tmp_path):
    """Two ellipsoids, labels 1 and 2."""
    z, y, x = np.indices((12, 14, 30))
    values = np.zeros(z.shape, np.uint8)
    values[(x - 7) ** 2 + (y - 7) ** 2 + 2 * (z - 6) ** 2 < 30] = 1
    values[(x - 21) ** 2 / 2 + (y - 6) ** 2 + 3 * (z - 6) ** 2 < 20] = 2
    np.save(tmp_path / "organs.npy", values)
    return tmp_path / "organs.npy"


def made(ctmc, tmp_path, name, labels_file, *words):
    """The bytes, the report and the summary of a surface."""
    out, report = tmp_path / f"{name}.stl", tmp_path / f"{name}.json"
    done = ctmc("reconstruct", labels_file, *SPACING, "-o", out, "--report", report, *words)
    assert (done.code, done.errors) == (0, [])
    return out.read_bytes(), json.loads(report.read_text("utf-8")), " ".join(done.out.split())


@pytest.mark.parametrize("more", [(), ("--simplify", "0.5"), ("--min-angle", "12")])
def test_auto_writes_the_bytes_of_the_number_that_it_says(ctmc, tmp_path, labels_file, more):
    auto, report, said = made(ctmc, tmp_path, "auto", labels_file, "--label", "2", "--alpha", "auto", *more)
    alpha = report["alpha"]
    assert 0 < alpha < 1
    hand, by_hand, _ = made(ctmc, tmp_path, "hand", labels_file, "--label", "2", "--alpha", alpha, *more)
    assert auto == hand
    assert (by_hand["alpha"], by_hand["alpha_choice"]) == (alpha, None)
    assert report["alpha_choice"]["min_angle_deg"] == (12 if "12" in more else 5)
    assert f"Alpha {alpha:g} was chosen: the largest at which no triangle of the full surface" in said
    assert f"settings: --label 2 --alpha auto{' --min-angle 12' if '12' in more else ''} " in said
    assert "threshold" not in said.partition("note")[0]  # a label has none
    if not more:
        words = ("--label", "2", "--alpha", f"{alpha + 0.001:.3f}")
        assert made(ctmc, tmp_path, "above", labels_file, *words)[1]["smallest_angle_deg"] < 5
        assert report["smallest_angle_deg"] >= 5


def test_a_settings_file_takes_auto_and_an_angle(ctmc, tmp_path, labels_file):
    settings = ReconstructionSettings(label=2, alpha="auto", min_angle_deg=8)
    file = tmp_path / "auto.toml"
    file.write_text(to_toml(settings), "utf-8")
    assert 'alpha = "auto"\n' in file.read_text("utf-8")
    assert ReconstructionSettings(**from_toml(file.read_text("utf-8"))) == settings
    by_file, report, _ = made(ctmc, tmp_path, "file", labels_file, "--settings", file)
    by_flags, _, _ = made(ctmc, tmp_path, "flags", labels_file, "--label", "2", "--alpha", "auto", "--min-angle", "8")
    assert by_file == by_flags
    assert report["smallest_angle_deg"] >= 8


def test_several_labels_have_a_row_each_with_its_alpha_and_cost(ctmc, tmp_path, labels_file):
    out, report = tmp_path / "out", tmp_path / "all.json"
    words = ("--label", "all", "--interfaces", "separate", "--alpha", "auto", "-o", f"{out}/", "--report", report)
    done = ctmc("reconstruct", labels_file, *SPACING, *words)
    assert (done.code, done.errors) == (0, [])
    assert "settings: --alpha auto --interfaces separate\n" in done.out
    rows = [line.split() for line in done.out.splitlines() if line.split()[-1:] and line.split()[0] in ("1", "2")]
    surfaces = json.loads(report.read_text("utf-8"))["surfaces"]
    volume = Volume(np.load(labels_file), np.diag([-0.7, -0.8, 2.5, 1]), kind="label")
    for row, surface in zip(rows, surfaces, strict=True):
        choice = surface["alpha_choice"]
        assert row[-3:] == [f"{choice['alpha']:g}", *length_text(choice["largest_mm"], 3).split()]
        alone = reconstruct(volume, ReconstructionSettings(label=surface["label"], alpha="auto"))
        assert choice["alpha"] == alone.settings.alpha


def test_a_batch_chooses_for_every_case(ctmc, tmp_path, labels_file):
    out = tmp_path / "out"
    words = ("--label", "2", "--alpha", "auto", "--no-thumbnails", "--jobs", "1", "-o", out)
    assert ctmc("batch", labels_file, *SPACING, *words).code == 0
    report = json.loads((out / "organs.json").read_text("utf-8"))
    assert 0 < report["alpha_choice"]["alpha"] == report["alpha"] < 1
    assert report["smallest_angle_deg"] >= 5


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--alpha", "best"), "argument --alpha: write a number or auto"),
        (("--alpha", "auto", "--min-angle", "61"), "--min-angle: must be above 0 and at most 60, not 61"),
    ],
)
def test_what_cannot_be_chosen_is_wrong_usage(misused, labels_file, tmp_path, words, sentence):
    assert sentence in misused("reconstruct", labels_file, *words, "--label", "1", "-o", tmp_path / "a.stl")


def test_a_command_has_the_angle_only_where_alpha_is_chosen():
    assert command_of(ReconstructionSettings(label=2, alpha="auto", min_angle_deg=8)) == (
        "--label 2 --alpha auto --min-angle 8"
    )
    assert command_of(ReconstructionSettings(label=2, alpha=0.7, min_angle_deg=8)) == "--label 2 --alpha 0.7"
