# SPDX-License-Identifier: GPL-3.0-or-later
"""Statistics of a volume: range, histogram, labels, fingerprint."""

import numpy as np
import pytest

from ctmc_addon.core import Volume, finish
from ctmc_addon.core.volume import histogram_picture, volume_statistics_steps
from ctmc_addon.core.volume.statistics.values import INSIDE


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32])
def test_statistics_have_range_and_labels(dtype):
    values = np.zeros((4, 5, 6), dtype)
    values[1, 1], values[2, 2, :3], values[3, 3, 3] = 2, 7, 100
    statistics = finish(volume_statistics_steps(Volume(values, np.eye(4), kind="label")))
    assert (statistics.low, statistics.high) == pytest.approx((0, 100))
    assert statistics.labels == ((2, 6), (7, 3), (100, 1))
    assert statistics.bar_heights(50)[[0, 1, 3, 49]] == pytest.approx(np.log1p([110, 6, 3, 1]) / np.log1p(110))


def test_a_fingerprint_changes_with_a_voxel_and_with_the_place():
    values = np.arange(27, dtype=np.int16).reshape(3, 3, 3)
    other = values.copy()
    other[0, 0, 0] = 5
    fingerprints = [
        finish(volume_statistics_steps(Volume(*volume))).fingerprint
        for volume in ((values, np.eye(4)), (values, np.diag([1, 1, 2.0, 1])), (other, np.eye(4)))
    ]
    assert len(set(fingerprints)) == 3
    assert finish(volume_statistics_steps(Volume(values.copy(), np.eye(4)))).fingerprint == fingerprints[0]


def test_a_volume_without_a_finite_value_has_statistics():
    statistics = finish(volume_statistics_steps(Volume(np.full((2, 2, 2), np.nan), np.eye(4))))
    assert (statistics.non_finite, statistics.histogram, statistics.labels) == (8, None, ())
    assert not statistics.bar_heights(4).any()


def test_bars_between_the_limits_have_a_color_and_the_limits_are_lines():
    statistics = finish(volume_statistics_steps(Volume(np.arange(1000, dtype=np.int16).reshape(10, 10, 10), np.eye(4))))
    foot = {limits: histogram_picture(statistics, limits, 100, 8)[0, :, :3] for limits in
            ((200.0, None), (200.0, 600.0), (None, 600.0))}  # fmt: skip
    colored = {limits: np.flatnonzero((row == np.float32(INSIDE)).all(axis=1)) for limits, row in foot.items()}
    lines = {limits: np.flatnonzero((row == 1).all(axis=1)).tolist() for limits, row in foot.items()}
    assert lines == {(200.0, None): [20], (200.0, 600.0): [20, 60], (None, 600.0): []}
    assert (colored[200.0, None].min(), colored[200.0, None].max()) == (21, 99)
    assert (colored[200.0, 600.0].min(), colored[200.0, 600.0].max()) == (21, 59)
    assert not colored[None, 600.0].size
