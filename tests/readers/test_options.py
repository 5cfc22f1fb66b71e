# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading options check themselves, and one object says all that the separate fields say."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from ctmc_addon.core import SettingsError, finish
from ctmc_addon.readers import ReadingOptions, open_volume, read_volume, read_volume_steps


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"spacing": (1, 0, 1)}, "spacing along y must be from 1e-06 to 10000 mm, not 0; measure it or leave it out"),
        ({"spacing": (1, 1)}, "spacing is three numbers x, y, z in mm, not 2: (1, 1)"),
        ({"flip": "xx"}, "flip takes the axes x, y and z, each at most once, such as 'xz', not 'xx'"),
        ({"time": 0}, "time must be 1 or more, not 0"),
        ({"time": 1.5}, "time must be a whole number, not 1.5"),
        ({"strict": "no"}, "strict is on or off, True or False, not 'no'"),
        ({"name": " "}, "name must be printable text, not ' '"),
        (
            {"anatomy_colors": True, "file_colors": True},
            "anatomy_colors and file_colors exclude each other; choose one",
        ),
        ({"name": "a\nb"}, "name must be printable text, not 'a\\nb'"),
    ],
)
def test_an_option_that_cannot_be_is_refused_with_its_value(fields, words):
    with pytest.raises(SettingsError) as caught:
        ReadingOptions(**fields)
    assert str(caught.value) == words


def test_options_take_their_own_types_and_survive_a_dictionary_and_pickle():
    options = ReadingOptions(spacing=2, flip="Z x", series=3, time=4.0, strict=1, allow_outside=True, name=" Head ")
    assert options == ReadingOptions((2.0, 2.0, 2.0), "xz", "3", 4, None, True, True, "Head")
    assert options.to_dict() == {
        "spacing": [2.0, 2.0, 2.0], "flip": "xz", "series": "3", "time": 4, "strict": True, "allow_outside": True,
        "name": "Head", "remove_table": False, "anatomy_colors": False, "file_colors": False, "skip_damaged": False,
    }  # fmt: skip
    assert ReadingOptions.from_dict(options.to_dict()) == options
    assert pickle.loads(pickle.dumps(options)) == options
    assert hash(options) == hash(replace(options))
    assert ReadingOptions(series=" ") == ReadingOptions()


def test_an_unknown_option_is_refused_before_a_file_is_opened(tmp_path):
    with pytest.raises(SettingsError, match="unknown reading option 'spaceing'; the options are spacing, flip, series"):
        finish(read_volume_steps(tmp_path / "none.npy", spaceing=1))


def test_one_object_and_separate_fields_read_the_same(tmp_path):
    np.save(tmp_path / "ct.npy", np.arange(60, dtype=np.int16).reshape(3, 4, 5))
    options = ReadingOptions(spacing=(0.5, 0.5, 2), flip="z", name="Head")
    path, source = tmp_path / "ct.npy", open_volume(tmp_path / "ct.npy")
    expected = read_volume(path, spacing=(0.5, 0.5, 2), flip="z", name="Head")
    assert (expected.name, expected.spacing) == ("Head", (0.5, 0.5, 2.0))
    for volume in (
        read_volume(path, options=options),
        read_volume(path, (0.5, 0.5, 2), name="Head", options=ReadingOptions(spacing=9, flip="z")),
        finish(read_volume_steps(path, options)),
        source.read(options),
        source.read(ReadingOptions(flip="z", name="Head"), spacing=(0.5, 0.5, 2)),
        finish(finish(source.slabs_steps(options)).in_memory_steps()),
    ):
        np.testing.assert_array_equal(volume.values, expected.values)
        np.testing.assert_array_equal(volume.affine, expected.affine)
        assert (volume.name, volume.notes) == (expected.name, expected.notes)


def test_a_given_name_hides_the_files_and_its_meaning_stays(tmp_path):
    values = np.zeros((4, 4, 4), np.int16)
    values[1:3] = 1
    np.save(tmp_path / "liver_segmentation.npy", values)
    named, plain = (read_volume(tmp_path / "liver_segmentation.npy", name=name) for name in ("case 7", None))
    assert (named.name, plain.name) == ("case 7", "liver_segmentation")
    assert named.kind == plain.kind
