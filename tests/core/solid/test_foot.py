# SPDX-License-Identifier: GPL-3.0-or-later
"""Feet of balls, boxes and cut solids, whose shadows have a closed form."""

import numpy as np
import pytest

from ctmc_addon.core import MeshError, finish
from ctmc_addon.core.solid import HalfSpace
from ctmc_addon.core.solid.placing.cubes import lowest_steps
from ctmc_addon.core.solid.placing.foot import foot_steps

pytestmark = pytest.mark.once

LOW, HIGH = np.array([-30.0, -31, -29]), np.array([33.0, 30, 30])


def steps_of(depth):
    def depth_steps(points):
        yield from ()
        return depth(points)

    return depth_steps


def ball(radius, center=(0.0, 0.0, 0.0)):
    return lambda points: radius - np.linalg.norm(points - np.array(center)[:, None], axis=0)


def box(half_sides):
    """A box about the origin with its exact distance."""

    def depth(points):
        over = np.abs(points) - np.array(half_sides, float)[:, None]
        return -np.linalg.norm(np.maximum(over, 0), axis=0) - np.minimum(over.max(axis=0), 0)

    return depth


def foot(depth, base):
    return finish(foot_steps(steps_of(depth), LOW, HIGH, base))


def crowd(low, high, count=3000, seed=2):
    return np.random.default_rng(seed).uniform(low, high, (count, 3)).T


def disc(points, radius, low, high):
    return np.minimum(np.minimum(points[2] - low, high - points[2]), radius - np.linalg.norm(points[:2], axis=0))


def test_the_foot_of_a_ball_is_a_disc():
    made = foot(ball(20.0, (1.0, 2.0, 3.0)), 3.0)
    assert made.low == pytest.approx(-17, abs=0.011)
    assert made.high - made.low == 3.0
    # At 3 mm the ball has a radius of sqrt(20² - 17²).
    points = crowd((-25, -25, -22), (25, 25, -9))
    exact = disc(points - [[1.0], [2.0], [0.0]], np.sqrt(111) + 3, made.low, made.high)
    near = np.abs(exact) < 3
    assert near.sum() > 300
    np.testing.assert_allclose(made.at(points)[near], exact[near], atol=0.012)
    assert ((made.at(points) > 0) == (exact > 0))[np.abs(exact) > 0.02].all()


def test_the_foot_of_a_box_has_round_corners():
    made = foot(box((10, 7, 5)), 2.0)
    assert (made.low, made.high) == pytest.approx((-5, -3), abs=1e-6)
    points = crowd((-14, -11, -7), (14, 11, -1))
    over = np.maximum(np.abs(points[:2]) - [[10.0], [7.0]], 0)
    exact = np.minimum(np.minimum(points[2] + 5, -3 - points[2]), 2 - np.linalg.norm(over, axis=0))
    exact, found = np.maximum(exact, -3), np.maximum(made.at(points), -3)  # Farther points count as 3 mm away.
    beside_corners = (over > 0).all(axis=0)
    assert 50 < beside_corners.sum() < 1000
    np.testing.assert_allclose(found[~beside_corners], exact[~beside_corners], atol=0.01)
    np.testing.assert_allclose(found, exact, atol=0.075)


def test_the_shadow_of_an_overhang_counts():
    # A ball of 4 mm on a foot of 6 mm: its widest part stands over the rest.
    made = foot(ball(4.0), 6.0)
    assert made.at(np.array([[4.0 + 5.9, 4 + 6.1], [0, 0], [-2.0, -2.0]])) == pytest.approx([0.1, -0.1], abs=0.01)


def test_two_legs_have_one_foot_where_they_are_near():
    def legs(points):
        return np.maximum(ball(5.0, (-8, 0, 0))(points), ball(5.0, (8, 0, 1))(points))

    made = foot(legs, 4.0)
    assert made.low == pytest.approx(-5, abs=0.011)
    # At -1 the legs have radii of sqrt(24) and sqrt(21).
    first, second = np.sqrt(24) + 4, np.sqrt(21) + 4
    middle = np.array([[0.0, -8, -8, 8, 8], [0, first - 0.1, first + 0.1, second - 0.1, second + 0.1], [-2] * 5])
    found = made.at(middle)
    np.testing.assert_allclose(found[1:], [0.1, -0.1, 0.1, -0.1], atol=0.012)
    assert found[0] == pytest.approx(first - 8, abs=0.012)


def test_a_part_of_a_cut_stands_on_its_own_lowest_place():
    plane = HalfSpace((0, 0, 0), (1.0, 0, 2.0))

    def part(points):
        return np.minimum(ball(20.0)(points), plane.at(points))

    made = foot(part, 3.0)
    # The rim of the cut is lowest at x = 20 * 2 / sqrt(5), z = -20 / sqrt(5).
    assert made.low == pytest.approx(-20 / np.sqrt(5), abs=0.02)
    # The part below z1 reaches from x = -2 z1, where the plane is, to the ball.
    z1 = made.low + 3
    x0, x1 = -2 * z1, np.sqrt(400 - z1 * z1)
    x = np.array([x0 - 2.9, x0 - 3.1, x1 + 2.9, x1 + 3.1])
    found = made.at(np.stack([x, 0 * x, np.full(4, z1 - 1.5)]))
    np.testing.assert_allclose(found, [0.1, -0.1, 0.1, -0.1], atol=0.03)


@pytest.mark.parametrize("center", [(0, 0, 0), (3.3, 1.7, 5.1)])
def test_the_lowest_place_is_found(center):
    lowest = finish(lowest_steps(steps_of(ball(11.0, center)), LOW, HIGH))
    assert lowest == pytest.approx(center[2] - 11, abs=0.011)


def test_the_lowest_place_of_a_small_component_is_found():
    small = ball(0.7, (12.3, -17.1, -20.0))
    depth = steps_of(lambda points: np.maximum(ball(11.0)(points), small(points)))
    assert finish(lowest_steps(depth, LOW, HIGH)) == pytest.approx(-20.7, abs=0.011)


def test_nothing_has_no_foot():
    with pytest.raises(MeshError, match="leave out --base"):
        foot(lambda points: -1.0 - np.linalg.norm(points, axis=0), 3.0)
