# SPDX-License-Identifier: GPL-3.0-or-later
"""Simplify a batch whose border stays."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ...arrays import Indices
from ...mesh.topology import component_numbers_steps, components_of_vertices
from ...progress import Steps
from ..bounds.bounded import hold_bound_steps
from ..clustering import clustered_steps
from ..engine.component_removal import CollapsedComponents, Staying
from ..engine.edge_collapse import CollapsingMesh
from ..policy import POLICY, Policy
from ..whole import collapse_steps
from .full_moments import NOTHING, FullMoments, first_indices, full_moments_steps
from .pieces import NEW, Batch


@dataclass(frozen=True, eq=False)
class Reduced:
    """A simplified batch, and what it lost.

    batch : Batch
    face_count : int
        Triangles that it had.
    collapsed : CollapsedComponents
    handles_cut : int
    large : (n,) int64 or None
        Indices of the vertices whose components enclose more than those that may go.
    crossing_count : int or None
        Pairs of triangles that cross, if that was tested.
    unused : (n,) int64
        Numbers of vertices that had moments of components and are no longer there.
    moments : FullMoments
        Moments that are now elsewhere, or new, by indices of vertices of the batch.
    """

    batch: Batch
    face_count: int
    collapsed: CollapsedComponents
    handles_cut: int
    large: Indices | None = None
    crossing_count: int | None = None
    unused: Indices = field(default_factory=lambda: np.empty(0, np.int64))
    moments: FullMoments = NOTHING


def reduce_batch_steps(
    batch: Batch,
    inner_target: float,
    at_border: int = 0,
    max_error: float | None = None,
    whole: bool = False,
    largest_component: float = math.inf,
    by_box: bool = False,
    protected: Indices | None = None,
    moments: FullMoments | None = None,
    policy: Policy = POLICY,
) -> Steps[Reduced]:
    """Simplify a batch, except for its border.

    Parameters
    ----------
    batch : Batch
    inner_target : float
        Triangles to leave, with a maximum error 0: of a batch `spare` times as many as shall be left in the end, of a
        region of the last pass its share of that pass's goal.
    at_border : int
        Triangles to leave besides, because the border stays.
    max_error : float, optional
    whole : bool
        Whether it is the whole surface: then components with a border may go, and any where no edge is left that can.
    largest_component : float
        Components that enclose more, in the cube of the mesh's unit, stay.
    by_box : bool
        Whether their bounding box is meant, which shrinks less than what they enclose when they are simplified.
    protected : (n,) int64, optional
        Indices of vertices whose components stay.
    moments : FullMoments, optional
        Moments that components have in the full surface; none if the batch is a part of that.
    policy : Policy, optional
    """
    face_count, full = batch.face_count, moments is None
    target = round(inner_target) + at_border
    if target >= face_count and not full:
        return Reduced(batch, face_count, CollapsedComponents(), 0)
    component = yield from component_numbers_steps(batch.mesh.faces, len(batch.numbers))
    if moments is None:
        here = yield from full_moments_steps(batch.mesh, component)
    else:
        here = moments.within(batch.numbers)
    if target >= face_count:
        return Reduced(batch, face_count, CollapsedComponents(), 0, moments=here)
    numbers = batch.numbers[here.vertices]
    before, left = None, inner_target / policy.spare
    if max_error is None and not whole and face_count - at_border > policy.clustered * left:
        of_vertex = components_of_vertices(batch.mesh.faces, component, len(batch.numbers))
        goal = round(policy.left_by_clusters * left) + at_border
        batch, before = yield from clustered_steps(batch, goal, policy, component)
        here = here.at(first_indices(before.component, len(before.volumes))[of_vertex[here.vertices]])
    collapsing = CollapsingMesh(batch.mesh, max_error, policy, batch=not whole)
    components, scale = collapsing.components, float(collapsing.scale)
    if before is None:
        components.of_face = component
    else:
        components.volume_before = before.volumes[before.component] * scale**3
    components.moments = here.vertices, here.scaled(scale)
    vertices = np.flatnonzero(np.isin(batch.numbers, protected)) if protected is not None else np.empty(0, np.int64)
    components.staying = Staying(largest_component * scale**3, by_box, vertices)
    yield from collapse_steps(collapsing, target, last=whole)
    if max_error is not None:
        yield from hold_bound_steps(collapsing)
    mesh, used = collapsing.used_mesh()
    original = collapsing.original_vertex[used]
    reduced = Batch(mesh, np.where(original >= 0, batch.numbers[original], NEW))
    of_vertex = collapsing.component[used]
    large = reduced.numbers[components.large[of_vertex] & (reduced.numbers != NEW)]
    here = here.at(first_indices(of_vertex, components.count)[components.of_moments])
    # A border vertex stays, and other batches look for moments there.
    moving = np.full(len(numbers), True) if full else ~np.isin(numbers, reduced.numbers)
    return Reduced(
        reduced,
        face_count,
        collapsing.collapsed_components,
        collapsing.handles_cut,
        large,
        collapsing.crossing_count,
        numbers[:0] if full else numbers[moving],
        here.select(moving & (here.vertices >= 0)),
    )
