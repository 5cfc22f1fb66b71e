# SPDX-License-Identifier: GPL-3.0-or-later
import json

import pytest

from ctmc_addon.blender.figure.spec import Comparison, FigureStyle
from ctmc_addon.cli.figure.common import style_of, values_of
from ctmc_addon.cli.flags.arguments import overridden, reading_of, tables
from ctmc_addon.cli.program import parser
from ctmc_addon.core import ReconstructionSettings
from ctmc_addon.core.settings import SETTINGS
from ctmc_addon.readers import ReadingOptions
from ctmc_addon.reporting.settings_toml import from_toml, to_toml

EXAMPLES = [
    ReconstructionSettings(),
    ReconstructionSettings(threshold=-200.5, stride=(2, 2, 1), alpha=0.25, smoothing_mm=1e-7, close_border=True),
    ReconstructionSettings(label=2, region=(-1.5, 0, 2, 30, 40.25, 50), region_unit="mm", keep_parts=3),
    ReconstructionSettings(min_part_mm3=12.5, normals="mesh", simplifier="decimate", reduction=0.9),
    ReconstructionSettings(max_error_mm=0.1, nan_as=-1024.0),
]


@pytest.mark.parametrize("settings", EXAMPLES)
def test_what_is_written_reads_back_as_the_same_settings(settings):
    assert ReconstructionSettings.from_dict(from_toml(to_toml(settings))) == settings


def test_every_setting_stands_there_with_its_text_in_plain_ascii():
    text = to_toml(ReconstructionSettings())
    shown = " ".join(text.replace("\n#", "").split())
    for name, about in SETTINGS.items():
        assert f"{name} = " in text
        assert " ".join(about.text.split()[:8]) in shown
    assert text.isascii()  # whatever a terminal's own letters are
    assert max(map(len, text.splitlines())) <= 100


def test_a_line_without_its_comment_sign_is_a_valid_setting():
    for line in to_toml(ReconstructionSettings()).splitlines():
        if line.startswith("# ") and " = " in line and line[2:].split(" = ")[0] in SETTINGS:
            name, value = line[2:].split(" = ")
            if name != "region":  # six noughts are no box
                assert list(from_toml(f"{name} = {value}")) == [name]


def test_settings_are_printed_and_read_back(ctmc, tmp_path):
    flags = ["--label", "2", "--stride", "2", "2", "1", "--soften", "1.5", "--close-border"]
    (tmp_path / "a.toml").write_text(ctmc("settings", *flags).out, "ascii")
    again = ctmc("settings", "--settings", tmp_path / "a.toml")
    assert again.code == 0
    assert again.out == (tmp_path / "a.toml").read_text("ascii")


def test_flags_win_over_the_file_and_replace_its_alternatives(ctmc, tmp_path):
    (tmp_path / "a.toml").write_text("label = 2\nreduction = 0.5\nclose_border = true\nalpha = 0.5\n")
    words = ["--threshold", "300", "--triangles", "100", "--no-close-border"]
    outcome = ctmc("settings", "--settings", tmp_path / "a.toml", *words)
    expected = ReconstructionSettings(threshold=300, target_faces=100, alpha=0.5).to_dict()
    assert from_toml(outcome.out, tables=tables()) == expected | {"reading": {}, "figure": {}}
    assert overridden({"label": 1}, {"alpha": 0.5}) == {"label": 1, "alpha": 0.5}


