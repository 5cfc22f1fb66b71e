# SPDX-License-Identifier: GPL-3.0-or-later
"""Tissues: thresholds in HU that CT can have."""

from ctmc_addon.core.volume import TISSUES


def test_thresholds_rise_from_lung_to_metal_within_the_hounsfield_scale():
    order = ["lung", "skin", "soft", "vessel", "bone", "compact", "metal"]
    thresholds = [TISSUES[key].threshold for key in order]
    assert sorted(TISSUES) == sorted(order)
    assert thresholds == sorted(thresholds)
    assert -1000 < thresholds[0] < thresholds[-1] < 3071
