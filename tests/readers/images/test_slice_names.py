# SPDX-License-Identifier: GPL-3.0-or-later
"""Which pictures of a folder are slices: those of the largest run of names; what is left out is named."""

from __future__ import annotations

import imageio.v3 as iio
import numpy as np
import pytest
import tifffile
from PIL import Image

from ctmc_addon.core import CtmcError
from ctmc_addon.readers import read_volume

ENDS = [".bmp", ".png", ".jpg", ".jp2", ".tif"]


def save(folder, names, first=0):
    """Pictures of one value each: their number in the list."""
    folder.mkdir(exist_ok=True)
    for number, name in enumerate(names, first):
        plane = np.full((6, 5), number, np.uint8)
        if name.endswith(".jp2"):
            Image.fromarray(plane).save(folder / name, irreversible=False)
        elif name.endswith(".tif"):
            tifffile.imwrite(folder / name, plane)
        else:
            iio.imwrite(folder / name, plane)
    return folder


def slices_of(path):
    return read_volume(path).values[:, 0, 0].tolist()


def notes_with(path, words):
    return [note for note in read_volume(path).notes if words in note]


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize(
    "foreign",
    [
        "bone_rec_spr",
        "preview",
        "aaa",
        "bone_rec00000123 (1)",
        "bone_rec00000123_mask",
        "Copy of bone_rec00000123",
        "7",
    ],
)
def test_a_picture_of_another_name_is_left_out_and_named(tmp_path, end, foreign):
    save(tmp_path, [f"bone_rec{120 + number:08d}{end}" for number in range(8)])
    save(tmp_path, [foreign + end], first=99)
    assert slices_of(tmp_path) == list(range(8))
    (note,) = notes_with(tmp_path, "left out")
    slices = f"the 8 slices bone_rec00000120{end} to bone_rec00000127{end}"
    assert note == f"1 picture left out, not named like {slices}: {foreign}{end}"


def test_a_picture_left_out_is_not_opened(tmp_path):
    save(tmp_path, [f"s{number}.png" for number in range(4)])
    (tmp_path / "s_spr.png").write_bytes(b"no picture")
    iio.imwrite(tmp_path / "wide.png", np.zeros((2, 90), np.uint16))
    assert slices_of(tmp_path) == [0, 1, 2, 3]
    assert notes_with(
        tmp_path, "2 pictures left out, not named like the 4 slices s0.png to s3.png: s_spr.png, wide.png"
    )


def test_three_names_and_a_count_are_said(tmp_path):
    save(tmp_path, [f"s{number}.png" for number in range(12)])
    save(tmp_path, [f"{letter}.png" for letter in "abcde"])
    assert slices_of(tmp_path) == list(range(12))
    (note,) = notes_with(tmp_path, "5 pictures left out")
    assert note.endswith(": a.png, b.png, c.png and 2 more")


KEPT = {
    "unpadded": [f"slice_{number}" for number in range(1, 21)],
    "padded": [f"IM{number:04d}" for number in range(1, 12)],
    "numbers alone": [f"{number:03d}" for number in range(98, 103)],
    "copies by a browser": [f"img ({number})" for number in range(1, 21)],
    "two numbers": [f"scan2_z{number:03d}" for number in range(1, 9)],
    "a number behind": [f"z{number:03d}_ch0" for number in range(8)],
    "one date": [f"ct 2024-05-01 {number:03d}" for number in range(8)],
    "a time for each": [f"ct_20240501_1015{2 * number:02d}_{number:03d}" for number in range(8)],
    "times over a minute": [f"10.15.{number}" for number in range(50, 60)]
    + [f"10.16.{number:02d}" for number in range(9)],
    "positions": [f"s{number}_{number / 2:.1f}mm" for number in range(1, 12)],
    "numbers that go on": [f"part{1 + number // 5}_{number:03d}" for number in range(15)],
    "identifiers": [f"1.2.840.113619.2.55.{number}.9" for number in range(1, 12)],
    "both cases": [f"{'SL' if number % 2 else 'sl'}{number:02d}" for number in range(8)],
    "decimals": [f"slice_{number / 2:.1f}" for number in range(10)],
    "decimals with a comma": [f"slice_{number / 2:.1f}".replace(".", ",") for number in range(10)],
    "decimals from 0 on": [f"z{number / 4:.2f}mm" for number in range(12)],
    "decimals of different length": [f"z{number / 4}mm" for number in range(12)],
    "decimals without zeros": [f"z{number / 4:g}" for number in range(12)],
    "decimals behind one number": [f"z1.{text}" for text in ("1", "15", "2", "25", "3")],
    "versions": [f"1.{number}" for number in range(1, 13)],
    "a date and numbers that go on": [f"scan_2020-01-{2 + number // 5:02d}_{number:03d}" for number in range(10)],
    "a date for each": [f"scan_2020-{1 + at // 5:02d}-{1 + at % 5:02d}_{at:03d}" for at in range(10)],
    "hexadecimal": [f"{number:04x}" for number in range(40)],
    "hexadecimal in capitals": [f"IM{number:02X}_b" for number in range(5, 40)],
    "hexadecimal without zeros": [f"x{number:x}" for number in range(40)],
    "hexadecimal of many": [f"{number:03x}" for number in range(100, 350)],
    "every second, hexadecimal": [f"x{number:02x}" for number in range(0, 60, 2)],
    "one letter": [f"x{digit}" for digit in "0123456789abcdef"],
    "all letters": [f"x{digit}" for digit in "0123456789abcdefghijklmnopqrstuvwxyz"],
    "a word for each": ["axis", "body", "head", "skull"],
}


