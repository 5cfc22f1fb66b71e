# SPDX-License-Identifier: GPL-3.0-or-later
"""`ctmc figure`, `figure sheet` and `figure turntable` as a user runs them."""

from __future__ import annotations

import pytest

pytest.importorskip("bpy", reason="the Python package bpy is not installed")
Image = pytest.importorskip("PIL.Image")

SMALL = ("--dpi", 60, "--soften", 2)


@pytest.fixture
def ct(phantom_folder):
    return phantom_folder / "volume-4.nii.gz"


def test_one_command_makes_a_figure_and_its_blend(ctmc, ct, tmp_path):
    target = tmp_path / "Bilder 图" / "deep" / "tumour.png"
    done = ctmc("figure", ct, "--label", 2, *SMALL, "--width-mm", 50, "-o", target)
    assert done.code == 0, done.errors
    assert sorted(one.name for one in target.parent.iterdir()) == ["tumour.blend", "tumour.png"]
    with Image.open(target) as image:
        assert image.width == round(50 / 25.4 * 60)
        assert image.info["dpi"][0] == pytest.approx(60, abs=0.02)
    assert "50 x " in done.out
    assert "tumour.png, tumour.blend" in done.out


def test_several_labels_stand_in_one_figure(ctmc, ct, tmp_path):
    words = ("--label", 1, 2, "--names", "liver", "tumors", "--transparent", "--no-blend", "--caption", "")
    done = ctmc("figure", *words[:3], ct, *words[3:], *SMALL, "-o", tmp_path / "a.png")
    assert done.code == 0, done.errors
    assert [one.name for one in tmp_path.iterdir()] == ["a.png"]
    with Image.open(tmp_path / "a.png") as image:
        assert image.mode == "RGBA"


@pytest.mark.once
def test_a_sheet_prints_what_its_captions_say(ctmc, ct, tmp_path):
    words = ("--label", 2, "--strides", 1, 2, "--levels", 0, 50, "--dpi", 40, "--soften", 2, "--deviation")
    done = ctmc("figure", "sheet", ct, *words, "-o", tmp_path / "sheet.png")
    assert done.code == 0, done.errors
    for letter, title in zip("abcd", [1, 1, 2, 2], strict=True):
        assert f"({letter}) stride {title} px = " in done.out
    assert (tmp_path / "sheet.blend").exists()


def test_a_turntable_becomes_a_film(ctmc, ct, tmp_path):
    words = ("--label", 2, "--seconds", 0.5, "--fps", 6, "--dpi", 36, "--width-mm", 30, "--soften", 2, "--no-blend")
    done = ctmc("figure", "turntable", ct, *words, "-o", tmp_path / "new" / "a.mp4")
    assert done.code == 0, done.errors
    assert [one.name for one in (tmp_path / "new").iterdir()] == ["a.mp4"]
    assert "3 frames" in done.out


def test_a_film_that_is_there_is_neither_replaced_nor_made_again_without_a_word(ctmc, refused, ct, tmp_path):
    words = ("--label", 2, "--seconds", 0.5, "--fps", 6, "--dpi", 36, "--width-mm", 30, "--soften", 2, "--no-blend")
    film = tmp_path / "a.mp4"
    film.write_bytes(b"mine")
    sentence = refused("figure", "turntable", ct, *words, "-o", film)
    assert "a.mp4 already exists; replace it (--overwrite)" in sentence
    done = ctmc("figure", "turntable", ct, *words, "-o", film, "--resume")
    assert (done.code, done.errors) == (0, [])
    assert "a.mp4 already exists and was not changed" in done.out
    assert film.read_bytes() == b"mine"
    assert ctmc("figure", "turntable", ct, *words, "-o", film, "--overwrite").code == 0
    assert film.stat().st_size > 1000
    assert [one.name for one in tmp_path.iterdir()] == ["a.mp4"]


