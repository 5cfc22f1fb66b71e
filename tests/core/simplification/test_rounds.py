# SPDX-License-Identifier: GPL-3.0-or-later
"""The edges of one round: the cheapest first, and none in another's way."""

import numpy as np
import pytest
from meshes import icosphere

from ctmc_addon.core import TriangleMesh, finish
from ctmc_addon.core.simplification.collapses import independent_set_steps
from ctmc_addon.core.simplification.edge_collapse import CollapsingMesh


@pytest.fixture
def work():
    """A ball of 1,280 triangles whose vertices lie up to a hundredth off it."""
    mesh = icosphere(3)
    away = np.random.default_rng(2).uniform(0.99, 1.01, (len(mesh.vertices), 1)).astype(np.float32)
    work = CollapsingMesh(TriangleMesh(mesh.vertices * away, mesh.faces))
    finish(work.prepare_steps())
    return work


def test_the_cheapest_edges_come_in_the_order_of_their_cost(work):
    cost = work.cost[work.cheapest(300)].astype(float)
    assert len(cost) == 301
    assert cost.max() == np.sort(work.cost)[300]
    assert (cost[1:] >= cost[:-1] * (1 - 2.0**-7)).all()


def test_of_edges_that_meet_at_a_triangle_the_cheapest_collapses(work):
    candidates = work.cheapest(len(work.cost) - 1)
    chosen = finish(independent_set_steps(candidates, work.edges, work.positions.shape[1]))
    assert chosen[0] == candidates[0]
    neighbors = [set() for _ in range(work.positions.shape[1])]
    for first, second in work.edges.T:
        neighbors[first] |= {second}
        neighbors[second] |= {first}
    taken = set()
    for edge in chosen:
        ends = set(work.edges[:, edge])
        assert not taken & ends
        taken |= ends.union(*(neighbors[end] for end in ends))