@pytest.mark.parametrize("kind", KEPT)
def test_names_of_one_stack_are_all_read_in_their_order(tmp_path, kind):
    save(tmp_path, [f"{name}.png" for name in KEPT[kind]])
    assert slices_of(tmp_path) == list(range(len(KEPT[kind])))
    assert not notes_with(tmp_path, "left out")
    assert bool(notes_with(tmp_path, "read as one")) == (kind == "times over a minute")
    assert bool(notes_with(tmp_path, "the names of the 4 pictures follow no pattern")) == (kind == "a word for each")


PARTS = {
    "ones and tens": [f"{number // 10}_{number % 10}" for number in range(20)],
    "times": [f"IM 12.{1 + number // 3:02d}.{number % 3 * 20:02d}" for number in range(12)],
    "times of two hours": [f"ct_{9 + at // 4:02d}-{at % 4 * 15:02d}-00" for at in range(10)],
}


@pytest.mark.parametrize("kind", PARTS)
def test_a_number_in_parts_is_one_number_and_a_note_says_so(tmp_path, kind):
    names = [f"{name}.png" for name in PARTS[kind]]
    save(tmp_path, names)
    assert slices_of(tmp_path) == list(range(len(names)))
    assert slices_of(tmp_path / names[-1]) == list(range(len(names)))
    said = f"the numbers in each name were read as one that rises from {names[0]} to {names[-1]}"
    assert notes_with(tmp_path, said)


def test_pictures_beside_decimal_or_hexadecimal_slices_are_left_out(tmp_path):
    for kind in ("decimals", "hexadecimal"):
        save(tmp_path / kind, [f"{name}.png" for name in KEPT[kind]])
        save(tmp_path / kind, [f"{KEPT[kind][3]} (1).png", "preview_1.png", f"Copy of {KEPT[kind][4]}.png"], first=90)
        assert slices_of(tmp_path / kind) == list(range(len(KEPT[kind])))
        assert notes_with(tmp_path / kind, "3 pictures left out")


@pytest.mark.parametrize(
    ("names", "between"),
    [
        ([f"x{digit}" for digit in "0123456789abcf"], ["xa.png", "xb.png", "xc.png and 1 more"]),
        ([f"{number:03x}" for number in (*range(40), 50, 60, 62)], ["00a.png", "00b.png", "00c.png and 11 more"]),
        (
            [f"s{number:02d}{'_new' * (number in (4, 5, 9))}" for number in range(14)],
            ["s04_new.png", "s05_new.png", "s09_new.png"],
        ),
    ],
)
def test_pictures_between_slices_are_refused_by_name_and_not_left_out(tmp_path, names, between):
    save(tmp_path / "ct", [f"{name}.png" for name in names])
    for path in (tmp_path / "ct", tmp_path / "ct" / f"{names[2]}.png"):
        with pytest.raises(CtmcError) as error:
            read_volume(path)
        assert f"in the folder ct are named unlike the slices {names[0]}.png to " in str(error.value)
        assert str(error.value).endswith(
            f"and may lie between them: {', '.join(between)}; give all slices one number that rises (0001, 0002), or "
            "take the others out of the folder"
        )


def test_a_missing_decimal_is_refused_by_its_step(tmp_path):
    save(tmp_path, [f"z{number / 4:.2f}.png" for number in range(10) if number != 6])
    words = r"slices are missing between z1.25.png and z1.75.png, as the others are numbered in steps of 0.25;"
    with pytest.raises(CtmcError, match=words):
        read_volume(tmp_path)


