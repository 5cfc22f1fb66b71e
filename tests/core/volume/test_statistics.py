# SPDX-License-Identifier: GPL-3.0-or-later
"""Statistics of a volume: range, histogram, labels, fingerprint."""

import numpy as np
import pytest

from ctmc_addon.core import Volume, finish
from ctmc_addon.core.volume import volume_statistics_steps


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