@pytest.mark.parametrize("kind", [(), ("turntable", "--seconds", 1, "--fps", 3)])
def test_a_map_is_shown_with_its_numbers(ctmc, ct, tmp_path, kind):
    image = pytest.importorskip("PIL.Image")
    words = ("--label", 2, "--stride", 3, 3, 1, "--angle", "--range", 0, 60, "--ramp", "magma", "--dpi", 60)
    output = tmp_path / ("turn" if kind else "a.png")
    done = ctmc("figure", *kind[:1], ct, *words, *kind[1:], "-o", output, "--no-blend", "--quiet")
    assert (done.code, done.errors) == (0, [])
    with image.open(output / "frame_00001.png" if kind else output) as picture:
        colors = {color for _, color in picture.convert("RGB").getcolors(1 << 20)}
    assert any(red > 200 and 60 < green < 180 and 60 < blue < 180 for red, green, blue in colors), "magma's middle"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("figure", "-o", "a.png", "--dpi", 1200), "--dpi: must be from 36 to 600, not 1200"),
        (("figure", "-o", "a.png", "--width-mm", 0), "--width-mm: must be from 20 to 400, not 0"),
        (("figure", "-o", "a.png", "--elevation", 100), "--elevation: must be from -90 to 90, not 100"),
        (("figure", "-o", "a.png", "--names", "a", "b"), "2 names for 1 surfaces"),
        (("figure", "-o", "a.png", "--label", 1, 2, "--deviation"), "a distance map shows one label, not 2"),
        (("figure", "-o", "a.png", "--label", 1, 2, "--opacity", "1=7"), "a share from 0 to 1"),
        (("figure", "sheet", "-o", "a.png"), "give one or two"),
        (("figure", "sheet", "-o", "a.png", "--levels", 100), "from 0 to 99"),
        (("figure", "sheet", "-o", "a.png", "--levels", 0, "--columns", 0), "--columns: must be 1 or more"),
        (("figure", "sheet", "-o", "a.png", "--strides", 17), "from 1 to 16, not 17"),
        (("figure", "turntable", "-o", "a.mp4", "--fps", 0), "from 1 to 120"),
        (("figure", "-o", "a.png", "--thickness", "--deviation"), "leave out --deviation, or the other maps"),
        (("figure", "-o", "a.png", "--ramp", "magma"), "need a map; add one of --paint, --thickness"),
        (("figure", "-o", "a.png", "--thickness", "--ramp", "jet"), "--ramp: invalid choice: 'jet'"),
    ],
)
def test_flags_that_make_no_figure_are_wrong_usage(misused, ct, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    count = 2 if words[1] in ("sheet", "turntable") else 1
    assert said in misused(*words[:count], ct, *words[count:])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("figure", "sheet", "-o", "a.png", "--label", 2, "--smoothing", "none", "--alphas", 0, 1),
            "a label that is not smoothed",
        ),
        (("figure", "-o", "a.jpg"), "a.jpg is not a .png"),
        (("figure", "-o", "a.png", "--blend", "a.stl"), "a.stl is not a .blend"),
        (("figure", "-o", "a.png", "--deviation", "--engine", "workbench"), "workbench"),
        (("figure", "-o", "a.png", "--angle", "--engine", "workbench"), "workbench shows no map"),
        (("figure", "-o", "a.png", "--label", 2, "--angle", "--show", "gap_mm"), "the maps are angle_deg"),
        (("figure", "-o", "a.png", "--label", 2, "--angle", "--range", 3, 1), "give two numbers, the lower one first"),
        (("figure", "-o", "a.png", "--label", 9), "9"),
        (("figure", "-o", "new/deep/a.png", "--label", 9, "--blend", "other/a.blend"), "9"),
        (("figure", "sheet", "-o", "new/a.png", "--label", 9, "--levels", 0), "9"),
        (("figure", "turntable", "-o", "a.gif"), ".gif is not a video"),
        (("figure", "turntable", "-o", ".", "--overwrite"), "and not a turntable"),
    ],
)
def test_what_makes_no_figure_is_refused_in_a_sentence(refused, ct, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.txt").write_text("kept")
    count = 2 if words[1] in ("sheet", "turntable") else 1
    assert said in refused(*words[:count], ct, *words[count:])
    assert [one.name for one in tmp_path.iterdir()] == ["mine.txt"]


@pytest.mark.parametrize("name", ["new/a.mp4", "new/a"])
def test_a_turntable_of_nothing_leaves_no_folder(ctmc, ct, tmp_path, name):
    done = ctmc("figure", "turntable", ct, "--label", 9, "-o", tmp_path / name)
    assert done.code == 1
    assert "label 9 is empty here" in done.errors[-1]
    assert list(tmp_path.iterdir()) == []


def test_help_names_the_commands(ctmc):
    listed = [line.split()[0] for line in ctmc("--help").out.splitlines() if line[:5].strip() and line[:4] == "    "]
    commands = ["info", "phantom", "foam", "segment", "reconstruct", "measure"]
    assert listed == [*commands, "batch", "experiment", "figure", "settings"]
    assert "ctmc figure sheet" in ctmc("figure", "--help").out
    assert "--revolutions" in ctmc("figure", "turntable", "--help").out
