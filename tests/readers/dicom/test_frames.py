# SPDX-License-Identifier: GPL-3.0-or-later
"""Enhanced multi-frame CT: geometry and slopes of every frame from its functional groups."""

from __future__ import annotations

import numpy as np
import pydicom
import pytest
from pydicom import uid

from ctmc_addon.core import CtmcError
from ctmc_addon.readers import open_volume, read_volume

SAGITTAL = (0, 1, 0, 0, 0, -1)  # rows towards the back, columns towards the feet; normal towards the right


def frames_of(count, shape=(4, 6), seed=0):
    return np.random.default_rng(seed).integers(0, 2000, (count, *shape)).astype(np.uint16)


@pytest.mark.parametrize("compress", [None, uid.RLELossless])
def test_frames_out_of_order_are_put_in_order(tmp_path, save_frames, compress):
    stored = frames_of(4)
    heights = (6, 0, 2, 4)
    dataset = save_frames(tmp_path / "enhanced.dcm", stored, [(-5, 7, z) for z in heights])
    if compress:
        dataset.compress(compress, generate_instance_uid=False)
        dataset.save_as(tmp_path / "enhanced.dcm")
    volume = read_volume(tmp_path / "enhanced.dcm")
    np.testing.assert_array_equal(volume.values, stored[np.argsort(heights)].astype(int) - 1000)
    np.testing.assert_array_equal(volume.affine, [[-0.5, 0, 0, 5], [0, -0.8, 0, -7], [0, 0, 2, 0], [0, 0, 0, 1]])
    assert (volume.kind, volume.name, volume.notes) == ("HU", "enhanced", ())


def test_a_sagittal_stack_stands_where_its_frames_say(tmp_path, save_frames):
    stored = frames_of(3)
    positions = [(x, -20, 30) for x in (9, 5, 7)]
    save_frames(tmp_path / "s.dcm", stored, positions, SAGITTAL)
    volume = read_volume(tmp_path / "s.dcm")
    for at in range(3):
        frame = next(n for n in range(3) if (stored[n].astype(int) - 1000 == volume.values[at]).all())
        for row, column in ((0, 0), (3, 5)):
            lps = (
                np.array(positions[frame]) + np.array(SAGITTAL[:3]) * 0.5 * column + np.array(SAGITTAL[3:]) * 0.8 * row
            )
            np.testing.assert_allclose((volume.affine @ (column, row, at, 1))[:3], lps * (-1, -1, 1), atol=1e-9)
    assert volume.orientation == "PIR"


def test_slopes_and_intercepts_are_taken_frame_by_frame(tmp_path, save_frames):
    stored = frames_of(3)
    slopes, intercepts = (1, 2, 3), (-1000, 5, 0)
    save_frames(tmp_path / "e.dcm", stored, [(0, 0, z) for z in range(3)], slopes=slopes, intercepts=intercepts)
    expected = stored * np.reshape(slopes, (3, 1, 1)).astype(int) + np.reshape(intercepts, (3, 1, 1))
    np.testing.assert_array_equal(read_volume(tmp_path).values, expected)


def test_uneven_frames_are_resampled(tmp_path, save_frames):
    stored = np.stack([np.full((4, 6), value, np.uint16) for value in (0, 10, 30, 50)])
    save_frames(tmp_path / "e.dcm", stored, [(0, 0, z) for z in (0, 1, 3, 5)])
    np.testing.assert_array_equal(read_volume(tmp_path).values[:, 0, 0], np.arange(0, 60, 10) - 1000)


def test_frames_of_two_phases_at_one_place_are_two_times(tmp_path, save_frames):
    stored = frames_of(6)
    save_frames(tmp_path / "e.dcm", stored, [(0, 0, z) for z in (0, 1, 2, 0, 1, 2)])
    volume = read_volume(tmp_path / "e.dcm")
    np.testing.assert_array_equal(volume.values, stored[:3].astype(int) - 1000)
    assert volume.notes[0].startswith("2 time points found")
    np.testing.assert_array_equal(read_volume(tmp_path / "e.dcm", time=2).values, stored[3:].astype(int) - 1000)
    series = open_volume(tmp_path / "e.dcm").series[0]
    assert (series.slices, series.times) == (3, 2)


@pytest.mark.parametrize(
    ("sequence", "keyword", "numbers"),
    [
        ("FrameContentSequence", "TemporalPositionIndex", (2, 1, 2, 1, 2, 1)),
        ("FrameContentSequence", "FrameAcquisitionNumber", (9, 8, 9, 8, 9, 8)),
        ("CardiacSynchronizationSequence", "NominalPercentageOfCardiacPhase", (80.0, 10.0, 80.0, 10.0, 80.0, 10.0)),
    ],
)
def test_frames_say_their_time(tmp_path, save_frames, sequence, keyword, numbers):
    stored = frames_of(6)
    dataset = save_frames(tmp_path / "e.dcm", stored, [(0, 0, z) for z in (0, 0, 1, 1, 2, 2)])
    for group, number in zip(dataset.PerFrameFunctionalGroupsSequence, numbers, strict=True):
        item = pydicom.Dataset()
        setattr(item, keyword, number)
        setattr(group, sequence, [item])
    dataset.save_as(tmp_path / "e.dcm")
    for time, first in ((1, 1), (2, 0)):
        found = read_volume(tmp_path / "e.dcm", time=time)
        np.testing.assert_array_equal(found.values, stored[first::2].astype(int) - 1000)


def test_frames_in_several_files_make_one_volume(tmp_path, save_frames):
    stored = frames_of(4)
    save_frames(tmp_path / "a.dcm", stored[:2], [(0, 0, 0), (0, 0, 1)])
    save_frames(tmp_path / "b.dcm", stored[2:], [(0, 0, 2), (0, 0, 3)])
    np.testing.assert_array_equal(read_volume(tmp_path).values, stored.astype(int) - 1000)


def test_a_multi_frame_file_without_positions_is_refused(tmp_path, save_frames):
    save_frames(
        tmp_path / "e.dcm",
        frames_of(3),
        [(0, 0, z) for z in range(3)],
        PerFrameFunctionalGroupsSequence=None,
        SharedFunctionalGroupsSequence=None,
    )
    with pytest.raises(CtmcError, match=r"none of the 3 slices or frames in e.dcm has a position"):
        read_volume(tmp_path / "e.dcm")


def test_fewer_groups_than_frames_are_refused(tmp_path, save_frames):
    save_frames(tmp_path / "e.dcm", frames_of(3), [(0, 0, 0), (0, 0, 1)])
    with pytest.raises(CtmcError, match=r"e.dcm is a truncated or damaged DICOM file"):
        read_volume(tmp_path / "e.dcm")


def test_a_truncated_multi_frame_file_is_refused(tmp_path, save_frames):
    save_frames(tmp_path / "e.dcm", frames_of(3), [(0, 0, z) for z in range(3)])
    whole = (tmp_path / "e.dcm").read_bytes()
    (tmp_path / "e.dcm").write_bytes(whole[:-30])
    with pytest.raises(CtmcError, match=r"e.dcm .*114 of 144 bytes of pixels"):
        read_volume(tmp_path / "e.dcm")
