# SPDX-License-Identifier: GPL-3.0-or-later
"""Components of a mesh, and the cost of removing one as a whole.

A closed component never has fewer than four triangles, however many edges collapse: its removal is another step, in
the same queue. Where it is gone, its points are as far from the surface as the next component is. So the removal costs
its area times that gap, shared by the triangles it saves. The cost of a collapse in the same unit follows from its
quadric, an area times a squared distance, and the area that the quadric was summed over.

The gap goes to the nearest component of a larger extent that is still present, and is measured at a few vertices. A
cavity's nearest larger component is the one around it, because every way out crosses that one's wall: it goes at the
latest together with it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ...arrays import Doubles, Flags, Floats, Indices, Ints
from ...measures.units import specks_text
from ...mesh.measures import component_volumes_steps, volumes_of_moments
from ...mesh.topology import component_numbers_steps, components_of_vertices
from ...mesh.vectors import cross, dot
from ...progress import PAUSE, Steps
from ..bounds.error_check import ErrorCheck
from ..policy import POLICY, Policy
from .ranked_points import RankedPoints

TETRAHEDRON = 4  # The fewest triangles of a closed component.
POINTS_AT_ONCE = 1024


@dataclass(frozen=True)
class CollapsedComponents:
    """Components that simplification removed as a whole.

    count : int
        Number of components, cavities among them.
    largest, volume : float
        The largest volume that one of them encloses in the full surface, and that of all together, in the cube of the
        mesh's unit; the volume of a cavity counts as much as that of a body.
    """

    count: int = 0
    largest: float = 0.0
    volume: float = 0.0

    def __add__(self, other: CollapsedComponents) -> CollapsedComponents:
        largest = max(self.largest, other.largest)
        return CollapsedComponents(self.count + other.count, largest, self.volume + other.volume)

    def scaled(self, factor: float) -> CollapsedComponents:
        """Return the same components with lengths multiplied."""
        return CollapsedComponents(self.count, self.largest * factor**3, self.volume * factor**3)

    def sentence(self) -> str:
        """Return count and volume in words, of a mesh in mm.

        Examples
        --------
        >>> CollapsedComponents(562, 0.03, 1.9).sentence()
        '562 specks removed (1.9 mm3 in total)'
        """
        return specks_text(self.count, self.volume)


@dataclass(frozen=True, eq=False)
class Staying:
    """Components that are not removed, whatever they cost.

    largest : float
        Volume above which components stay, cavities too, in the cube of the unit of the positions.
    by_box : bool
        Whether their bounding box is meant, which shrinks less than what they enclose when they are simplified.
    vertices : (n,) int64
        Vertices whose components stay.
    """

    largest: float = math.inf
    by_box: bool = False
    vertices: Indices = field(default_factory=lambda: np.empty(0, np.int64))


class Components:
    """The components of a mesh, each with its area, volume and gap; in the order of their first faces.

    of_face : (F,) int32 or None
        The component of every face, if it is known.
    volume_before : (V,) float64 or None
        Volume of the component of each vertex before the mesh was clustered, if it was.
    moments : tuple of (n,) int64 and (n, 8) float64, or None
        Moments that components have in the full surface, and at which vertices: removed ones count with the volume
        that follows from these. Without any the mesh is the full surface.
    of_moments : (n,) int32
        The component of each of these rows.
    """

    staying = Staying()
    of_face: Ints | None = None
    volume_before: Doubles | None = None
    moments: tuple[Indices, Doubles] | None = None
    of_moments: Ints

    def __init__(self, policy: Policy = POLICY) -> None:
        self.policy = policy

    def prepare_steps(self, positions: Floats, faces: Ints, border: Ints, locked: Ints) -> Steps[Ints]:
        """Take in positions (3, V) and faces (3, F); returns the component of every vertex, -1 for one without faces.

        `border` are the vertices on a border, `locked` those whose components must stay. So must those that
        `staying` names, which is set before.
        """
        component = self.of_face
        if component is None:
            component = yield from component_numbers_steps(np.ascontiguousarray(faces.T), positions.shape[1])
        of_vertex = components_of_vertices(faces.T, component, positions.shape[1])
        yield PAUSE
        self.count = count = int(component.max()) + 1
        self.present, self.removable = np.ones(count, bool), np.ones(count, bool)
        self.removable[of_vertex[locked]] = False
        self.removable[of_vertex[self.staying.vertices]] = False
        self.collapsed = CollapsedComponents()
        self.large = np.zeros(count, bool)
        if self.moments is not None:
            vertices, rows = self.moments
            self.of_moments = of_vertex[vertices]
            moments = np.zeros((count, rows.shape[1]))
            np.add.at(moments, self.of_moments, rows)
            self.full_volume = volumes_of_moments(moments)
        if count == 1:
            return of_vertex
        if self.volume_before is None:
            self.volume = yield from component_volumes_steps(positions.T, faces.T, component)
        else:
            self.volume = np.zeros(count)
            used = np.flatnonzero(of_vertex[: len(self.volume_before)] >= 0)
            self.volume[of_vertex[used]] = self.volume_before[used]
        self.area = yield from _areas_steps(positions, faces, component, count)
        open_ = of_vertex[border]
        self.volume[open_] = np.abs(self.volume[open_])  # neither a cavity nor a body
        used = np.flatnonzero(of_vertex >= 0)
        self.order = used[np.argsort(of_vertex[used], kind="stable")]  # the vertices of one component after the other
        self.vertices = np.bincount(of_vertex[used], minlength=count)
        yield PAUSE
        starts = np.cumsum(self.vertices) - self.vertices
        self.extent = np.zeros(count, np.float32)
        box = np.ones(count)
        for axis in positions:
            along = axis[self.order]
            side = np.maximum.reduceat(along, starts) - np.minimum.reduceat(along, starts)
            self.extent += side
            box *= side
        yield PAUSE
        self.large = (box if self.staying.by_box else np.abs(self.volume)) > self.staying.largest
        self.removable &= ~self.large
        by_extent = np.argsort(self.extent, kind="stable")
        self.rank = np.empty(count, np.int32)
        self.rank[by_extent] = np.arange(count, dtype=np.int32)
        self.largest = by_extent[-1]
        self.removable[self.largest] = False
        return of_vertex

    def prepare_gaps_steps(self, positions: Floats, of_vertex: Ints) -> Steps[None]:
        """Measure all gaps, with the positions and components of all vertices."""
        if self.count == 1:
            return
        order, vertices = self.order, self.vertices
        starts = np.cumsum(vertices) - vertices
        probes = np.minimum(self.policy.component_probes, -(-vertices // 32))
        self.probed = probed = np.repeat(np.arange(self.count), probes)
        turn = np.arange(len(probed)) - np.repeat(np.cumsum(probes) - probes, probes)
        self.probes = np.take(positions, order[starts[probed] + turn * vertices[probed] // probes[probed]], axis=1)
        yield PAUSE
        turn = np.arange(len(order)) - np.repeat(starts, vertices)
        sample = order[turn % self.policy.component_every == 0]
        self.tree = RankedPoints()
        yield from self.tree.prepare_steps(np.take(positions, sample, axis=1), of_vertex[sample], self.rank)
        self.gap, self.nearest = np.zeros(self.count), np.full(self.count, self.largest)
        yield from self._measure_gaps_steps(np.arange(self.count) != self.largest)

    def _measure_gaps_steps(self, selected: Flags) -> Steps[None]:
        """Measure the gaps of the selected components, (components,) bool."""
        probes = np.flatnonzero(selected[self.probed])
        of = self.probed[probes]
        gap, nearest = np.empty(len(of), np.float32), np.empty(len(of), np.int32)
        for start in range(0, len(of), POINTS_AT_ONCE):
            block = slice(start, start + POINTS_AT_ONCE)
            gap[block], nearest[block] = self.tree.nearest(
                np.take(self.probes, probes[block], axis=1), self.rank[of[block]]
            )
            yield PAUSE
        times = np.bincount(of, minlength=self.count)
        self.gap[selected] = np.bincount(of, gap.astype(np.float64), self.count)[selected] / times[selected]
        closest = np.argsort(-gap, kind="stable")  # the nearest is written last
        self.nearest[of[closest]] = nearest[closest]

    def cheaper(self, face_counts: Indices, cost: float, excess: int) -> Indices:
        """Components whose removal costs less for every triangle than `cost`, the cheapest first.

        Parameters
        ----------
        face_counts : (components,) int64
            Triangles that each has now.
        cost : float
            Cost of a collapse for every triangle it removes; inf if none is possible any more.
        excess : int
            Triangles that may go, at most.
        """
        counts, areas = face_counts.astype(np.int64), np.where(self.present, self.area, 0.0)
        inner = self._inner()
        owner = inner
        while len(owner):
            owner = self.nearest[owner]
            np.add.at(counts, owner, face_counts[inner])
            np.add.at(areas, owner, self.area[inner])
            further = self._is_inner(owner)
            inner, owner = inner[further], owner[further]
        ready = np.flatnonzero(self.present & self.removable)
        costs = areas[ready] * self.gap[ready] / counts[ready]
        cheap = costs < self.policy.component_cost * cost
        ready = ready[cheap][np.argsort(costs[cheap], kind="stable")]
        selected = ready[np.cumsum(counts[ready]) <= excess]
        if not len(selected) and np.isinf(cost):
            # Nothing else is left to go: better two triangles too few than too many.
            selected = ready[counts[ready] < excess + TETRAHEDRON][:1]
        return selected

    def _is_inner(self, components: Indices) -> Flags:
        """Return whether each cannot stay without its nearest component: a cavity, or a component inside one."""
        inside = (self.volume[components] < 0) | (self.volume[self.nearest[components]] < 0)
        return inside & self.removable[components]

    def _inner(self) -> Indices:
        present = np.flatnonzero(self.present)
        return present[self._is_inner(present)]

    def remove_steps(self, removed: Indices) -> Steps[None]:
        """Remove components, with those inside them."""
        before = self.present.copy()
        self.present[removed] = False
        inner = self._inner()
        while len(lost := inner[~self.present[self.nearest[inner]]]):
            self.present[lost] = False
            inner = self._inner()
        self.count_removed(before & ~self.present)
        self.tree.keep(self.present)
        yield PAUSE
        yield from self._measure_gaps_steps(self.present & ~self.present[self.nearest])

    def count_removed(self, removed: Flags) -> None:
        """Add these components, (components,), to `collapsed`."""
        volumes = np.abs((self.volume if self.moments is None else self.full_volume)[removed])
        largest = float(volumes.max(initial=0.0))
        self.collapsed += CollapsedComponents(len(volumes), largest, math.fsum(volumes.tolist()))


def _areas_steps(positions: Floats, faces: Ints, component: Ints, count: int) -> Steps[Doubles]:
    a, b, c = (np.take(positions, corner, axis=1) for corner in faces)
    yield PAUSE
    normal = cross(b - a, c - a)
    yield PAUSE
    return np.bincount(component, np.sqrt(dot(normal, normal)).astype(np.float64), count) / 2.0


def without_components_steps(
    components: Components, positions: Floats, faces: Ints, of_face: Ints, of_original: Ints, check: ErrorCheck
) -> Steps[Flags]:
    """Return which faces of a surface within the error may be removed with their components, (F,) bool.

    A component may go if all of its original is within the limit of what stays. All small ones are removed at once;
    those that are then too far away, and those that others were nearest to, come back: a larger surface is nowhere
    farther.

    Parameters
    ----------
    components : Components
    positions, faces : (3, V) float32 and (3, F) int32
    of_face, of_original : (F,) and (f,) int32
        The component of every face, and of the original's.
    check : ErrorCheck
        Compared with the surface.
    """
    if components.count == 1:
        return np.zeros(faces.shape[1], bool)
    removed = components.removable & (components.extent < components.policy.component_extent * check.limit)
    nearest_component = of_face[check.nearest]  # component nearest to every vertex of the original
    faces_to_check = np.arange(len(of_original))
    while removed.any():
        yield from check.compare_with_steps(positions, faces[:, ~removed[of_face]])
        away = yield from check.original_exceeding_steps(faces_to_check)
        back = np.zeros(components.count, bool)
        back[of_original[away]] = back[nearest_component[check.original_faces[:, away]]] = True
        back &= removed
        if not back.any():
            if len(away):
                removed[:] = False
            break
        removed &= ~back
        # The rest is near to a part of what is present now.
        faces_to_check = np.flatnonzero(back[of_original] | np.isin(np.arange(len(of_original)), away))
    components.count_removed(removed)
    return removed[of_face]
