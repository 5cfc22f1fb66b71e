# SPDX-License-Identifier: GPL-3.0-or-later
"""The region's box: where it lies, and how its sides move."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.core import ReconstructionSettings, SettingsError, Volume
from ctmc_addon.core.volume.region import (
    EDGES,
    box_of,
    moved_region,
    region_axes,
    region_box,
    region_corners,
    region_limits,
    region_shift,
    side_positions,
    volume_box,
    with_moved_face,
)

SHEARED = np.array([[-0.7, 0.05, 0.3, 40.0], [0.1, -0.8, 0.4, -12.0], [0.02, 0.1, -2.5, 90.0], [0.0, 0.0, 0.0, 1.0]])


@pytest.fixture
def volume():
    return Volume(np.zeros((5, 6, 7), np.int16), SHEARED)


def test_a_box_has_twelve_edges_and_three_at_every_corner():
    assert len(set(EDGES)) == 12
    assert np.bincount(np.array(EDGES).ravel()).tolist() == [3] * 8


def test_the_voxel_boxs_edges_run_along_the_volumes_own_axes(volume):
    corners = region_corners(volume, (1, 2, 0, 4, 5, 3), "voxel")
    for axis in range(3):
        assert corners[1 << axis] - corners[0] == pytest.approx(3 * region_axes(volume, "voxel")[axis])


@pytest.mark.parametrize("unit", ["voxel", "mm"])
def test_the_limits_hold_the_whole_volume(volume, unit):
    settings = ReconstructionSettings(threshold=0.5, region=region_limits(volume, unit), region_unit=unit)
    assert region_box(volume, settings) == ((0, 7), (0, 6), (0, 5))


def test_a_shift_in_the_patient_and_the_regions_own_shift_are_one(volume):
    shift_mm = np.array([2.0, -3.0, 5.0])
    for unit in ("voxel", "mm"):
        shift = region_shift(volume, unit, shift_mm)
        region = (0.0, 0.0, 0.0, 3.0, 3.0, 3.0)
        moved = tuple(np.array(region) + np.tile(shift, 2))
        difference = region_corners(volume, moved, unit) - region_corners(volume, region, unit)
        assert difference == pytest.approx(np.tile(shift_mm, (8, 1)))


@pytest.mark.parametrize("face", range(6))
@pytest.mark.parametrize("value", [-100.0, 3.3, 100.0])
def test_a_moved_side_keeps_the_region_whole_and_inside(face, value):
    limits = (0.0, 0.0, 0.0, 20.0, 20.0, 20.0)
    region = with_moved_face((2.0, 2.0, 2.0, 9.0, 9.0, 9.0), face, value, limits)
    assert all(limits[at] <= region[at] <= limits[at + 3] for at in range(3))
    assert all(region[at] + 1 <= region[at + 3] <= limits[at + 3] for at in range(3))
    assert sum(a != b for a, b in zip(region, (2.0, 2.0, 2.0, 9.0, 9.0, 9.0), strict=True)) == 1


def test_a_moved_region_keeps_its_size():
    limits = (0.0, 0.0, 0.0, 20.0, 20.0, 20.0)
    for shift in (-50.0, -1.5, 4.0, 50.0):
        region = moved_region((2.0, 2.0, 2.0, 9.0, 9.0, 9.0), 1, shift, limits)
        assert region[4] - region[1] == 7.0
        assert 0 <= region[1] < region[4] <= 20.0


def test_letters_stand_outside_on_their_side(volume):
    corners = volume_box(volume)
    places = side_positions(corners)
    assert places["R"][0] > corners[:, 0].max()
    assert places["L"][0] < corners[:, 0].min()
    assert places["A"][1] > corners[:, 1].max()
    assert places["P"][1] < corners[:, 1].min()
    assert places["S"][2] > corners[:, 2].max()
    assert places["I"][2] < corners[:, 2].min()


@pytest.mark.parametrize("unit", ["voxel", "mm"])
@pytest.mark.parametrize(
    ("region", "sentence"),
    [
        ((0, 4, 0, 5, 1, 5), "is empty; give the lowest x, y, z first, then the highest"),
        ((9, 0, 0, 20, 5, 5), "leaves fewer than 2 of the volume's 6 samples along x; choose one inside the volume"),
    ],
)
def test_a_region_without_two_samples_says_what_is_wrong(region, sentence, unit):
    with pytest.raises(SettingsError, match=sentence):
        box_of(Volume(np.zeros((6, 6, 6), np.int16), np.eye(4)), region, unit)
