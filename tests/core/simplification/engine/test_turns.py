# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a triangle may turn, in closed form; the policy says it, for edges and for clusters."""

from dataclasses import replace

import numpy as np
import pytest
from meshes import icosphere

from ctmc_addon.core import Budget, finish
from ctmc_addon.core.simplification.engine.collapses import turns_too_far
from ctmc_addon.core.simplification.policy import POLICY
from ctmc_addon.core.simplification.simplify import simplification_steps


@pytest.mark.parametrize("degrees", [30.0, 60.0, 80.0])
def test_a_normal_may_turn_up_to_the_angle_with_this_cosine(degrees):
    angles = np.radians([0.0, degrees - 0.1, degrees + 0.1, 120.0, 180.0])
    after = np.array([3.0 * np.cos(angles), 3.0 * np.sin(angles), 0.0 * angles], np.float32)  # Lengths do not matter.
    before = np.tile(np.array([[0.5], [0.0], [0.0]], np.float32), len(angles))
    turned = turns_too_far(before, after, float(np.cos(np.radians(degrees))))
    assert turned.tolist() == [False, False, True, True, True]
    assert turns_too_far(before, 0.0 * after, 0.2).all()


def test_a_policy_that_lets_no_triangle_turn_keeps_a_sphere_as_it_is():
    mesh = icosphere(3)
    still = replace(POLICY, least_turn=1.0)
    kept = finish(simplification_steps(mesh, target_faces=200, budget=Budget(threads=1), policy=still)).mesh
    assert len(kept.faces) == len(mesh.faces) == 1280
    turning = finish(simplification_steps(mesh, target_faces=200, budget=Budget(threads=1))).mesh
    assert len(turning.faces) == 200
