# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh whose edges collapse in rounds, all edges of a round at once.

A round takes the cheapest share of the edges, picks among them edges whose triangles do not meet, and
collapses those that may. Edges keep their cost from round to round until one of their ends moves, and
no list is ever sorted again: a collapse of ab removes the triangles abc and abd, and there the edges
ac and bc become one.

On millions of triangles a round takes a second. What takes long is a generator that yields now and then, so that the
work can be left there; what it returns is its result.

Garland and Heckbert 1997, doi:10.1145/258734.258849; link condition by Dey et al. 1999.
"""

from __future__ import annotations

import math

import numpy as np

from ...arrays import Flags, Floats, Indices, Ints
from ...mesh.topology import compacted, edges_steps
from ...mesh.triangle_mesh import TriangleMesh
from ...mesh.vectors import dot
from ...progress import PAUSE, Steps
from ..bounds.error_bound import ErrorBound
from ..policy import POLICY, Policy
from .collapse_log import CollapseLog
from .collapses import Collapses, independent_set_steps, turned
from .component_removal import CollapsedComponents, Components
from .edge_choice import EdgeChoice
from .handles import least_face_cost, longest_loop_edge, pull_apart_steps
from .quadrics import (
    EdgeQuadric,
    best_step,
    edge_quadric,
    error,
    face_quadrics,
    normal_quadrics,
    renew_quadrics_steps,
    vertex_quadrics_steps,
)
from .surface_rules import ONE_SURFACE, SurfaceRules

BLOCK = 8192  # Compute the costs of this many edges at once: they fit the cache.


class CollapsingMesh(EdgeChoice):
    """A mesh while it is simplified.

    Parameters
    ----------
    mesh : TriangleMesh
    max_error : float, optional
    policy : Policy, optional
    batch : bool
        Whether the surface goes on beyond the mesh.
    rules : SurfaceRules, optional
        By default those of one surface.
    interface : (F,) int32, optional
        Interface that each triangle is in, if there are several.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        max_error: float | None = None,
        policy: Policy = POLICY,
        batch: bool = False,
        rules: SurfaceRules = ONE_SURFACE,
        interface: Ints | None = None,
    ) -> None:
        self.policy, self.rules, self.share = policy, rules, rules.share(policy)
        vertices = mesh.vertices
        extent = float((vertices.max(axis=0) - vertices.min(axis=0)).max())
        # A power of two: nothing is rounded, and float32 neither over- nor underflows in any unit.
        self.scale = np.float32(2.0 ** -np.frexp(extent)[1])
        # One vertex more, the dummy: faces and edges that are gone stand there until `compact_steps`.
        self.dummy = len(vertices)
        self.positions = np.empty((3, len(vertices) + 1), np.float32)
        np.multiply(vertices.T, self.scale, out=self.positions[:, :-1])
        self.positions[:, -1] = self.positions[:, 0]
        self.normals = None
        if mesh.normals is not None:
            self.normals = np.zeros((3, len(vertices) + 1), np.float32)
            self.normals[:, :-1] = mesh.normals.T
        self.faces = np.array(mesh.faces.T, order="C")
        self.face_count = self.faces.shape[1]
        self.interface = np.zeros(self.face_count, np.int32) if interface is None else interface
        self.limit = None if max_error is None else max_error * float(self.scale)
        self.bound: ErrorBound | None = None
        self.log: CollapseLog | None = None
        self.crossing_count: int | None = None  # pairs of triangles that cross, once tested
        self.batch = batch
        self.components = Components(policy)
        self.face_cost = 0.0  # of the most expensive collapses so far, for every face that went: area times distance
        self.cost_at_removal = 0.0  # `face_cost` when components were last considered
        self.least_cost_of_cut = math.inf  # `face_cost` above which handles are considered again
        self.handles_cut = 0
        self.accepted = 1.0  # share of the edges tried in the last round that could collapse
        self.poor_rounds = 0  # in a row, with hardly a collapse
        self.collapsed = 0  # since refused edges were last given another chance

    def prepare_steps(self) -> Steps[None]:
        """Find the edges and their costs; call this before anything else."""
        vertex_count = self.positions.shape[1]
        self.edges, self.face_edges = yield from edges_steps(self.faces, vertex_count)
        yield from self._prepare_vertices_steps()
        self.vertex_becomes = np.arange(vertex_count, dtype=np.int32)  # during a round
        self.edge_becomes = np.arange(self.edges.shape[1], dtype=np.int32)
        self.original_vertex = np.arange(vertex_count, dtype=np.int32)
        self.doubtful = np.zeros(vertex_count + 1, bool)  # the last for copies
        self.quadrics = yield from vertex_quadrics_steps(self.positions, self.faces)
        self.cost = np.full(self.edges.shape[1], np.inf, np.float32)
        if self.limit is not None:
            self.bound = ErrorBound(self.limit, self.policy)
            columns = self.positions, self.faces, self.edges, self.face_edges, self.interface
            yield from self.bound.prepare_steps(*columns)
            self.faces = self.faces.copy()  # the bound keeps the original
        yield from self.update_costs_steps()
        self.begin_log()
        if self.limit is None and self.rules.may_have_handles(self):
            self.least_cost_of_cut = least_face_cost(self.positions, self.edges, self.policy)

    def _prepare_vertices_steps(self) -> Steps[None]:
        """Find which vertices are locked, and the components."""
        self.locked, border, staying = yield from self.rules.vertices_steps(self)
        self.component = yield from self.components.prepare_steps(self.positions, self.faces, border, staying)
        if self.limit is None:
            yield from self.components.prepare_gaps_steps(self.positions, self.component)
        self.rules.components_found(self, staying)

    def update_costs_steps(self, edges: Indices | None = None) -> Steps[None]:
        """Compute the cost of these edges, or of all."""
        edges = np.arange(len(self.cost)) if edges is None else edges
        for number, start in enumerate(range(0, len(edges), BLOCK)):
            block = edges[start : start + BLOCK]
            first, second = np.take(self.edges, block, axis=1)
            quadric, step, _ = self.merged(first, second)
            cost = error(quadric, step)
            cost[self.rules.never_collapses(self, block, first, second)] = np.inf
            self.cost[block] = cost
            if number % 16 == 15:
                yield PAUSE

    def merged(self, first: Ints, second: Ints) -> tuple[EdgeQuadric, Floats, Floats]:
        """Quadric of the edges between these vertices, step from the middle to the new vertex, the new vertex."""
        start, end = np.take(self.positions, first, axis=1), np.take(self.positions, second, axis=1)
        half = (end - start) * np.float32(0.5)
        quadric = edge_quadric(np.take(self.quadrics, first, axis=1), np.take(self.quadrics, second, axis=1), half)
        step = best_step(quadric)
        target = start + half + step
        for vertex, place, way in ((first, start, -half), (second, end, half)):
            locked = self.locked[vertex]
            if locked.any():
                np.copyto(step, way, where=locked)
                np.copyto(target, place, where=locked)
        self.rules.place(self, (first, second), step, target)
        return quadric, step, target

    def can_collapse_steps(self) -> Steps[bool]:
        """Return whether it is worth trying; refused edges are tried again after enough collapses."""
        yield from self.update_costs_steps(self.rules.begin_round(self))
        if self.poor_rounds >= self.policy.poor_rounds or not np.isfinite(self.cost).any():
            if self.collapsed <= len(self.cost) // 1000:
                return False
            self.poor_rounds = self.collapsed = 0
            yield from self.update_costs_steps()
            if not np.isfinite(self.cost).any():
                return False
        return self.rules.leaves_edges(self)

    def collapse_round_steps(self, budget: int) -> Steps[None]:
        """One round: collapse at most `budget` of the cheapest edges that do not get in each other's way."""
        count = int(min(self.share * 1.5 * self.face_count, 8 * budget) / self.accepted)
        candidates = self.cheapest(min(count, len(self.cost) - 1))
        yield PAUSE
        edges = yield from independent_set_steps(candidates, self.edges, self.positions.shape[1], self.policy)
        collapses = self.collapses(np.sort(edges))  # in the order in which their vertices lie in memory
        yield PAUSE
        tried = len(collapses.edges)
        collapses = yield from self.possible_steps(collapses)
        accepted = len(collapses.edges) / tried
        if len(collapses.edges) and self.limit is None:
            self._update_face_cost(collapses)
        if tested := self.tests_crossings:
            collapses, share = yield from self.uncrossed_steps(collapses, budget)
            accepted *= share
        else:
            collapses = self.rules.within_budget(self, collapses, budget)
        self.accepted = max(accepted, self.policy.poor_round)
        self.poor_rounds = self.poor_rounds + 1 if self.accepted == self.policy.poor_round else 0
        if len(collapses.edges):
            yield from self.merge_steps(collapses, tested)

    def remove_components_steps(self, excess: int, stuck: bool = False) -> Steps[bool]:
        """Remove components that now cost less than collapses, at most `excess` faces; whether any went.

        Only when collapses have become more expensive. If `stuck`, at any cost.
        """
        if (
            self.limit is not None
            or self.components.count == 1
            or (stuck and not self.rules.loses_components_at_any_cost)
            or not (stuck or self.face_cost > self.policy.consider_again * self.cost_at_removal)
        ):
            return False
        self.cost_at_removal = self.face_cost
        of_face = np.take(self.component, self.faces[0])
        counts = np.bincount(of_face + 1, minlength=self.components.count + 1)[1:]  # -1 is the dummy's
        yield PAUSE
        components = self.components.cheaper(counts, np.inf if stuck else self.face_cost, excess)
        if not len(components):
            return False
        yield from self.components.remove_steps(components)
        removed = np.append(~self.components.present, False)  # for the dummy
        faces = np.flatnonzero(np.take(removed, of_face))
        edges = np.take(self.face_edges, faces, axis=1).ravel()
        self.face_count -= len(faces)
        for rows, places in ((self.faces, faces), (self.edges, edges)):
            for row in rows:
                row[places] = self.dummy
        self.cost[edges] = np.inf
        return True

    def cut_handles_steps(self) -> Steps[None]:
        """Cut handles that now cost less than collapses, when collapses have become more expensive."""
        if self.limit is not None or self.face_cost <= self.least_cost_of_cut:
            return
        self.least_cost_of_cut = self.face_cost * (self.policy.cut_in_batch if self.batch else self.policy.cut_again)
        longest = longest_loop_edge(self.face_cost)
        cuts = yield from self.rules.handle_cuts_steps(self, longest)
        if cuts is None:
            return
        of_vertex = np.zeros(self.positions.shape[1], np.int32)
        for corner in self.faces:
            of_vertex[corner] = self.interface
        caps = np.tile(of_vertex[cuts.loops[:, 0]], 2)
        if self.log is not None:
            self.log.add_cuts(self, cuts.loops, caps)
        self.interface = np.append(self.interface, caps)
        self.handles_cut += len(cuts.loops)
        self.face_count += 2 * len(cuts.loops)
        vertex_count = self.positions.shape[1]
        self.faces, self.face_edges, self.edges = cuts.apply(self.faces, self.face_edges, self.edges, vertex_count)
        yield PAUSE
        vertices = np.append(np.arange(vertex_count), cuts.loops)
        self.positions, self.quadrics = (
            np.take(self.positions, vertices, axis=1),
            np.take(self.quadrics, vertices, axis=1),
        )
        if self.normals is not None:
            self.normals = np.take(self.normals, vertices, axis=1)
        self.locked, self.component = self.locked[vertices], self.component[vertices]
        self.original_vertex = np.append(self.original_vertex, np.full(cuts.loops.size, -1, np.int32))
        self.cost = np.append(self.cost, np.full(cuts.loops.size, np.inf, np.float32))
        self.vertex_becomes = np.arange(len(vertices), dtype=np.int32)
        self.edge_becomes = np.arange(len(self.cost), dtype=np.int32)
        self.rules.handles_were_cut(self, cuts.loops)
        yield PAUSE
        yield from pull_apart_steps(self.positions, self.faces, self.edges, cuts.loops, self.policy)
        moved = np.zeros(len(vertices), bool)
        moved[cuts.loops] = moved[vertex_count:] = True
        yield from renew_quadrics_steps(self.quadrics, self.positions, self.faces, moved)
        yield from self.update_costs_steps(np.flatnonzero(np.take(moved, self.edges).any(axis=0)))

    def collapses(self, edges: Indices) -> Collapses:
        """Return the result of collapsing these edges; no two have an end at the same triangle."""
        first, second = np.take(self.edges, edges, axis=1)
        _, _, target = self.merged(first, second)
        swap = self.rules.second_stays(self, first, second)
        ends = np.where(swap, second, first), np.where(swap, first, second)
        owner = np.full(self.positions.shape[1], -1, np.int32)
        owner[ends[0]] = owner[ends[1]] = np.arange(len(edges), dtype=np.int32)
        owners = np.take(owner, self.faces)  # (3, F)
        highest = owners.max(axis=0)
        star = np.flatnonzero(highest >= 0)
        a, b, c = np.take(owners, star, axis=1) >= 0
        return Collapses(edges, *ends, target, star, highest[star], (a & (b | c)) | (b & c))

    def merge_steps(self, collapses: Collapses, tested: bool) -> Steps[None]:
        """Collapse; removed items refer to the dummy vertex until `compact_steps`. `tested` ones make nothing cross."""
        keep, drop, vanishing = collapses.kept, collapses.dropped, collapses.faces[collapses.vanishing]
        self.collapsed += len(keep)
        remaining = self.face_count - len(vanishing)
        self.compacting = self.bound is not None or remaining < self.policy.compact_below * self.faces.shape[1]
        if self.log is not None:
            self.log.add_collapses(self, collapses, tested)
        if self.compacting:
            self.positions[:, keep] = collapses.target
        else:
            yield from self.move_steps(collapses)
        if self.normals is not None:
            self.normals[:, keep] += self.rules.normals_added(self, collapses)

        # In every face that vanishes the other two edges become a single edge.
        sides = np.take(self.face_edges, vanishing, axis=1)
        self.edge_becomes[collapses.edges] = -1
        second, third = (np.take(self.edge_becomes, side) < 0 for side in sides[1:])
        lost = np.where(second, sides[2], np.where(third, sides[0], sides[1]))
        stays = np.where(second, sides[0], np.where(third, sides[1], sides[2]))
        self.edge_becomes[lost] = stays
        self.rules.edges_joined(lost, stays)
        self.vertex_becomes[drop] = keep
        yield PAUSE

        left = collapses.faces[~collapses.vanishing]
        corners = np.take(self.vertex_becomes, np.take(self.faces, left, axis=1))
        around = np.take(self.edge_becomes, np.take(self.face_edges, left, axis=1))
        # One row at a time: several times faster in NumPy than all at once.
        for corner, side, new_corner, new_side in zip(self.faces, self.face_edges, corners, around, strict=True):
            corner[left], side[left] = new_corner, new_side
            corner[vanishing] = self.dummy
        incident_edges = np.zeros(len(self.cost), bool)
        incident_edges[around] = True
        incident_edges = np.flatnonzero(incident_edges)
        ends = np.take(self.vertex_becomes, np.take(self.edges, incident_edges, axis=1))
        for row, end in zip(self.edges, ends, strict=True):
            row[incident_edges] = end
            row[collapses.edges] = row[lost] = self.dummy
        yield PAUSE
        for dead in (collapses.edges, lost):
            self.edge_becomes[dead], self.cost[dead] = dead, np.inf
        self.vertex_becomes[drop] = drop
        self.face_count -= len(vanishing)

        if self.compacting:
            changed = np.zeros(len(self.vertex_becomes), bool)
            changed[keep] = True
            changed = changed[(yield from self.compact_steps())]
            self.quadrics = yield from vertex_quadrics_steps(self.positions, self.faces)
            yield from self.update_costs_steps(np.flatnonzero(np.take(changed, self.edges).any(axis=0)))
        else:
            moved = np.zeros(len(self.vertex_becomes), bool)
            moved[keep] = True
            yield from self.update_costs_steps(incident_edges[moved[ends].any(axis=0)])

    def move_steps(self, collapses: Collapses) -> Steps[None]:
        """Move both ends; recompute quadrics of those that stay, and update those of the vertices round them."""
        left, vanishing = np.flatnonzero(~collapses.vanishing), np.flatnonzero(collapses.vanishing)
        faces, lost = (np.take(self.faces, collapses.faces[places], axis=1) for places in (left, vanishing))
        lost_change = -face_quadrics(self.positions, lost)
        assert collapses.normals is not None
        before, after = collapses.normals
        new = normal_quadrics(after)
        change = new - normal_quadrics(before)
        yield PAUSE
        for row, target in zip(self.positions, collapses.target, strict=True):
            row[collapses.kept] = row[collapses.dropped] = target
        slots = collapses.slots(faces, len(self.vertex_becomes))
        rim = np.concatenate(
            [turned(faces, slots, 1), turned(faces, slots, 2), collapses.apexes(lost, collapses.owner[vanishing])]
        )
        around = np.zeros(len(self.vertex_becomes), bool)
        around[rim] = True
        around = np.flatnonzero(around)
        number = np.empty(len(self.vertex_becomes), np.intp)
        number[around] = np.arange(len(around))
        index, owner = np.take(number, rim), collapses.owner[left].astype(np.intp)
        for row, difference, lost_share, total in zip(self.quadrics, change, lost_change, new, strict=True):
            shares = np.concatenate([difference, difference, lost_share])
            row[around] += np.bincount(index, shares, len(around)).astype(np.float32)
            row[collapses.kept] = np.bincount(owner, total, len(collapses.kept))
            yield PAUSE

    def compact_steps(self) -> Steps[Indices]:
        """Leave out removed faces, edges and vertices; return which vertices are left."""
        face_left = np.flatnonzero(self.faces[0] != self.dummy)
        edge_left = np.flatnonzero(self.edges[0] != self.dummy)
        used = np.zeros(len(self.vertex_becomes), bool)
        used[self.edges] = used[self.dummy] = True
        vertex_left = np.flatnonzero(used)
        yield PAUSE
        vertex_number = np.empty(len(used), np.int32)
        vertex_number[vertex_left] = np.arange(len(vertex_left), dtype=np.int32)
        edge_number = np.empty(len(self.cost), np.int32)
        edge_number[edge_left] = np.arange(len(edge_left), dtype=np.int32)
        if self.bound is not None:
            self.bound.accept(face_left)
        if self.log is not None:
            self.log.compact(face_left, edge_left, vertex_left)
        self.rules.compact(face_left, edge_left, vertex_left)
        self.original_vertex, self.interface = self.original_vertex[vertex_left], self.interface[face_left]
        self.faces = np.take(vertex_number, np.take(self.faces, face_left, axis=1))
        self.face_edges = np.take(edge_number, np.take(self.face_edges, face_left, axis=1))
        yield PAUSE
        self.edges = np.take(vertex_number, np.take(self.edges, edge_left, axis=1))
        self.cost = self.cost[edge_left]
        self.positions = np.take(self.positions, vertex_left, axis=1)
        self.locked = self.locked[vertex_left]
        if self.normals is not None:
            self.normals = np.take(self.normals, vertex_left, axis=1)
        self.component = self.component[vertex_left]
        if self.bound is None:
            self.quadrics = np.take(self.quadrics, vertex_left, axis=1)
        self.dummy = int(vertex_number[self.dummy])
        self.vertex_becomes = np.arange(len(vertex_left), dtype=np.int32)
        self.edge_becomes = np.arange(len(edge_left), dtype=np.int32)
        yield PAUSE
        return vertex_left

    def begin_log(self, crossing: Ints | None = None) -> None:
        """Begin a log of all changes from now on; `crossing` are pairs of faces, (2, n), that cross already."""
        self.log = CollapseLog(self, crossing)
        self.rules.log_begins()

    @property
    def collapsed_components(self) -> CollapsedComponents:
        """Components that were removed as a whole, in the unit of the mesh."""
        return self.components.collapsed.scaled(1 / float(self.scale))

    def mesh(self) -> TriangleMesh:
        """The mesh as it is now, without the vertices that are not used any more."""
        return self.used_mesh()[0]

    def used_mesh(self) -> tuple[TriangleMesh, Flags]:
        """`mesh`, and which vertices of `original_vertex` it has, bool."""
        used, faces = compacted(self.faces[:, self.faces[0] != self.dummy], self.positions.shape[1])
        vertices = np.ascontiguousarray((self.positions[:, used] / self.scale).T)
        normals = None
        if self.normals is not None:
            normals = self.normals[:, used]
            length = np.sqrt(dot(normals, normals))
            length[length == 0] = 1.0
            normals = np.ascontiguousarray((normals / length).T)
        return TriangleMesh(vertices, np.ascontiguousarray(faces.T), normals), used
