# SPDX-License-Identifier: GPL-3.0-or-later
import argparse
import re

import pytest

from ctmc_addon.cli.flags.arguments import (
    Parser,
    UsageError,
    add_settings,
    command_of,
    flag_of,
    kinds_of,
    overridden,
    settings_from,
)
from ctmc_addon.cli.flags.described import help_of, metavar_of
from ctmc_addon.core import ReconstructionSettings, descriptions
from ctmc_addon.core.settings import SETTINGS


def parsed(line):
    parser = Parser(exit_on_error=False)
    add_settings(parser)
    return settings_from(parser.parse_args(line.split()))


def test_every_setting_has_its_flag_with_text_and_limits():
    flags = {name: flag_of(name, about) for name, about in SETTINGS.items()}
    assert set(flags.values()) == {
        "--threshold", "--upper", "--label", "--stride", "--alpha", "--min-angle", "--topology", "--smoothing",
        "--smoothing-mm", "--slice-steps", "--interfaces", "--close-border", "--region",
        "--region-unit", "--keep-parts", "--min-part", "--normals", "--simplifier", "--simplify", "--triangles",
        "--max-error", "--nan-as",
    }  # fmt: skip
    parser = argparse.ArgumentParser()
    add_settings(parser)
    shown = " ".join(parser.format_help().split())
    for name, about in SETTINGS.items():
        assert flags[name] in shown
        assert about.text.split(". ")[0][:40] in shown


def test_a_flags_value_is_named_by_a_word_or_its_parts():
    names = {
        metavar_of(about)
        for kind in (ReconstructionSettings, *kinds_of("reading"))
        for about in descriptions(kind).values()
    }
    assert "ALPHA" in names
    assert not [name for name in names if re.search(r"[^A-Z0-9 /]", name)]


def test_the_help_says_unit_limits_and_default():
    assert help_of(SETTINGS["stride"], (1, 1, 1)).endswith("(px; from 1 to 16; default 1 1 1)")
    assert help_of(SETTINGS["reduction"], None).endswith("(at least 0 and below 1)")


@pytest.mark.parametrize(
    "settings",
    [
        ReconstructionSettings(),
        ReconstructionSettings(threshold=-200.5, stride=(2, 2, 1), alpha=0.25, smoothing_mm=1.5, close_border=True),
        ReconstructionSettings(label=2, region=(-1.5, 0, 2, 30, 40.25, 50), region_unit="mm", keep_parts=3),
        ReconstructionSettings(min_part_mm3=12.5, normals="mesh", simplifier="decimate", reduction=0.9),
        ReconstructionSettings(target_faces=1000, nan_as=-1024.0),
        ReconstructionSettings(max_error_mm=0.1),
    ],
)
def test_the_flags_of_settings_give_the_settings_back(settings):
    assert parsed(command_of(settings)) == settings


def test_one_number_stands_for_three():
    assert parsed("--stride 2").stride == (2, 2, 2)
    assert parsed("--stride=3 --alpha 0").stride == (3, 3, 3)
    assert parsed("--stride 2 2 1").stride == (2, 2, 1)


def test_a_value_outside_its_limits_is_wrong_usage():
    with pytest.raises(argparse.ArgumentError, match="--alpha: must be from 0 to 1 or auto, not 2"):
        parsed("--alpha 2")
    with pytest.raises(UsageError, match="max_error_mm is not possible with simplifier decimate"):
        parsed("--simplifier decimate --max-error 1")


@pytest.mark.parametrize(("word", "number"), [("-2e2", -200.0), ("-.5", -0.5), ("-1E+3", -1000.0), ("-7", -7.0)])
def test_a_negative_number_is_not_a_flag_in_any_spelling(word, number):
    assert parsed(f"--threshold {word}").threshold == number
    parser = Parser()
    parser.add_argument("--seed", nargs=4)
    assert parser.parse_args(["--seed", "tumor", word, word, "3"]).seed == ["tumor", word, word, "3"]


@pytest.mark.parametrize("word", ["-200,5", "200,5"])
def test_a_decimal_comma_is_refused_with_how_numbers_are_written(word):
    with pytest.raises(argparse.ArgumentError, match="write one number, with a decimal point"):
        parsed(f"--threshold {word}")


def test_what_is_not_a_number_is_not_the_flags():
    parser = Parser(exit_on_error=False)
    parser.add_argument("input")
    add_settings(parser, many=("label",))
    args = parser.parse_args(["--stride", "2", "ct"])
    assert (args.input, args.stride) == ("ct", (2, 2, 2))
    args = parser.parse_args(["--label", "1", "2", "ct", "--label", "7"])
    assert (args.input, args.label) == ("ct", [1, 2, 7])
    args = parser.parse_args(["--region", "-1", "0", "0.5", "3", "4", "5", "9"])
    assert (args.input, args.region) == ("9", (-1, 0, 0.5, 3, 4, 5))


def test_the_first_word_may_name_a_command_below():
    parser = Parser(prog="figure")
    parser.add_argument("input")
    parser.add_command("sheet", "side by side").add_argument("--columns", type=int)
    assert vars(parser.parse_args(["sheet", "--columns", "2"])).keys() == {"columns", "parser"}
    assert parser.parse_args(["./sheet"]).input == "./sheet"


def test_the_older_name_of_the_gaussians_width_is_understood():
    assert parsed("--label 2 --soften 1.5") == ReconstructionSettings(label=2, smoothing_mm=1.5)
    assert parsed("--label 2 --soften 0").smoothing_method == "none"
    file = {"label": 2, "smoothing_mm": 1.5}
    assert overridden(file, {"smoothing": "constrained"}) == {"label": 2, "smoothing": "constrained"}
    assert overridden({"label": 2, "smoothing": "constrained"}, {"smoothing_mm": 1}) == {"label": 2, "smoothing_mm": 1}


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("--treshold 3", "unrecognized arguments: --treshold 3; did you mean --threshold?"),
        ("--label liver spleen", "unrecognized arguments: spleen; separate label names by commas"),
        ("--stride 2 2 1 spleen", "unrecognized arguments: spleen\n"),
    ],
)
def test_what_is_not_understood_is_refused_with_what_was_meant(capsys, line, words):
    parser = Parser()
    add_settings(parser, many=("label",))
    with pytest.raises(SystemExit):
        parser.parse_args(line.split())
    assert words in capsys.readouterr().err
