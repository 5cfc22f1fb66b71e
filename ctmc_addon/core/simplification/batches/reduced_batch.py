# SPDX-License-Identifier: GPL-3.0-or-later
"""Simplify a batch whose border stays."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...arrays import Indices
from ...progress import Steps
from ..bounds.bounded import hold_bound_steps
from ..clustering import clustered_steps
from ..engine.component_removal import CollapsedComponents, Staying
from ..engine.edge_collapse import CollapsingMesh
from ..policy import POLICY, Policy
from ..whole import collapse_steps
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
    """

    batch: Batch
    face_count: int
    collapsed: CollapsedComponents
    handles_cut: int
    large: Indices | None = None
    crossing_count: int | None = None


def reduce_batch_steps(
    batch: Batch,
    inner_target: float,
    at_border: int = 0,
    max_error: float | None = None,
    whole: bool = False,
    largest_component: float = math.inf,
    by_box: bool = False,
    protected: Indices | None = None,
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
    policy : Policy, optional
    """
    before = batch.face_count
    target = round(inner_target) + at_border
    if target >= before:
        return Reduced(batch, before, CollapsedComponents(), 0)
    volumes, left = None, inner_target / policy.spare
    if max_error is None and not whole and before - at_border > policy.clustered * left:
        batch, volumes = yield from clustered_steps(batch, round(policy.left_by_clusters * left) + at_border, policy)
    collapsing = CollapsingMesh(batch.mesh, max_error, policy, batch=not whole)
    if volumes is not None:
        collapsing.components.volume_before = volumes * float(collapsing.scale) ** 3
    vertices = np.flatnonzero(np.isin(batch.numbers, protected)) if protected is not None else np.empty(0, np.int64)
    collapsing.components.staying = Staying(largest_component * float(collapsing.scale) ** 3, by_box, vertices)
    yield from collapse_steps(collapsing, target, last=whole)
    if max_error is not None:
        yield from hold_bound_steps(collapsing)
    mesh, used = collapsing.used_mesh()
    original = collapsing.original_vertex[used]
    reduced = Batch(mesh, np.where(original >= 0, batch.numbers[original], NEW))
    large = reduced.numbers[collapsing.components.large[collapsing.component[used]] & (reduced.numbers != NEW)]
    collapsed = collapsing.collapsed_components
    return Reduced(reduced, before, collapsed, collapsing.handles_cut, large, collapsing.crossing_count)
