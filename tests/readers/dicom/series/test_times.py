# SPDX-License-Identifier: GPL-3.0-or-later
"""Series that hold several scans of one place."""

import numpy as np
import pytest

from ctmc_addon.core import ReadError
from ctmc_addon.readers import open_volume, read_volume


@pytest.mark.parametrize("keyword", ["AcquisitionNumber", "TemporalPositionIdentifier"])
@pytest.mark.parametrize("shift", [0, 0.5])
def test_of_two_scans_of_one_place_the_larger_is_read(tmp_path, save_stack, keyword, shift):
    first = save_stack(tmp_path / "a", np.arange(5) + shift, **{keyword: 1})
    expected = save_stack(tmp_path / "b", range(6), seed=1, **{keyword: 2})
    volume = read_volume(tmp_path)
    np.testing.assert_array_equal(volume.values, expected)
    assert volume.spacing[2] == 1
    assert volume.notes[0] == "2 time points found, showing number 2"
    np.testing.assert_array_equal(read_volume(tmp_path, time=1).values, first)
    assert read_volume(tmp_path, time=2).notes == ()
    with pytest.raises(ReadError, match=r"no time 3.*1 to 2"):
        read_volume(tmp_path, time=3)


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


ORDERS = {
    "TriggerTime": (lambda time, place: time * 80.0 + place),
    "ContentTime": (lambda time, place: f"1010{time * 10 + place:02d}.5"),
    "AcquisitionTime": (lambda time, place: f"{10 + place:02d}{time:02d}00"),  # place by place
    "InstanceNumber": (lambda time, place: 1 + 5 * time + (4 - place if time else place)),  # turns round
}


@pytest.mark.parametrize("keyword", ORDERS)
@pytest.mark.parametrize("times", [2, 3])
def test_an_order_of_times_tells_images_at_the_same_places_apart(tmp_path, save_slice, keyword, times):
    numbers = [(time, place) for time in range(times) for place in range(5)]
    np.random.default_rng(1).shuffle(numbers)
    for file, (time, place) in enumerate(numbers):
        tags = {"InstanceNumber": place + 1} | {keyword: ORDERS[keyword](time, place)}
        save_slice(tmp_path / f"{file}.dcm", np.full((4, 5), 10 * time + place, np.uint16), (0, 0, place), **tags)
    assert open_volume(tmp_path).series[0].times == times
    for time in range(times):
        values = read_volume(tmp_path, time=time + 1).values
        np.testing.assert_array_equal(values[:, 0, 0], 10 * time + np.arange(5) - 1024)


def test_an_order_that_might_mix_two_scans_is_refused(tmp_path, save_slice):
    for number, place in enumerate([0, 1, 2, 3, 4, 2, 1, 0, 4, 3]):
        pixels = np.full((4, 5), number, np.uint16)
        save_slice(tmp_path / f"{number}.dcm", pixels, (0, 0, place), InstanceNumber=(number * 7) % 10 + 1)
    with pytest.raises(ReadError, match="5 of 5"):
        read_volume(tmp_path)


def test_each_time_may_be_made_of_scans_that_follow_each_other(tmp_path, save_stack):
    parts = {}
    for number, start in enumerate((0, 5, 0, 5), 1):
        heights = range(start, start + 5)
        parts[number] = save_stack(tmp_path / str(number), heights, seed=number, AcquisitionNumber=number)
    for time in (1, 2):
        expected = np.concatenate([parts[2 * time - 1], parts[2 * time]])
        np.testing.assert_array_equal(read_volume(tmp_path, time=time).values, expected)


def test_a_chosen_file_chooses_its_time(tmp_path, save_stack):
    both = []
    for time in (1, 2):
        both.append(save_stack(tmp_path / str(time), range(4), seed=time, TemporalPositionIdentifier=time))
    for time in (1, 2):
        for file in (tmp_path / str(time)).iterdir():
            file.rename(tmp_path / f"{time}{file.name}")
    for time in (1, 2):
        np.testing.assert_array_equal(read_volume(tmp_path / f"{time}0.dcm").values, both[time - 1])


def test_copies_of_one_scan_are_one_time(tmp_path, save_stack):
    hu = save_stack(tmp_path / "a", range(4), AcquisitionNumber=1)
    (tmp_path / "b").mkdir()
    for file in (tmp_path / "a").iterdir():
        (tmp_path / "b" / file.name).write_bytes(file.read_bytes())
    np.testing.assert_array_equal(read_volume(tmp_path).values, hu)
    assert open_volume(tmp_path).series[0].times == 1