TWO = {
    "numbers behind a point": [[f"scan{scan}.{number:03d}.png" for number in range(1, 6)] for scan in (1, 2)],
    "hundreds": [[f"scan{scan}_{number:02d}.png" for number in range(100)] for scan in (1, 2)],
    "dates of few slices": [[f"scan_2020-01-{day:02d}_{at:03d}.png" for at in range(3)] for day in range(1, 4)],
    "dates": [[f"scan_2020-01-{day:02d}_{number:03d}.png" for number in range(5)] for day in (1, 2)],
    "words": [[f"{side}_{number:03d}.png" for number in range(5)] for side in ("left", "right")],
    "numbers": [[f"scan{scan}_{number:03d}.png" for number in range(5)] for scan in (1, 2)],
    "channels": [[f"z{number:03d}_c{channel}.png" for number in range(5)] for channel in (0, 1)],
    "masks": [[f"{number:03d}{end}.png" for number in range(5)] for end in ("", "_mask")],
    "of 6 and 5": [[f"left_{number}.png" for number in range(6)], [f"right_{number}.png" for number in range(5)]],
}


@pytest.mark.parametrize("kind", TWO)
def test_two_stacks_of_like_size_are_refused_by_name_and_each_is_read_by_a_slice_of_it(tmp_path, kind):
    stacks = TWO[kind]
    for number, names in enumerate(stacks):
        save(tmp_path / "ct", names, first=20 * number)
    ends = ", ".join(f"{names[0]} to {names[-1]} ({len(names)})" for names in stacks)
    with pytest.raises(CtmcError) as error:
        read_volume(tmp_path / "ct")
    assert str(error.value) == (
        f"the folder ct has {len(stacks)} stacks of pictures: {ends}; choose a slice of the one to read, or give "
        "each a folder of its own; if all are one stack, give its slices one number that rises (0001, 0002)"
    )
    for number, names in enumerate(stacks):
        path = tmp_path / "ct" / names[2]
        assert slices_of(path) == [20 * number + at for at in range(len(names))]
        others = sum(map(len, stacks)) - len(names)
        assert notes_with(path, f"{others} pictures left out")


def test_of_two_stacks_the_much_larger_one_is_read(tmp_path):
    save(tmp_path, [f"IM-0002-{number:04d}.png" for number in range(1, 13)])
    save(tmp_path, [f"IM-0001-{number:04d}.png" for number in range(1, 5)], first=50)
    assert slices_of(tmp_path) == list(range(12))
    assert notes_with(
        tmp_path, "4 pictures left out, not named like the 12 slices IM-0002-0001.png to IM-0002-0012.png"
    )


def test_many_stacks_of_which_none_is_the_larger_part_are_refused(tmp_path):
    for count, letter in zip((6, 4, 4, 3), "abcd", strict=True):
        save(tmp_path, [f"{letter}{number}.png" for number in range(count)])
    words = r"4 stacks of pictures: a0.png to a5.png \(6\), b0.png to .* and 1 more; choose a slice"
    with pytest.raises(CtmcError, match=words):
        read_volume(tmp_path)


def test_more_foreign_pictures_than_slices_are_left_out(tmp_path):
    save(tmp_path, [f"s{number}.png" for number in range(8)])
    save(tmp_path, [f"{letter}.png" for letter in "abcdefghi"], first=20)
    assert slices_of(tmp_path) == list(range(8))
    assert notes_with(tmp_path, "9 pictures left out")


def test_names_by_chance_are_all_read_and_said_to_follow_no_pattern(tmp_path):
    chance = np.random.default_rng(0)
    names = sorted({chance.bytes(6).hex() for _ in range(40)})
    save(tmp_path, [f"{name}.png" for name in names])
    assert sorted(slices_of(tmp_path)) == list(range(40))
    assert notes_with(tmp_path, "the names of the 40 pictures follow no pattern: read in their order")


def test_a_picture_that_is_not_a_slice_does_not_stand_for_the_folder(tmp_path):
    save(tmp_path, [*(f"s{number}.png" for number in range(4)), "preview.png"])
    with pytest.raises(CtmcError) as error:
        read_volume(tmp_path / "preview.png")
    assert str(error.value) == (
        "by its name, preview.png does not belong to the slices s0.png to s3.png; choose one of those, or the folder"
    )


def test_a_missing_number_is_still_refused(tmp_path):
    save(tmp_path, [f"s{number:02d}.png" for number in (1, 2, 3, 5, 6)] + ["s_spr.png"])
    with pytest.raises(CtmcError, match=r"slices are missing between s03.png and s05.png"):
        read_volume(tmp_path)


def test_a_hidden_picture_is_refused_and_one_by_another_path_is_found(tmp_path):
    save(tmp_path / "ct", [f"s{number}.png" for number in range(4)] + [".s9.png"])
    words = r"\.s9\.png: hidden files are not read as slices; rename it without the leading dot"
    with pytest.raises(CtmcError, match=words):
        read_volume(tmp_path / "ct" / ".s9.png")
    (tmp_path / "ct" / ".link.png").symlink_to(tmp_path / "ct" / "s2.png")
    assert slices_of(tmp_path / "ct" / ".link.png") == [0, 1, 2, 3]
