# SPDX-License-Identifier: GPL-3.0-or-later
"""Rounds of many collapses against the strict order of a heap."""

import numpy as np
import pytest
from meshes import assert_sound, icosphere, spread
from oracles.strict_order import strictly_simplified

from ctmc_addon.core import TriangleMesh, simplify
from ctmc_addon.core.mesh.distance.triangle_tree import TriangleTree


@pytest.mark.parametrize(("reduction", "times"), [(0.5, 1.12), (0.8, 1.06)])
def test_rounds_come_near_to_the_strict_order(reduction, times):
    ball = icosphere(3)
    away = np.random.default_rng(5).uniform(0.97, 1.03, (len(ball.vertices), 1)).astype(np.float32)
    full = TriangleMesh(ball.vertices * away, ball.faces)
    strict, rounds = strictly_simplified(full, reduction), simplify(full, reduction=reduction)
    assert_sound(strict)
    assert len(strict.faces) == len(rounds.faces)
    assert mean_distance(full, rounds) <= times * mean_distance(full, strict)


def mean_distance(one, other):
    """Mean distance between two surfaces, both ways."""
    there, back = (TriangleTree(b).distances(spread(a, 4000, 1)) for a, b in ((one, other), (other, one)))
    return float(there.mean() + back.mean()) / 2
