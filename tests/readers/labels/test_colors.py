# SPDX-License-Identifier: GPL-3.0-or-later
"""CIELab of DICOM to sRGB: the numbers of highdicom 0.28.2, `CIELabColor.from_rgb(...).value`."""

from __future__ import annotations

import pytest

from ctmc_addon.readers.labels.colors import rgb_of_cielab


@pytest.mark.parametrize(
    ("rgb", "stored"),
    [
        ((255, 0, 0), (34886, 53484, 50172)),
        ((0, 255, 0), (57498, 10747, 54274)),
        ((0, 0, 255), (21170, 53250, 5175)),
        ((255, 255, 255), (65535, 32897, 32893)),
        ((0, 0, 0), (0, 32896, 32896)),
        ((128, 64, 200), (27450, 46654, 17381)),
        ((17, 34, 51), (8272, 32694, 29476)),
        ((255, 165, 0), (49107, 39048, 53188)),
    ],
)
def test_every_color_comes_back_to_the_last_bit(rgb, stored):
    assert rgb_of_cielab(stored) == rgb


def test_colors_that_srgb_cannot_show_stay_within_its_limits():
    for stored in ((0, 0, 0), (65535, 65535, 65535), (0, 65535, 0), (65535, 0, 65535)):
        assert all(0 <= part <= 255 for part in rgb_of_cielab(stored))
