# SPDX-License-Identifier: GPL-3.0-or-later
"""Gray bodies in turned poses between voxels, against closed forms; `benchmarks.solid_accuracy` has more of them."""

import numpy as np
import pytest

from benchmarks.solid_accuracy import LIMITS, Measured, Trial
from benchmarks.solid_forms import Posed, ball, box, capsule, poses, torus

pytestmark = pytest.mark.once

POSE = poses()[-1]


def trial(make, across, label=False):
    """A trial that checks that all parts are closed and do not cross, and what it finds."""
    found = Measured()
    return Trial(Posed(make(across / 2), POSE), across, label, found), found


def assert_walls(found):
    off = np.concatenate(found.walls)
    assert np.abs(off).mean() < LIMITS["mean"]
    assert np.quantile(np.abs(off), 0.95) < LIMITS["95"]
    assert off.min() > -LIMITS["thinnest"]


def assert_volumes(found, names):
    for name in names:
        assert np.abs(found.volumes[name]).max() < LIMITS["volume"], name


def test_a_ball_of_twenty_voxels_is_hollowed_thickened_cut_pegged_and_drained():
    ball_trial, found = trial(ball, 20)
    ball_trial.run()
    assert_walls(found)
    assert_volumes(found, ["hollow", "thicken", "thicken and hollow", "halves", "pegged halves"])
    assert np.abs(np.concatenate(found.gaps)).max() < LIMITS["gap"]
    assert np.concatenate(found.rims).max() < LIMITS["rims"]


def test_a_thickened_ball_is_nearer_to_its_closed_form_than_the_surface_it_is_made_of():
    ball_trial, found = trial(ball, 12)
    ball_trial.thicken_and_hollow()
    plain = ball_trial.plain.volume / ball_trial.exact(0) - 1
    assert -0.02 < plain < -0.015
    assert abs(found.volumes["thicken"][0]) < 0.3 * abs(plain)


def test_a_capsule_and_a_box_are_hollowed_and_thickened():
    for make, names in ((capsule, ["hollow", "thicken", "thicken and hollow"]), (box, ["hollow"])):
        one, found = trial(make, 20)
        one.thicken_and_hollow()
        assert_walls(found)
        assert_volumes(found, names)
    # Marching Cubes bevels the edges of the box; all that is made of it lacks them.
    assert -0.015 < found.volumes["thicken"][0] < -0.01


def test_a_torus_keeps_its_wall_and_its_rims():
    one, found = trial(torus, 10)
    one.thicken_and_hollow()
    one.cut((1.0, 2.0, -3.0))
    assert_walls(found)
    assert_volumes(found, ["halves"])
    assert np.concatenate(found.rims).max() < LIMITS["rims"]


def test_a_label_has_the_wall_and_the_volume_of_the_body_that_it_is_of():
    one, found = trial(ball, 20, label=True)
    one.thicken_and_hollow()
    assert_walls(found)
    assert_volumes(found, ["hollow", "thicken", "thicken and hollow"])
