# SPDX-License-Identifier: GPL-3.0-or-later
"""The edges of one round: the cheapest first, and none in another's way."""

import numpy as np
import pytest
from meshes import icosphere

from ctmc_addon.core import TriangleMesh, finish
from ctmc_addon.core.simplification.engine.collapses import independent_set_steps, with_normals_steps
from ctmc_addon.core.simplification.engine.edge_collapse import CollapsingMesh


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


def test_what_the_link_condition_refuses_is_what_shared_neighbors_say(work):
    """With borders, and vertices with three neighbors."""
    rng = np.random.default_rng(4)
    mesh = TriangleMesh(work.positions[:, :-1].T.copy(), work.faces[:, rng.random(work.face_count) > 0.02].T.copy())
    work = CollapsingMesh(mesh)
    finish(work.prepare_steps())
    refused = 0
    while True:
        candidates = rng.permutation(np.flatnonzero(np.isfinite(work.cost)))
        collapses = work.collapses(finish(independent_set_steps(candidates, work.edges, work.positions.shape[1])))
        violates = finish(work.rules.violates_link_condition_steps(work, collapses))
        assert violates.tolist() == [folds(work, edge) for edge in collapses.edges]
        refused += int(violates.sum())
        if violates.all():
            break
        collapses = finish(with_normals_steps(collapses.select(~violates), work.positions, work.faces))
        finish(work.merge_steps(collapses, False))
    assert refused > 10


def folds(work, edge):
    """Whether the ends share other than two neighbors, or one that has but one more."""
    neighbors = {}
    for first, second in work.edges[:, work.edges[0] != work.edges[1]].T.tolist():
        neighbors.setdefault(first, set()).add(second)
        neighbors.setdefault(second, set()).add(first)
    first, second = work.edges[:, edge].tolist()
    shared = neighbors[first] & neighbors[second]
    return len(shared) != 2 or any(len(neighbors[each]) == 3 and not work.locked[each] for each in shared)
