# SPDX-License-Identifier: GPL-3.0-or-later
"""Choose the edges of a round by their order, and keep those that may collapse."""

from __future__ import annotations

import numpy as np

from ...arrays import Flags, Indices, Ints
from ...progress import PAUSE, Steps
from ..bounds.crossing_check import crosses_steps
from .collapses import Collapses, crosses_border_steps, flips_normal, makes_thin, shuffled, with_normals_steps
from .columns import Columns
from .surface_rules import SurfaceRules

SAMPLED = 1 << 15  # Sample at least this many costs to find how expensive the edges of a round are.
LARGEST = np.finfo(np.float32).max.view(np.int32)  # The bits of the largest cost that is not infinite.


class EdgeChoice(Columns):
    """Choose edges by the rules of a mesh."""

    rules: SurfaceRules

    def possible_steps(self, collapses: Collapses) -> Steps[Collapses]:
        """Return the allowed collapses, with normals; the other ones cost inf from now on."""
        violating = yield from self.rules.violates_link_condition_steps(self, collapses)
        collapses = self.without(collapses, violating)
        yield PAUSE
        if self.batch:
            crossing = yield from crosses_border_steps(collapses, self.faces, self.edges, self.locked)
            collapses = self.without(collapses, crossing)
            yield PAUSE
        collapses = yield from with_normals_steps(collapses, self.positions, self.faces)
        collapses = self.without(collapses, flips_normal(collapses, self.policy.least_turn))
        yield PAUSE
        if self.policy.thinnest:
            thin = makes_thin(collapses, self.positions, self.faces, self.policy.thinnest)
            collapses = self.without(collapses, thin)
            yield PAUSE
        if self.bound is not None:
            moved = collapses.moved(self.positions)
            yield PAUSE
            exceeding = yield from self.bound.exceeded_steps(collapses, self.faces, self.interface, moved)
            collapses = self.without(collapses, exceeding)
            yield PAUSE
        return collapses

    def without(self, collapses: Collapses, refused: Flags) -> Collapses:
        """Return the collapses without the refused ones, (n,) bool, which cost inf from now on."""
        self.cost[collapses.edges[refused]] = np.inf
        return collapses.select(~refused)

    @property
    def tests_crossings(self) -> bool:
        """Whether collapses are tested for crossings before they are done: once some have been undone at the end."""
        return bool(self.doubtful.any())

    def uncrossed_steps(self, collapses: Collapses, budget: int) -> Steps[tuple[Collapses, float]]:
        """The cheapest collapses within the budget that make nothing cross, and their share of those tried."""
        alive = self.faces[0] != self.dummy
        refused, tried = np.zeros((2, len(collapses.edges)), bool)
        while True:
            cheapest = self.rules.within_budget(self, collapses.select(~refused), budget)
            done = np.isin(collapses.edges, cheapest.edges)
            if not (changed := done ^ tried).any():
                break
            crossing = yield from crosses_steps(collapses, self.positions, self.faces, alive, done, changed)
            refused, tried = refused | crossing, done
        self.cost[collapses.edges[refused]] = np.inf
        return cheapest, len(cheapest.edges) / max(len(cheapest.edges) + int(refused.sum()), 1)

    def doubt(self, vertices: Ints) -> None:
        """Note vertices at which triangles have come to cross, and lock those noted twice."""
        numbers = self.original_vertex[vertices]
        self.locked[vertices[self.doubtful[numbers]]] = True
        self.doubtful[numbers] = True

    def cheapest(self, count: int) -> Indices:
        """About `count` of the cheapest edges, the cheapest first; more where many cost the same.

        Among edges that cost nearly the same the order is no visible one: along it many would wait for each other.
        """
        # Bits of floats that are not negative are ordered as they are, and whole numbers are compared faster.
        bits = (self.rules.priority(self) + np.float32(0.0)).view(np.int32)
        every = max(1, len(bits) // SAMPLED)
        last = count // every
        edges = np.flatnonzero(bits <= min(np.partition(bits[::every], last)[last], LARGEST))
        # Plain numbers are sorted several times faster than their places, so these are the last 32 bits of them.
        coarse = bits[edges].view(np.uint32) & np.uint32(0xFFFF0000)
        keys = (coarse | shuffled(edges) >> np.uint32(16)).astype(np.uint64)
        keys = keys << np.uint64(32) | edges.astype(np.uint64)
        keys.sort()
        return (keys & np.uint64(0xFFFFFFFF)).astype(np.int64)

    def _update_face_cost(self, collapses: Collapses) -> None:
        """Raise `face_cost` to that of a round: a quadric is an area times a squared distance, its trace the area."""
        middle = len(collapses.edges) // 2
        traces = [self.quadrics[row, end] for end in (collapses.kept, collapses.dropped) for row in (0, 3, 5)]
        area = np.partition(sum(traces[1:], traces[0]), middle)[middle]
        cost = np.partition(self.cost[collapses.edges], middle)[middle]
        self.face_cost = max(self.face_cost, 0.5 * float(np.sqrt(cost * area)))
