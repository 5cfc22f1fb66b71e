# SPDX-License-Identifier: GPL-3.0-or-later
"""The nearest point of a higher rank, as the slow way finds it."""

import numpy as np
import pytest

from ctmc_addon.core import finish
from ctmc_addon.core.simplification.engine.ranked_points import RankedPoints


def test_the_nearest_point_of_a_higher_rank_is_found_as_by_looking_at_all():
    draw = np.random.default_rng(3)
    points = draw.random((3, 500), np.float32)
    component = np.sort(draw.integers(0, 40, 500)).astype(np.int32)
    rank = draw.permutation(40).astype(np.int32)
    tree = RankedPoints()
    finish(tree.prepare_steps(points, component, rank))
    asking = np.flatnonzero(rank[component] < 39)
    present = np.ones(40, bool)
    for _ in range(2):
        found, whose = tree.nearest(points[:, asking], rank[component[asking]])
        for number, vertex in enumerate(asking):
            higher = np.flatnonzero((rank[component] > rank[component[vertex]]) & present[component])
            away = np.linalg.norm(points[:, higher] - points[:, [vertex]], axis=0)
            assert found[number] == pytest.approx(away.min(), rel=1e-5)
            assert whose[number] == component[higher[np.argmin(away)]]
        present[rank < 20] = False
        tree.keep(present)