@pytest.mark.parametrize("coding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_file_may_come_from_any_shell(ctmc, tmp_path, coding):
    text = to_toml(ReconstructionSettings(label=3)).replace("\n", "\r\n")
    (tmp_path / "a.toml").write_bytes(text.encode(coding))
    assert from_toml(ctmc("settings", "--settings", tmp_path / "a.toml").out, tables=tables())["label"] == 3


@pytest.mark.usefixtures("scene")
def test_reconstruct_takes_the_file(ctmc, phantom_folder, tmp_path):
    (tmp_path / "a.toml").write_text("label = 2\nsmoothing_mm = 1\n")
    words = ["-o", tmp_path / "a.stl", "--report", tmp_path / "a.json", "--settings", tmp_path / "a.toml"]
    outcome = ctmc("reconstruct", phantom_folder / "volume-4.nii.gz", *words, "--alpha", "0.5")
    assert outcome.code == 0, outcome.errors
    expected = ReconstructionSettings(label=2, smoothing_mm=1, alpha=0.5)
    assert json.loads((tmp_path / "a.json").read_text("utf-8"))["settings"] == expected.to_dict()


def test_how_a_ct_is_read_and_a_figure_looks_may_stand_in_the_file(ctmc, tmp_path):
    file = tmp_path / "a.toml"
    file.write_text("alpha = 0.5\n[figure]\nazimuth = 90\nstrides = [[1, 1], [2, 1]]\n[reading]\nspacing = [1, 2, 3]\n")
    printed = ctmc("settings", "--settings", file, "--flip", "z").out
    assert from_toml(printed, tables=tables()) == ReconstructionSettings(alpha=0.5).to_dict() | {
        "reading": {"spacing": (1.0, 2.0, 3.0), "flip": "z"},
        "figure": {"azimuth": 90.0, "strides": ((1, 1), (2, 1))},
    }
    file.write_text(printed)
    args = parser().parse_args(["figure", "sheet", "ct.npy", "-o", "a.png", "--settings", str(file), "--spacing", "4"])
    assert reading_of(args) == ReadingOptions(spacing=4, flip="z")
    assert style_of(args) == FigureStyle(azimuth=90)
    assert values_of(args, Comparison) == {"strides": ((1, 1), (2, 1))}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("alpha = x", "not TOML: Invalid value (at line 1, column 9)"),
        ("alfa = 1", "unknown setting 'alfa'; the settings are threshold"),
        ("alpha = 2", "alpha must be from 0 to 1 or auto, not 2"),
        ('alpha = "1"', "alpha must be from 0 to 1 or auto, not '1'"),
        ("alpha = true", "alpha must be a number, not True"),
        ("alpha = [1]", "alpha must be a number"),
        ('close_border = "false"', "true or false, not 'false'"),
        ("close_border = 1", "true or false"),
        ("stride = [1, 2]", "takes 3 numbers"),
        ('stride = "2"', "3 numbers in brackets"),
        ("normals = 3", "a word in quotes"),
        ("[alpha]\nx = 1", "alpha must be a number"),
        ("label = 2\nthreshold = 5", "choose one"),
        ("reading = 1", "reading is a table, [reading] on a line of its own, not 1"),
        ("[reading]\nspace = 1", "unknown setting 'space' in [reading]; its settings are spacing, flip, series, time"),
        ("[reading]\nallow_outside = true", "unknown setting '--allow-outside' in [reading]"),
        ("[reading]\ntime = 0", "time must be 1 or more, not 0"),
        ("[reading]\nseries = 2", "series must be a word in quotes, not 2"),
        ("[figure]\ndpi = 9", "dpi must be from 36 to 600, not 9"),
        ("[figure]\nlevels = 50", "levels must be a list in brackets, not 50"),
        ('[figure]\nstrides = ["2x1"]', "strides must be 2 numbers in brackets"),
    ],
)
def test_a_bad_file_is_named_with_what_is_wrong(refused, tmp_path, text, words):
    (tmp_path / "bad.toml").write_text(text)
    sentence = refused("settings", "--settings", tmp_path / "bad.toml")
    assert "bad.toml" in sentence
    assert words in sentence


def test_a_missing_file_and_noise_are_said(refused, tmp_path):
    assert "cannot be read" in refused("settings", "--settings", tmp_path / "none.toml")
    (tmp_path / "noise.toml").write_bytes(bytes(range(128, 256)))
    assert "is not text" in refused("settings", "--settings", tmp_path / "noise.toml")
