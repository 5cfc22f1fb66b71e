# SPDX-License-Identifier: GPL-3.0-or-later
"""Series that hold several scans of one place."""

import numpy as np
import pytest

from ctmc_addon.core import ReadError
from ctmc_addon.readers import read_volume


@pytest.mark.parametrize("keyword", ["AcquisitionNumber", "TemporalPositionIdentifier"])
@pytest.mark.parametrize("shift", [0, 0.5])
def test_of_two_scans_of_one_place_the_larger_is_read(tmp_path, save_stack, keyword, shift):
    save_stack(tmp_path / "a", np.arange(5) + shift, **{keyword: 1})
    expected = save_stack(tmp_path / "b", range(6), seed=1, **{keyword: 2})
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, expected)
    assert volume.spacing[2] == 1
    assert any("2 acquisitions" in note and "5 slices" in note for note in volume.notes)


def test_scans_that_follow_each_other_are_one_volume(tmp_path, save_stack):
    low = save_stack(tmp_path / "a", range(5), AcquisitionNumber=1)
    high = save_stack(tmp_path / "b", range(4, 9), seed=1, AcquisitionNumber=2)
    np.testing.assert_array_equal(read_volume(tmp_path).values, np.concatenate([low[:4], high]))


def test_a_scanner_that_counts_each_slice_gives_one_volume(tmp_path, save_slice):
    for z in range(6):
        save_slice(tmp_path / f"{z}.dcm", np.full((4, 5), z, np.uint16), (0, 0, z), AcquisitionNumber=z % 3 * 10 + z)
    assert len(read_volume(tmp_path).values) == 6


def test_two_scans_that_nothing_tells_apart_are_refused(tmp_path, save_stack):
    save_stack(tmp_path / "a", range(5))
    save_stack(tmp_path / "b", range(5), seed=1)
    with pytest.raises(ReadError, match="5 of 5"):
        read_volume(tmp_path)


def test_scans_in_the_order_of_their_instance_numbers_give_the_first(tmp_path, save_slice):
    for number in range(10):
        pixels = np.full((4, 5), number, np.uint16)
        save_slice(tmp_path / f"{number}.dcm", pixels, (0, 0, number % 5), InstanceNumber=number + 1)
    np.testing.assert_array_equal(read_volume(tmp_path).values[:, 0, 0], np.arange(5) - 1024)
