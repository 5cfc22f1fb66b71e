# SPDX-License-Identifier: GPL-3.0-or-later
"""A slice's samples, its place in the patient, and its colors."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.core import Volume
from ctmc_addon.core.volume.affine import transform_points
from ctmc_addon.core.volume.slices import (
    PLANES,
    TINT,
    TINT_SHARE,
    slice_at,
    slice_corners,
    slice_normal,
    slice_values,
    where_ray_meets,
    windowed,
)

# Oblique, sheared and mirrored; columns towards the left, rows to the back, slices to the feet.
SHEARED = np.array([[-0.7, 0.05, 0.3, 40.0], [0.1, -0.8, 0.4, -12.0], [0.02, 0.1, -2.5, 90.0], [0.0, 0.0, 0.0, 1.0]])


@pytest.fixture
def volume():
    return Volume(np.arange(5 * 6 * 7, dtype=np.int16).reshape(5, 6, 7), SHEARED)


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("position", [0.0, 0.3, 1.0])
def test_every_pixel_stands_where_its_sample_does(volume, plane, position):
    place = slice_at(volume, plane, position)
    values = slice_values(volume, place)
    rows, columns = values.shape
    first, right, _, down = slice_corners(volume, place)
    for row, column in np.ndindex(rows, columns):
        pixel = first + (right - first) * (column + 0.5) / columns + (down - first) * (row + 0.5) / rows
        z, y, x = np.unravel_index(int(values[row, column]), volume.values.shape)
        assert pixel == pytest.approx(transform_points(volume.affine, np.array([[x, y, z]]))[0], abs=1e-9)


@pytest.mark.parametrize("plane", PLANES)
def test_a_ray_meets_a_slice_at_the_point_that_it_was_sent_to(volume, plane):
    corners, draw = slice_corners(volume, slice_at(volume, plane, 0.4)), np.random.default_rng(0)
    across, down = corners[1] - corners[0], corners[3] - corners[0]
    for right, below in draw.uniform(-0.5, 1.5, (40, 2)):
        target = corners[0] + right * across + below * down
        origin = draw.normal(0, 100, 3)
        inside = 0 < right < 1 and 0 < below < 1
        way = where_ray_meets(corners, origin, (target - origin) / 4)
        assert way == (pytest.approx(4.0) if inside else None)
    assert where_ray_meets(corners, corners[0] - across, across) is None  # along it


@pytest.mark.parametrize("plane", PLANES)
def test_a_normal_stands_on_its_slice(volume, plane):
    corners = slice_corners(volume, slice_at(volume, plane, 0.4))
    normal = slice_normal(corners)
    sides = np.array([corners[1] - corners[0], corners[3] - corners[0]])
    assert np.abs(sides @ normal).max() < 1e-12
    assert normal @ normal == pytest.approx(1.0, rel=1e-15)
    assert np.linalg.det([*sides, normal]) > 0


@pytest.mark.parametrize(("plane", "axis"), [("sagittal", 0), ("coronal", 1), ("axial", 2)])
def test_the_slider_runs_to_the_right_the_front_and_the_head(volume, plane, axis):
    middles = [slice_corners(volume, slice_at(volume, plane, at)).mean(axis=0)[axis] for at in (0.0, 0.5, 1.0)]
    assert middles[0] < middles[1] < middles[2]


def test_a_slice_is_a_view_of_the_volume(volume):
    for plane in PLANES:
        assert np.shares_memory(slice_values(volume, slice_at(volume, plane, 0.5)), volume.values)


def test_window_and_level_run_from_black_to_white():
    gray = windowed(np.array([[-161, -160, 40, 240, 241]], np.int16), window=400, level=40)
    assert gray[0, :, :3].tolist() == [[0.0] * 3, [0.0] * 3, [0.5] * 3, [1.0] * 3, [1.0] * 3]
    assert (gray[..., 3] == 1).all()


def test_what_the_surface_will_hold_is_tinted_and_nothing_else():
    values = np.array([[99, 100, 101]], np.int16)
    plain, tinted = windowed(values, 200, 100), windowed(values, 200, 100, threshold=100)
    assert (tinted[0, 0] == plain[0, 0]).all()
    expected = plain[0, 1:, :3] * (1 - TINT_SHARE) + np.array(TINT) * TINT_SHARE
    assert tinted[0, 1:, :3] == pytest.approx(expected, abs=1e-6)


def test_labels_are_tinted_instead_of_a_threshold():
    values = np.array([[0, 1, 2, 3]], np.uint8)
    changed = (windowed(values, 3, 1.5, labels=(1, 3)) != windowed(values, 3, 1.5)).any(axis=2)
    assert changed.tolist() == [[False, True, False, True]]


@pytest.mark.parametrize("dtype", [bool, np.uint8, ">i2", np.int64, np.float32, ">f8"])
def test_every_type_of_value_makes_a_picture(dtype):
    made = windowed(np.array([[0, 1]]).astype(dtype), window=1.0, level=0.5, threshold=0.5)
    assert made[0, 0, 0] == 0
    assert made[0, 1, 0] == 1


def test_nan_is_black_and_not_tinted():
    made = windowed(np.array([[np.nan, 1.0]]), window=2.0, level=0.0, threshold=0.5)
    assert made[0, 0, :3].tolist() == [0.0, 0.0, 0.0]
