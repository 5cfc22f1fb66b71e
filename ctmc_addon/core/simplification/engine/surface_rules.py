# SPDX-License-Identifier: GPL-3.0-or-later
"""The rules of one surface while it is simplified: its borders stay, and a handle shows in its Euler number.

A complex of several labels has rules of its own: see `complexes/complex_rules.py`. All else is the same for both.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags, Floats, Indices, Ints
from ...progress import Steps
from ..policy import Policy
from .collapses import Collapses, locked_vertices_steps, violates_link_condition_steps
from .columns import Columns
from .handles import Cuts, handle_cuts_steps

Surface = tuple[Indices, Flags]  # Numbers of faces, and flags of those that point inward.
NOTHING = np.empty(0, np.int64)


class SurfaceRules:
    """The rules of one surface; they keep no data of their own."""

    loses_components_at_any_cost = True
    """Whether components go at any cost once no edge can."""

    def share(self, policy: Policy) -> float:
        """Return the share of the edges examined in each round."""
        return policy.share

    def vertices_steps(self, mesh: Columns) -> Steps[tuple[Flags, Ints, Ints]]:
        """Find the vertices that are locked, (V,) bool, those at a border, and those whose components stay."""
        border, non_manifold = yield from locked_vertices_steps(mesh.faces, mesh.edges, mesh.face_edges)
        locked = np.zeros(mesh.positions.shape[1], bool)
        locked[border] = locked[non_manifold] = True
        return locked, border, np.concatenate([border, non_manifold]) if mesh.batch else non_manifold

    def components_found(self, mesh: Columns, staying: Ints) -> None:
        """Take in the components; those with a vertex of `staying` are never removed."""

    def never_collapses(self, mesh: Columns, edges: Indices, first: Ints, second: Ints) -> Flags:
        """Return which of these edges may never collapse: both ends are locked."""
        return mesh.locked[first] & mesh.locked[second]

    def second_stays(self, mesh: Columns, first: Ints, second: Ints) -> Flags:
        """Return of which edges the second end stays and the first goes."""
        return mesh.locked[second]

    def place(self, mesh: Columns, ends: tuple[Ints, Ints], step: Floats, target: Floats) -> None:
        """Move the targets of edges, (3, n), and the steps to them from the middle, to allowed places."""

    def violates_link_condition_steps(self, mesh: Columns, collapses: Collapses) -> Steps[Flags]:
        """Return which collapses would change how the surface is connected, (n,) bool."""
        counts = len(mesh.locked), len(mesh.cost)
        return violates_link_condition_steps(collapses, mesh.faces, mesh.face_edges, counts)

    def begin_round(self, mesh: Columns) -> Indices:
        """Begin a round; return the refused edges to try again."""
        return NOTHING

    def leaves_edges(self, mesh: Columns) -> bool:
        """Return whether an edge that has a cost may collapse."""
        return True

    def priority(self, mesh: Columns, edges: Indices | None = None) -> Floats:
        """Return the numbers by which these edges, or all, are ordered; inf if an edge cannot be collapsed now."""
        return mesh.cost if edges is None else mesh.cost[edges]

    def within_budget(self, mesh: Columns, collapses: Collapses, budget: int) -> Collapses:
        """Return the cheapest of the collapses, of which `budget` remove no more than the faces that may go."""
        left = len(collapses.edges)
        if left <= budget:
            return collapses
        cheapest = np.zeros(left, bool)
        cheapest[np.argsort(self.priority(mesh, collapses.edges), kind="stable")[:budget]] = True
        return collapses.select(cheapest)

    def normals_added(self, mesh: Columns, collapses: Collapses) -> Floats:
        """Return the normals to add to those of the vertices that stay, (3, n)."""
        assert mesh.normals is not None
        return mesh.normals[:, collapses.dropped]

    def edges_joined(self, lost: Indices, stays: Indices) -> None:
        """Take in that removed edges became one with edges that stay."""

    def may_have_handles(self, mesh: Columns) -> bool:
        """Return whether the Euler number leaves room for a handle: 2 for each component, 2 less for each handle."""
        vertices, edges = int((mesh.component >= 0).sum()), int((mesh.edges[0] != mesh.edges[1]).sum())
        return vertices - edges + mesh.face_count < 2 * mesh.components.count

    def handle_cuts_steps(self, mesh: Columns, longest: float) -> Steps[Cuts | None]:
        """Return cuts of handles at loops whose edges are no longer than `longest`."""
        columns = mesh.positions, mesh.faces, mesh.edges, mesh.locked
        return (yield from handle_cuts_steps(*columns, longest, policy=mesh.policy))

    def handles_were_cut(self, mesh: Columns, loops: Ints) -> None:
        """Take in faces, edges and vertices of the caps of loops (n, 3) that were cut."""

    def log_begins(self) -> None:
        """Keep the data of the faces, edges and vertices that a log numbers from now on."""

    def brought_back(self, faces: NDArray[Any], edges: NDArray[Any], vertices: NDArray[Any]) -> None:
        """Take in faces, edges and vertices, by their numbers in the log, that now follow those of the mesh."""

    def was_undone(self, mesh: Columns) -> None:
        """Take in that changes were undone: faces and edges are as before, costs not yet."""

    def compact(self, faces: Indices, edges: Indices, vertices: Indices) -> None:
        """Take in the numbers of the faces, edges and vertices that are left."""

    def surfaces(self, interface: Ints) -> list[Surface]:
        """Return the surfaces that each keep a maximum error, from the interface of every face, (F,)."""
        return [(np.arange(len(interface)), np.zeros(len(interface), bool))]


ONE_SURFACE = SurfaceRules()
