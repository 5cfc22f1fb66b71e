# SPDX-License-Identifier: GPL-3.0-or-later
"""The rules of a complex of several labels while it is simplified: junctions, planes, and a share for every label."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Bytes, Flags, Floats, Indices, Ints
from ...mesh.labels.label_complex import ComplexMesh
from ...mesh.triangle_mesh import TriangleMesh
from ...progress import Steps
from ..engine.collapses import Collapses
from ..engine.columns import Columns
from ..engine.edge_collapse import CollapsingMesh
from ..engine.handles import Cuts, handle_cuts_steps
from ..engine.surface_rules import NOTHING, Surface, SurfaceRules
from ..policy import POLICY, Policy
from .flats import Flat, flattened, leaves_flat, on_flats
from .junctions import CORNER, INTERIOR, Junctions, interfaces_of, junctions_steps, violates_link_condition_steps
from .shares import Shares


def collapsing_complex(
    mesh: ComplexMesh, target: int, policy: Policy = POLICY, max_error: float | None = None, flats: Sequence[Flat] = ()
) -> tuple[CollapsingMesh, ComplexRules]:
    """Return the mesh of all triangles of a complex, and the rules that it follows."""
    rules = ComplexRules(mesh.sides, target, policy, flats)
    faces = mesh.faces.copy()
    faces[rules.turned] = faces[rules.turned][:, ::-1]
    outward = TriangleMesh(mesh.vertices, faces, mesh.normals)
    return CollapsingMesh(outward, max_error, policy, rules=rules, interface=rules.interface), rules


class ComplexRules(SurfaceRules):
    """The rules of a complex, and what it keeps of its faces, edges and vertices beside the columns of the mesh.

    labels : (2, interfaces) int32, the larger label of each interface, and the other
    interface : (F,) int32, of every triangle at first; the normal points out of the larger label
    turned : (F,) bool, whether the face of the complex given points the other way
    on_flats : (V,) uint8, the flats that each vertex stays on, as bits
    """

    loses_components_at_any_cost = False  # Where lines let no edge go, components stay.

    def __init__(self, sides: Ints, target: int, policy: Policy, flats: Sequence[Flat]) -> None:
        behind, front = sides.T
        self.turned = behind < front
        self.policy, self._flats = policy, flats
        self.flats: list[Flat] = []  # in the scale of the mesh
        self.on_flats: Bytes = np.empty(0, np.uint8)
        self.labels, self.interface = interfaces_of(sides)
        self.shares = Shares(self.labels, self.interface, target / len(sides), policy)
        self.rounds = 0
        self.logged: tuple[NDArray[Any], ...] = ()
        self.junctions = Junctions(*(np.empty(0, bool) for _ in range(4)))
        self.first_component = np.empty(0, np.int32)  # of every vertex of the complex given

    def share(self, policy: Policy) -> float:
        """Return the share of the edges examined in each round."""
        return policy.complex_share

    def vertices_steps(self, mesh: Columns) -> Steps[tuple[Flags, Ints, Ints]]:
        """Find the junctions: corners are locked."""
        self.flats = [flat.scaled(float(mesh.scale)) for flat in self._flats]
        self.on_flats = on_flats(self.flats, mesh.positions)
        self.junctions = yield from junctions_steps(
            mesh.faces, mesh.edges, mesh.face_edges, mesh.interface, self.labels, mesh.positions.shape[1]
        )
        rank, border = self.junctions.rank, self.junctions.border
        at_border = np.zeros(len(rank), bool)
        at_border[border] = True
        return rank == CORNER, border, np.flatnonzero((rank != INTERIOR) & ~at_border).astype(np.int32)

    def components_found(self, mesh: Columns, staying: Ints) -> None:
        """Take in the components; those that lie in a label cannot stay without the one around them."""
        components, self.first_component = mesh.components, mesh.component
        if components.count == 1:
            return
        # A volume is negative where a component cannot stay without its nearest larger one, like a cavity.
        within = np.zeros(components.count, bool)
        within[mesh.component[mesh.faces[0]]] = self.labels[1, mesh.interface] != 0
        joined = np.zeros(components.count, bool)
        joined[mesh.component[staying]] = True
        size = np.abs(components.volume)
        # The largest of every label stays.
        for side in self.labels:
            labelled = np.flatnonzero(side[mesh.interface] != 0)
            label = np.searchsorted(self.shares.labels, side)[mesh.interface[labelled]]
            component = mesh.component[mesh.faces[0, labelled]]
            largest = np.zeros(len(self.shares.labels))
            np.maximum.at(largest, label, size[component])
            components.removable[component[size[component] == largest[label]]] = False
        components.volume = np.where(joined, size, np.where(within, -size, components.volume))
        if mesh.limit is None:
            # What is around a component that stays must stay too.
            components.removable[components.nearest[joined]] = False

    def removed_faces(self, mesh: Columns, faces: Ints) -> Flags:
        """Return which faces (F, 3) of the given complex were removed with their components, (F,) bool."""
        return ~mesh.components.present[self.first_component[faces[:, 0]]]

    def never_collapses(self, mesh: Columns, edges: Indices, first: Ints, second: Ints) -> Flags:
        """Return which edges connect two corners, or two junctions and not along their line."""
        rank, locked = self.junctions.rank, mesh.locked
        a, b = np.take(rank, first), np.take(rank, second)
        a_locked, b_locked = np.take(locked, first), np.take(locked, second)
        across = (a > INTERIOR) & (b > INTERIOR) & ~self.junctions.edges[edges]
        # A vertex of a line stays on it, so it goes to no vertex that is locked beside the line.
        never = across | (a_locked & (b_locked | (b > a))) | (b_locked & (a > b))
        if self.flats:
            stays = (a > b) | a_locked, (b > a) | b_locked
            never |= leaves_flat((self.on_flats[first], self.on_flats[second]), stays)
        return never

    def second_stays(self, mesh: Columns, first: Ints, second: Ints) -> Flags:
        """Return of which edges the second end has the higher rank, is locked, or is on more flats."""
        rank, locked = self.junctions.rank, mesh.locked
        stays = (rank[second] > rank[first]) | (locked[second] & ~locked[first])
        if self.flats:
            stays |= (self.on_flats[second] & ~self.on_flats[first]) != 0
        return stays

    def place(self, mesh: Columns, ends: tuple[Ints, Ints], step: Floats, target: Floats) -> None:
        """Move the targets of edges between flats, unless they are locked, to a place on these."""
        if not self.flats:
            return
        first, second = ends
        bits = self.on_flats[first], self.on_flats[second]
        own = np.flatnonzero((bits[0] | bits[1] != 0) & ~mesh.locked[first] & ~mesh.locked[second])
        start, end = mesh.positions[:, first[own]], mesh.positions[:, second[own]]
        target[:, own] = flattened(self.flats, (bits[0][own], bits[1][own]), (start, end), target[:, own])
        step[:, own] = target[:, own] - (start + end) * np.float32(0.5)

    def violates_link_condition_steps(self, mesh: Columns, collapses: Collapses) -> Steps[Flags]:
        """Return which collapses would change how the complex is connected, (n,) bool."""
        return (
            yield from violates_link_condition_steps(
                collapses,
                mesh.faces,
                mesh.edges,
                mesh.face_edges,
                self.junctions,
                (self.labels != 0).all(axis=0)[mesh.interface],
            )
        )

    def priority(self, mesh: Columns, edges: Indices | None = None) -> Floats:
        """The cost of these edges, or of all, times the weight of their interface; of lines a share."""
        junctions = self.junctions
        if edges is None:
            interface, line, cost = junctions.interface, junctions.edges, mesh.cost
        else:
            interface, line, cost = junctions.interface[edges], junctions.edges[edges], mesh.cost[edges]
        weight = np.take(self.shares.weight, interface)
        weight[line] *= np.float32(self.policy.line_share)
        weight *= cost
        if self.shares.closed.any():
            weight[np.take(self.shares.closed, interface)] = np.inf
        return weight

    def begin_round(self, mesh: Columns) -> Indices:
        """Weigh the labels as their shares ask for; return the refused edges to try again."""
        self.rounds += 1
        if mesh.limit is not None:  # A maximum error sets no shares.
            return NOTHING
        self.shares.update(mesh.interface[mesh.faces[0] != mesh.dummy])
        if self.rounds % self.policy.retry:
            return NOTHING
        # Lines refuse more edges than a surface does, and soon allow them again.
        return np.flatnonzero(np.isinf(mesh.cost) & (mesh.edges[0] != mesh.dummy))

    def leaves_edges(self, mesh: Columns) -> bool:
        """Return whether an edge is left whose labels may give more."""
        return not self.shares.closed.any() or bool(np.isfinite(self.priority(mesh)).any())

    def within_budget(self, mesh: Columns, collapses: Collapses, budget: int) -> Collapses:
        """The cheapest of the collapses that remove no more than twice `budget` faces: some remove three or more."""
        counts = np.bincount(collapses.owner[collapses.vanishing], minlength=len(collapses.edges))
        if counts.sum() <= 2 * budget:
            return collapses
        order = np.argsort(self.priority(mesh, collapses.edges), kind="stable")
        selected = np.zeros(len(order), bool)
        selected[order[np.cumsum(counts[order]) <= 2 * budget]] = True
        if not selected.any():
            fewest = order[counts[order] <= 2 * budget][:1]
            selected[fewest] = True
            if not len(fewest):
                mesh.cost[collapses.edges] = np.inf
        return collapses.select(selected)

    def edges_joined(self, lost: Indices, stays: Indices) -> None:
        """An edge of a line that became one with another makes this one of the line."""
        self.junctions.edges[stays] |= self.junctions.edges[lost]

    def may_have_handles(self, mesh: Columns) -> bool:
        """Whether to look for handles: where walls meet, the Euler number does not tell."""
        return True

    def handle_cuts_steps(self, mesh: Columns, longest: float) -> Steps[Cuts | None]:
        """Cuts of handles within an interface, which stays in one piece."""
        junction = self.junctions.rank != INTERIOR
        locked = junction | mesh.locked | (self.on_flats != 0)
        columns = mesh.positions, mesh.faces, mesh.edges, locked
        return (yield from handle_cuts_steps(*columns, longest, junction, self.policy))

    def handles_were_cut(self, mesh: Columns, loops: Ints) -> None:
        """The caps lie in the interface of their loop."""
        sides, copies = np.repeat(mesh.interface[-len(loops) :], 3), np.zeros(loops.size, np.int8)
        turned = np.zeros(2 * len(loops), bool)
        self.turned = np.append(self.turned, turned)
        junctions = self.junctions
        junctions.edges = np.append(junctions.edges, np.zeros(loops.size, bool))
        junctions.interface = np.append(junctions.interface, sides)
        junctions.rank = np.append(junctions.rank, copies)
        on_none = np.zeros(loops.size, np.uint8)
        self.on_flats = np.append(self.on_flats, on_none)
        added = turned, sides, copies, on_none
        self.logged = tuple(np.append(*each) for each in zip(self.logged, added, strict=True))

    def normals_added(self, mesh: Columns, collapses: Collapses) -> Floats:
        """Return the normals of the vertices that go; a vertex of a line keeps its own."""
        rank = self.junctions.rank
        own = rank[collapses.kept] > rank[collapses.dropped]
        return np.where(own, np.float32(0.0), super().normals_added(mesh, collapses))

    def log_begins(self) -> None:
        """Keep the data of the faces, edges and vertices that a log numbers from now on."""
        self.logged = self.turned, self.junctions.interface, self.junctions.rank, self.on_flats

    def brought_back(self, faces: NDArray[Any], edges: NDArray[Any], vertices: NDArray[Any]) -> None:
        """Faces, edges and vertices, by their numbers in the log, follow those of the complex."""
        turned, edge_interface, rank, flats = self.logged
        self.turned = np.append(self.turned, turned[faces])
        junctions = self.junctions
        junctions.edges = np.append(junctions.edges, np.zeros(len(edges), bool))
        junctions.interface = np.append(junctions.interface, edge_interface[edges])
        junctions.rank = np.append(junctions.rank, rank[vertices])
        self.on_flats = np.append(self.on_flats, flats[vertices])

    def was_undone(self, mesh: Columns) -> None:
        """Find the junction edges again: of two merged edges only one may be part of a line."""
        left = mesh.face_edges[:, mesh.faces[0] != mesh.dummy]
        self.junctions.edges = np.bincount(left.ravel(), minlength=len(mesh.cost)) != 2

    def compact(self, faces: Indices, edges: Indices, vertices: Indices) -> None:
        """Take in the numbers of the faces, edges and vertices that are left."""
        self.turned = self.turned[faces]
        junctions = self.junctions
        junctions.edges, junctions.interface = junctions.edges[edges], junctions.interface[edges]
        junctions.rank, self.on_flats = junctions.rank[vertices], self.on_flats[vertices]

    def surfaces(self, interface: Ints) -> list[Surface]:
        """The surface of every label."""
        surfaces = []
        for label in self.shares.labels:
            numbers = np.flatnonzero((self.labels == label).any(axis=0)[interface])
            surfaces.append((numbers, self.labels[1, interface[numbers]] == label))
        return surfaces

    def complex_mesh(self, collapsing: CollapsingMesh) -> ComplexMesh:
        """Return the complex as it is now, without the vertices that are not used any more."""
        left = collapsing.faces[0] != collapsing.dummy
        mesh, turned = collapsing.mesh(), self.turned[left]
        faces, sides = mesh.faces.copy(), self.labels[:, collapsing.interface[left]].T.copy()
        faces[turned], sides[turned] = faces[turned][:, ::-1], sides[turned][:, ::-1]
        return ComplexMesh(mesh.vertices, faces, sides, mesh.normals)
