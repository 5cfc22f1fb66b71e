# SPDX-License-Identifier: GPL-3.0-or-later
"""Choose the edges of a surface that may collapse, their order, and how many collapse at once.

A complex of several labels has other rules: see `complexes/collapsing.py`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags, Floats, Indices, Ints
from ...progress import PAUSE, Steps
from ..bounds.crossing_check import crosses_steps
from ..bounds.error_bound import ErrorBound
from ..policy import Policy
from .collapses import (
    Collapses,
    crosses_border_steps,
    flips_normal,
    makes_thin,
    shuffled,
    violates_link_condition_steps,
    with_normals_steps,
)
from .component_removal import Components
from .handles import Cuts, handle_cuts_steps

Surface = tuple[Indices, Flags]  # Numbers of faces, and flags of those that point inward.

SAMPLED = 1 << 15  # Sample at least this many costs to find how expensive the edges of a round are.
LARGEST = np.finfo(np.float32).max.view(np.int32)  # The bits of the largest cost that is not infinite.


class CollapseRules:
    """The rules of `CollapsingMesh`, whose arrays these are."""

    positions: Floats
    normals: Floats | None
    faces: Ints
    face_edges: Ints
    interface: Ints
    edges: Ints
    cost: Floats
    quadrics: Floats
    face_cost: float
    face_count: int
    component: Ints
    components: Components
    locked: Flags
    dummy: int
    original_vertex: Ints
    doubtful: Flags
    batch: bool
    bound: ErrorBound | None
    share: float
    policy: Policy

    def never_collapses(self, edges: Indices, first: Ints, second: Ints) -> Flags:
        """Return which of these edges may never collapse: both ends are locked."""
        return self.locked[first] & self.locked[second]

    def second_stays(self, first: Ints, second: Ints) -> Flags:
        """Return of which edges the second end stays and the first goes."""
        return self.locked[second]

    def violates_link_condition_steps(self, collapses: Collapses) -> Steps[Flags]:
        """Return which collapses would change how the surface is connected, (n,) bool."""
        counts = len(self.locked), len(self.cost)
        return violates_link_condition_steps(collapses, self.faces, self.face_edges, counts)

    def possible_steps(self, collapses: Collapses) -> Steps[Collapses]:
        """Return the allowed collapses, with normals; the other ones cost inf from now on."""
        violating = yield from self.violates_link_condition_steps(collapses)
        collapses = self.without(collapses, violating)
        yield PAUSE
        if self.batch:
            crossing = yield from crosses_border_steps(collapses, self.faces, self.edges, self.locked)
            collapses = self.without(collapses, crossing)
            yield PAUSE
        collapses = yield from with_normals_steps(collapses, self.positions, self.faces)
        collapses = self.without(collapses, flips_normal(collapses))
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
            cheapest = self.within_budget(collapses.select(~refused), budget)
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

    def priority(self, edges: Indices | None = None) -> Floats:
        """Return the numbers by which these edges, or all, are ordered; inf if an edge cannot be collapsed now."""
        return self.cost if edges is None else self.cost[edges]

    def within_budget(self, collapses: Collapses, budget: int) -> Collapses:
        """The cheapest of the collapses, of which `budget` remove no more than the faces that may go."""
        left = len(collapses.edges)
        if left <= budget:
            return collapses
        cheapest = np.zeros(left, bool)
        cheapest[np.argsort(self.priority(collapses.edges), kind="stable")[:budget]] = True
        return collapses.select(cheapest)

    def edges_joined(self, lost: Indices, stays: Indices) -> None:
        """Take in that removed edges became one with edges that stay."""

    def may_have_handles(self) -> bool:
        """Whether the Euler number leaves room for one: 2 for every component, 2 less for every handle."""
        vertices, edges = int((self.component >= 0).sum()), int((self.edges[0] != self.edges[1]).sum())
        return vertices - edges + self.face_count < 2 * self.components.count

    def handle_cuts_steps(self, longest: float) -> Steps[Cuts | None]:
        """Cuts of handles at loops whose edges are no longer than `longest`."""
        return (yield from handle_cuts_steps(self.positions, self.faces, self.edges, self.locked, longest))

    def handles_were_cut(self, loops: Ints) -> None:
        """Loops (n, 3) were cut: faces, edges and vertices of the caps have been added."""

    def brought_back(self, faces: NDArray[Any], edges: NDArray[Any], vertices: NDArray[Any]) -> None:
        """Take in faces, edges and vertices of the log that undone changes need and that follow those of the mesh."""

    def surfaces(self, interface: Ints) -> list[Surface]:
        """Return the surfaces that each keep a maximum error, from the interface of every face, (F,)."""
        return [(np.arange(len(interface)), np.zeros(len(interface), bool))]

    def was_undone(self) -> None:
        """Changes were undone: faces and edges are as before, costs not yet."""

    def normals_added(self, collapses: Collapses) -> Floats:
        """Return the normals to add to those of the vertices that stay, (3, n)."""
        assert self.normals is not None
        return self.normals[:, collapses.dropped]

    def cheapest(self, count: int) -> Indices:
        """About `count` of the cheapest edges, the cheapest first; more where many cost the same.

        Among edges that cost nearly the same the order is no visible one: along it many would wait for each other.
        """
        # Bits of floats that are not negative are ordered as they are, and whole numbers are compared faster.
        bits = (self.priority() + np.float32(0.0)).view(np.int32)
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
