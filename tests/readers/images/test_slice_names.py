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
    "a word for each": ["axis", "body", "head", "skull"],
}


@pytest.mark.parametrize("kind", KEPT)
def test_names_of_one_stack_are_all_read_in_their_order(tmp_path, kind):
    save(tmp_path, [f"{name}.png" for name in KEPT[kind]])
    assert slices_of(tmp_path) == list(range(len(KEPT[kind])))
    assert not notes_with(tmp_path, "left out")
    assert bool(notes_with(tmp_path, "the names of the 4 pictures follow no pattern")) == (kind == "a word for each")


TWO = {
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
        f"the folder ct has 2 stacks of pictures: {ends}; choose a slice of the one to read, or give "
        "each a folder of its own"
    )
    for number, names in enumerate(stacks):
        path = tmp_path / "ct" / names[2]
        assert slices_of(path) == [20 * number + at for at in range(len(names))]
        assert notes_with(path, f"{len(stacks[1 - number])} pictures left out")


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
        "preview.png is not one of the slices beside it, s0.png to s3.png, by its name; choose one of those, or the "
        "folder"
    )


def test_a_missing_number_is_still_refused(tmp_path):
    save(tmp_path, [f"s{number:02d}.png" for number in (1, 2, 3, 5, 6)] + ["s_spr.png"])
    with pytest.raises(CtmcError, match=r"slices are missing between s03.png and s05.png"):
        read_volume(tmp_path)


def test_a_hidden_picture_is_refused_and_one_by_another_path_is_found(tmp_path):
    save(tmp_path / "ct", [f"s{number}.png" for number in range(4)] + [".s9.png"])
    with pytest.raises(CtmcError, match=r"\.s9\.png is a hidden file, .*; give it a name without the dot"):
        read_volume(tmp_path / "ct" / ".s9.png")
    (tmp_path / "ct" / ".link.png").symlink_to(tmp_path / "ct" / "s2.png")
    assert slices_of(tmp_path / "ct" / ".link.png") == [0, 1, 2, 3]
