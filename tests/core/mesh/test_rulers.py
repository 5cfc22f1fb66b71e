# SPDX-License-Identifier: GPL-3.0-or-later
"""Distance and angle of points, against closed forms."""

import math

import pytest

from ctmc_addon.core.mesh import angle_at, distance_between


@pytest.mark.parametrize("degrees", [1e-6, 1e-3, 30.0, 90.0, 135.0, 179.999999, 180.0])
@pytest.mark.parametrize("length", [1e-3, 7.0, 1e4])
def test_an_angle_is_the_one_it_was_made_of_at_any_length(degrees, length):
    turned = math.radians(degrees)
    last = (5.0 + length * math.cos(turned), 5.0 + length * math.sin(turned), 5.0)
    assert angle_at((8.0, 5.0, 5.0), (5.0, 5.0, 5.0), last) == pytest.approx(degrees, rel=1e-6, abs=1e-7)


def test_a_corner_on_another_point_has_no_angle():
    assert math.isnan(angle_at((1.0, 1.0, 1.0), (1.0, 1.0, 1.0), (2.0, 0.0, 0.0)))


def test_a_distance_is_the_same_both_ways():
    a, b = (1.0, -2.0, 3.0), (-3.0, 1.0, 15.0)
    assert distance_between(a, b) == distance_between(b, a) == 13.0
