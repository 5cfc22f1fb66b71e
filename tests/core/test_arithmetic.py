# SPDX-License-Identifier: GPL-3.0-or-later
"""Roots and tangents of our own are those of the system's library but for the last bits."""

import math

import numpy as np
import pytest

from ctmc_addon.core.arithmetic import cube_root, natural_logarithm, power_of_two, tangent


def test_a_cube_root_cubed_is_the_number():
    draw = np.random.default_rng(0)
    numbers = draw.random(10_000) * 10.0 ** draw.integers(-200, 200, 10_000)
    root = cube_root(numbers)
    np.testing.assert_allclose(root * root * root, numbers, rtol=16 * 2.0**-53)


def test_a_cube_root_of_nothing_is_nothing():
    assert cube_root(np.array([0.0, 8.0])).tolist() == [0.0, 2.0]
    assert float(cube_root(0.0)) == 0.0


def test_a_tangent_is_the_systems_but_for_the_last_bits():
    degrees = np.linspace(0.0, 60.0, 2001).tolist()
    assert [tangent(angle) for angle in degrees] == pytest.approx(
        [math.tan(math.radians(angle)) for angle in degrees], rel=16 * 2.0**-53
    )


def test_powers_of_two_and_logarithms_are_the_systems_but_for_the_last_bits():
    exponents = np.linspace(-60.0, 60.0, 2001).tolist()
    assert [power_of_two(each) for each in exponents] == pytest.approx([2.0**each for each in exponents], rel=1e-15)
    numbers = [2.0**each for each in exponents] + [0.7, 0.7 - 2**-53, 1 + 2**-52]
    assert [natural_logarithm(each) for each in numbers] == pytest.approx(
        [math.log(each) for each in numbers], rel=1e-15, abs=1e-16
    )
