# SPDX-License-Identifier: GPL-3.0-or-later
"""A complex whose edges collapse in rounds: `CollapsingMesh` with junctions, and a share for every label."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Bytes, Flags, Floats, Indices, Ints
from ...mesh.labels.label_complex import ComplexMesh
from ...mesh.triangle_mesh import TriangleMesh
from ...progress import Steps
from ..engine.collapse_rules import Surface
from ..engine.collapses import Collapses
from ..engine.edge_collapse import CollapsingMesh
from ..engine.handles import Cuts, handle_cuts_steps
from ..engine.quadrics import EdgeQuadric
from ..policy import POLICY, Policy
from .flats import Flat, flattened, leaves_flat, on_flats
from .junctions import CORNER, INTERIOR, Junctions, interfaces_of, junctions_steps, violates_link_condition_steps
from .shares import Shares


class CollapsingComplex(CollapsingMesh):
    """A complex while it is simplified.

    labels : (2, interfaces) int32, the larger label of each interface, and the other
    interface : (F,) int32, as of `CollapsingMesh`; the normal points out of the larger label
    turned : (F,) bool, whether the face of the complex given points the other way
    on_flats : (V,) uint8, the flats that each vertex stays on, as bits
    """

    def __init__(
        self,
        mesh: ComplexMesh,
        target: int,
        policy: Policy = POLICY,
        max_error: float | None = None,
        flats: Sequence[Flat] = (),
    ) -> None:
        behind, front = mesh.sides.T
        turned = behind < front
        faces = mesh.faces.copy()
        faces[turned] = faces[turned][:, ::-1]
        super().__init__(TriangleMesh(mesh.vertices, faces, mesh.normals), max_error, policy)
        self.share = policy.complex_share
        self.flats = [flat.scaled(float(self.scale)) for flat in flats]
        self.on_flats: Bytes = on_flats(self.flats, self.positions)
        self.turned = turned
        self.labels, self.interface = interfaces_of(mesh.sides)
        self.shares = Shares(self.labels, self.interface, target / len(mesh.faces), policy)
        self.rounds = 0
        self.logged: tuple[NDArray[Any], ...] = ()
        self.junctions = Junctions(*(np.empty(0, bool) for _ in range(4)))
        self.first_component = np.empty(0, np.int32)  # of every vertex of the complex given

    def prepare_vertices_steps(self) -> Steps[None]:
        """Find the junctions, and the components."""
        self.junctions = yield from junctions_steps(
            self.faces, self.edges, self.face_edges, self.interface, self.labels, self.positions.shape[1]
        )
        rank = self.junctions.rank
        self.locked = rank == CORNER
        at_border = np.zeros(len(rank), bool)
        at_border[self.junctions.border] = True
        staying = np.flatnonzero((rank != INTERIOR) & ~at_border).astype(np.int32)
        yield from self.prepare_components_steps(self.junctions.border, staying)

    def prepare_components_steps(self, border: Ints, staying: Ints) -> Steps[None]:
        """Find the components; those that lie in a label cannot stay without the one around them."""
        yield from super().prepare_components_steps(border, staying)
        components, self.first_component = self.components, self.component
        if components.count == 1:
            return
        # A volume is negative where a component cannot stay without its nearest larger one, like a cavity.
        within = np.zeros(components.count, bool)
        within[self.component[self.faces[0]]] = self.labels[1, self.interface] != 0
        joined = np.zeros(components.count, bool)
        joined[self.component[staying]] = True
        size = np.abs(components.volume)
        # The largest of every label stays.
        for side in self.labels:
            labelled = np.flatnonzero(side[self.interface] != 0)
            label = np.searchsorted(self.shares.labels, side)[self.interface[labelled]]
            component = self.component[self.faces[0, labelled]]
            largest = np.zeros(len(self.shares.labels))
            np.maximum.at(largest, label, size[component])
            components.removable[component[size[component] == largest[label]]] = False
        components.volume = np.where(joined, size, np.where(within, -size, components.volume))
        if self.limit is None:
            # What is around a component that stays must stay too.
            components.removable[components.nearest[joined]] = False

    def remove_components_steps(self, excess: int, stuck: bool = False) -> Steps[bool]:
        """Remove components that cost less than collapses; none at any cost, where lines let no edge go."""
        if stuck:
            return False
        return (yield from super().remove_components_steps(excess))

    def removed_faces(self, faces: Ints) -> Flags:
        """Return which faces (F, 3) of the given complex were removed with their components, (F,) bool."""
        return ~self.components.present[self.first_component[faces[:, 0]]]

    def never_collapses(self, edges: Indices, first: Ints, second: Ints) -> Flags:
        """Return which edges connect two corners, or two junctions and not along their line."""
        rank, locked = self.junctions.rank, self.locked
        a, b = np.take(rank, first), np.take(rank, second)
        a_locked, b_locked = np.take(locked, first), np.take(locked, second)
        across = (a > INTERIOR) & (b > INTERIOR) & ~self.junctions.edges[edges]
        # A vertex of a line stays on it, so it goes to no vertex that is locked beside the line.
        never = across | (a_locked & (b_locked | (b > a))) | (b_locked & (a > b))
        if self.flats:
            stays = (a > b) | a_locked, (b > a) | b_locked
            never |= leaves_flat((self.on_flats[first], self.on_flats[second]), stays)
        return never

    def second_stays(self, first: Ints, second: Ints) -> Flags:
        """Return of which edges the second end has the higher rank, is locked, or is on more flats."""
        rank, locked = self.junctions.rank, self.locked
        stays = (rank[second] > rank[first]) | (locked[second] & ~locked[first])
        if self.flats:
            stays |= (self.on_flats[second] & ~self.on_flats[first]) != 0
        return stays

    def merged(self, first: Ints, second: Ints) -> tuple[EdgeQuadric, Floats, Floats]:
        """As of `CollapsingMesh`; ends on flats that are not locked go to a place on these."""
        quadric, step, target = super().merged(first, second)
        if self.flats:
            bits = self.on_flats[first], self.on_flats[second]
            own = np.flatnonzero((bits[0] | bits[1] != 0) & ~self.locked[first] & ~self.locked[second])
            start, end = self.positions[:, first[own]], self.positions[:, second[own]]
            target[:, own] = flattened(self.flats, (bits[0][own], bits[1][own]), (start, end), target[:, own])
            step[:, own] = target[:, own] - (start + end) * np.float32(0.5)
        return quadric, step, target

    def violates_link_condition_steps(self, collapses: Collapses) -> Steps[Flags]:
        """Return which collapses would change how the complex is connected, (n,) bool."""
        return (
            yield from violates_link_condition_steps(
                collapses,
                self.faces,
                self.edges,
                self.face_edges,
                self.junctions,
                (self.labels != 0).all(axis=0)[self.interface],
            )
        )

    def priority(self, edges: Indices | None = None) -> Floats:
        """The cost of these edges, or of all, times the weight of their interface; of lines a share."""
        junctions = self.junctions
        if edges is None:
            interface, line, cost = junctions.interface, junctions.edges, self.cost
        else:
            interface, line, cost = junctions.interface[edges], junctions.edges[edges], self.cost[edges]
        weight = np.take(self.shares.weight, interface)
        weight[line] *= np.float32(self.policy.line_share)
        weight *= cost
        if self.shares.closed.any():
            weight[np.take(self.shares.closed, interface)] = np.inf
        return weight

    def can_collapse_steps(self) -> Steps[bool]:
        """Whether it is worth trying, with the weights that the labels' shares ask for."""
        if self.limit is None:  # a maximum error sets no shares
            self.shares.update(self.interface[self.faces[0] != self.dummy])
        self.rounds += 1
        if self.limit is None and self.rounds % self.policy.retry == 0:
            # Lines refuse more edges than a surface does, and soon allow them again.
            yield from self.update_costs_steps(np.flatnonzero(np.isinf(self.cost) & (self.edges[0] != self.dummy)))
        if not (yield from super().can_collapse_steps()):
            return False
        return not self.shares.closed.any() or bool(np.isfinite(self.priority()).any())

    def within_budget(self, collapses: Collapses, budget: int) -> Collapses:
        """The cheapest of the collapses that remove no more than twice `budget` faces: some remove three or more."""
        counts = np.bincount(collapses.owner[collapses.vanishing], minlength=len(collapses.edges))
        if counts.sum() <= 2 * budget:
            return collapses
        order = np.argsort(self.priority(collapses.edges), kind="stable")
        selected = np.zeros(len(order), bool)
        selected[order[np.cumsum(counts[order]) <= 2 * budget]] = True
        if not selected.any():
            fewest = order[counts[order] <= 2 * budget][:1]
            selected[fewest] = True
            if not len(fewest):
                self.cost[collapses.edges] = np.inf
        return collapses.select(selected)

    def edges_joined(self, lost: Indices, stays: Indices) -> None:
        """An edge of a line that became one with another makes this one of the line."""
        self.junctions.edges[stays] |= self.junctions.edges[lost]

    def may_have_handles(self) -> bool:
        """Whether to look for handles: where walls meet, the Euler number does not tell."""
        return True

    def handle_cuts_steps(self, longest: float) -> Steps[Cuts | None]:
        """Cuts of handles within an interface, which stays in one piece."""
        junction = self.junctions.rank != INTERIOR
        locked = junction | self.locked | (self.on_flats != 0)
        return (yield from handle_cuts_steps(self.positions, self.faces, self.edges, locked, longest, junction))

    def handles_were_cut(self, loops: Ints) -> None:
        """The caps lie in the interface of their loop."""
        sides, copies = np.repeat(self.interface[-len(loops) :], 3), np.zeros(loops.size, np.int8)
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

    def normals_added(self, collapses: Collapses) -> Floats:
        """Return the normals of the vertices that go; a vertex of a line keeps its own."""
        rank = self.junctions.rank
        own = rank[collapses.kept] > rank[collapses.dropped]
        return np.where(own, np.float32(0.0), super().normals_added(collapses))

    def begin_log(self, crossing: Ints | None = None) -> None:
        """Begin a log, and keep the data of the faces, edges and vertices that it numbers."""
        super().begin_log(crossing)
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

    def was_undone(self) -> None:
        """Find the junction edges again: of two merged edges only one may be part of a line."""
        left = self.face_edges[:, self.faces[0] != self.dummy]
        self.junctions.edges = np.bincount(left.ravel(), minlength=len(self.cost)) != 2

    def compact_steps(self) -> Steps[Indices]:
        """Leave out removed faces, edges and vertices; return which vertices are left."""
        faces, edges = self.faces[0] != self.dummy, self.edges[0] != self.dummy
        vertices = yield from super().compact_steps()
        self.turned = self.turned[faces]
        junctions = self.junctions
        junctions.edges, junctions.interface = junctions.edges[edges], junctions.interface[edges]
        junctions.rank, self.on_flats = junctions.rank[vertices], self.on_flats[vertices]
        return vertices

    def surfaces(self, interface: Ints) -> list[Surface]:
        """The surface of every label."""
        surfaces = []
        for label in self.shares.labels:
            numbers = np.flatnonzero((self.labels == label).any(axis=0)[interface])
            surfaces.append((numbers, self.labels[1, interface[numbers]] == label))
        return surfaces

    def complex_mesh(self) -> ComplexMesh:
        """The complex as it is now, without the vertices that are not used any more."""
        left = self.faces[0] != self.dummy
        mesh, turned = self.mesh(), self.turned[left]
        faces, sides = mesh.faces.copy(), self.labels[:, self.interface[left]].T.copy()
        faces[turned], sides[turned] = faces[turned][:, ::-1], sides[turned][:, ::-1]
        return ComplexMesh(mesh.vertices, faces, sides, mesh.normals)
