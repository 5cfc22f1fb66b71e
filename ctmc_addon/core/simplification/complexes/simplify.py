# SPDX-License-Identifier: GPL-3.0-or-later
"""Fewer triangles for the surfaces of several labels at once: what two labels share is simplified once.

Neighbors stay identical at any rate, because a triangle is stored once. Every label stays closed and manifold; what is
promised for one surface (see `simplify`) holds for each. Lines where three labels or more meet collapse along
themselves only, and points where such lines end or branch stay where they are.

Labels that touch, and those within each other, are simplified together, so that each keeps the same share of its
triangles. A label that touches none is simplified as if it were alone, to the same bytes, unless it would then cross
another.
Garland and Heckbert 1997, doi:10.1145/258734.258849; Vivodtzev, Bonneau and Hahmann 2010, doi:10.1109/TVCG.2009.79.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...arrays import Flags, Indices
from ...machine.budget import Budget
from ...mesh.intersections import self_intersections_steps
from ...mesh.labels.label_complex import ComplexMesh, borders_of
from ...mesh.measures import component_volumes_steps
from ...mesh.topology import compacted, component_numbers_steps, component_roots_steps
from ...mesh.triangle_mesh import TriangleMesh
from ...progress import Stages, Step, Steps, finish
from ..bounds.bounded import hold_bound_steps
from ..engine.component_removal import CollapsedComponents, Staying
from ..policy import POLICY, Policy
from ..simplify import simplification_steps
from ..whole import Goal, Simplification, collapse_steps, require_finite
from .complex_rules import collapsing_complex
from .flats import Flat, on_flats
from .gaps import gaps_filled_steps
from .junctions import interfaces_of

WHOLE_MACHINE = Budget()
STAGES = {"Simplifying labels": 9, "Looking for labels that cross": 1}

Collapsed = dict[int, CollapsedComponents]


@dataclass(frozen=True, eq=False)
class ComplexSimplification:
    """A simplified complex, and the components removed.

    mesh : ComplexMesh
    full_faces, faces : mapping of int to int
        Triangles that border each label, before and after; one between two labels counts for both.
    collapsed : CollapsedComponents
        Small components that went as a whole, what touches being one.
    collapsed_of : mapping of int to CollapsedComponents
        Components that each label's own surface lost, if any; those inside a label count for both.
    handles_cut : int
    self_intersections : int or None
        Pairs of triangles that cross each other, of one label or two; None where that was not tested.
    """

    mesh: ComplexMesh
    full_faces: Mapping[int, int]
    faces: Mapping[int, int]
    collapsed: CollapsedComponents
    collapsed_of: Mapping[int, CollapsedComponents]
    handles_cut: int = 0
    self_intersections: int | None = None


@dataclass(frozen=True, eq=False)
class _Part:
    """Labels that touch: numbers of their triangles, rising, and whether it is one without neighbors and flats."""

    faces: Indices
    isolated: bool


def simplify_complex(
    mesh: ComplexMesh,
    reduction: float | None = None,
    target_faces: int | None = None,
    max_error: float | None = None,
    budget: Budget = WHOLE_MACHINE,
) -> ComplexMesh:
    """The complex with fewer triangles. Exactly one of the goals is given.

    Parameters
    ----------
    mesh : ComplexMesh
        In any unit; normals are carried along.
    reduction : float in [0, 1)
        Share of the triangles to remove; a triangle between two labels is one.
    target_faces : int, 1 or more
        Triangles to keep at most.
    max_error : float above 0
        Bound on the distance between each label's surface and what it was, both ways.
    budget : Budget, optional
        By default what the machine has. Threads and memory do not change the result.

    Returns
    -------
    ComplexMesh
        Label by label, or group by group of those that touch. As many triangles as asked, or one fewer; more only
        where collapsing more edges would break what is promised, or take more than its share from a label.

    Raises
    ------
    SettingsError
        Without exactly one goal, or with one outside its limits.
    MeshError
        If a vertex is not finite.
    MemoryLimitError
        Before the work, if it would take more memory than that.
    """
    return finish(simplify_complex_steps(mesh, reduction, target_faces, max_error, budget)).mesh


def simplify_complex_steps(
    mesh: ComplexMesh,
    reduction: float | None = None,
    target_faces: int | None = None,
    max_error: float | None = None,
    budget: Budget | None = None,
    largest_component: float = math.inf,
    policy: Policy = POLICY,
    flats: Sequence[Flat] = (),
) -> Steps[ComplexSimplification]:
    """Do what `simplify_complex` does, as steps; also return each label's triangles and lost components.

    No component goes that encloses more than `largest_component`, in the cube of the mesh's unit. What is on one of
    the `flats` stays on it.
    """
    budget = WHOLE_MACHINE if budget is None else budget
    goal = Goal(reduction, target_faces, max_error, largest_component, policy)
    full = len(mesh.faces)
    target = goal.target(full)
    require_finite(TriangleMesh(mesh.vertices, mesh.faces))
    before = _faces_of_labels(mesh)
    if target >= full:
        return ComplexSimplification(mesh, before, before, CollapsedComponents(), {})
    parts = _parts(mesh, flats)
    stages = Stages(STAGES)
    in_parts, again = STAGES
    simplified, results = yield from stages.run(in_parts, _parts_steps(mesh, parts, goal, target, budget, flats))
    crossing = sum(each.self_intersections or 0 for each, _ in results)
    if len(parts) > 1 and max_error is None:
        pairs = yield from stages.run(again, self_intersections_steps(simplified.vertices, simplified.faces))
        if len(pairs) > crossing:
            # Labels that do not touch have come to cross: simplified together they do not.
            parts = [_Part(np.arange(full), isolated=False)]
            steps = _parts_steps(mesh, parts, goal, target, budget, flats)
            simplified, results = yield from stages.run(again, steps)
            crossing = sum(each.self_intersections or 0 for each, _ in results)
    collapsed = sum((each.collapsed for each, _ in results), CollapsedComponents())
    of_labels = {label: each for _, own in results for label, each in own.items()}
    cut = sum(each.handles_cut for each, _ in results)
    tested = None if max_error is not None and len(parts) > 1 else crossing
    whole = TriangleMesh(simplified.vertices, simplified.faces)
    yield Step(1.0, Simplification(whole, collapsed, cut, tested).message(target))
    return ComplexSimplification(simplified, before, _faces_of_labels(simplified), collapsed, of_labels, cut, tested)


def _parts_steps(
    mesh: ComplexMesh, parts: list[_Part], goal: Goal, target: int, budget: Budget, flats: Sequence[Flat]
) -> Steps[tuple[ComplexMesh, list[tuple[Simplification, Collapsed]]]]:
    """Simplify each part; the largest comes last, and makes good what the rest could not remove."""
    touching = max((len(part.faces) for part in parts if not part.isolated), default=0)
    what = f"simplifying {touching} triangles of labels that touch"
    policy = goal.policy
    bytes_each = policy.complex_face_bytes if goal.max_error is None else policy.bounded_complex_face_bytes
    budget.require(bytes_each * touching, what, "use a larger stride, fewer labels or a region")
    largest = max(range(len(parts)), key=lambda number: len(parts[number].faces))
    order = [number for number in range(len(parts)) if number != largest] + [largest]
    part_results: dict[int, tuple[ComplexMesh, Simplification, Collapsed]] = {}
    left = done = 0
    for number in order:
        part = parts[number]
        own = goal
        if goal.max_error is None and number == largest:
            own = replace(goal, reduction=None, target_faces=max(1, target - left))
        elif goal.target_faces is not None:
            own = replace(goal, target_faces=max(1, round(len(part.faces) * target / len(mesh.faces))))
        steps = _part_steps(_extracted(mesh, part.faces), part.isolated, own, budget, flats)
        name = f"Simplifying labels, group {len(part_results) + 1} of {len(order)}"
        stages = Stages({"": done, name: len(part.faces), " ": len(mesh.faces) - done - len(part.faces)})
        part_results[number] = yield from stages.run(name, steps)
        left, done = left + len(part_results[number][0].faces), done + len(part.faces)
    in_order = [part_results[number] for number in range(len(parts))]
    return _joined([each[0] for each in in_order]), [each[1:] for each in in_order]


def _faces_of_labels(mesh: ComplexMesh) -> dict[int, int]:
    """Return the number of triangles that border each label, without 0."""
    labels, interface = interfaces_of(mesh.sides)
    counts = np.bincount(interface, minlength=labels.shape[1])
    return {label: int(counts[(labels == label).any(axis=0)].sum()) for label in np.unique(labels).tolist() if label}


def _part_steps(
    mesh: ComplexMesh, isolated: bool, goal: Goal, budget: Budget, flats: Sequence[Flat]
) -> Steps[tuple[ComplexMesh, Simplification, Collapsed]]:
    """Simplify labels that touch, or an isolated label; also return the components that each label lost."""
    if not isolated:
        target = goal.target(len(mesh.faces))
        filled: Collapsed = {}
        if target >= len(mesh.faces):
            return mesh, Simplification(TriangleMesh(mesh.vertices, mesh.faces), CollapsedComponents()), {}
        if goal.max_error is None:
            mesh, filled = yield from gaps_filled_steps(mesh, target, goal.largest_component, goal.policy)
        collapsing, rules = collapsing_complex(mesh, target, goal.policy, goal.max_error, flats)
        collapsing.components.staying = Staying(goal.largest_component * float(collapsing.scale) ** 3)
        yield from collapse_steps(collapsing, target)
        yield from hold_bound_steps(collapsing)
        simplified = rules.complex_mesh(collapsing)
        whole = TriangleMesh(simplified.vertices, simplified.faces, simplified.normals)
        crossing = collapsing.crossing_count
        of_labels = yield from _collapsed_steps(mesh, rules.removed_faces(collapsing, mesh.faces))
        for label, gaps in filled.items():
            of_labels[label] = of_labels.get(label, CollapsedComponents()) + gaps
        collapsed = sum(filled.values(), collapsing.collapsed_components)
        return simplified, Simplification(whole, collapsed, collapsing.handles_cut, crossing), of_labels
    label = mesh.labels[0]
    goals = goal.reduction, goal.target_faces, goal.max_error
    surface = mesh.of_label(label)
    result = yield from simplification_steps(surface, *goals, budget, goal.largest_component, goal.policy)
    sides = np.tile(np.array([label, 0], np.int32), (len(result.mesh.faces), 1))
    of_labels = {label: result.collapsed} if result.collapsed.count else {}
    return ComplexMesh(result.mesh.vertices, result.mesh.faces, sides, result.mesh.normals), result, of_labels


def _collapsed_steps(mesh: ComplexMesh, removed: Flags) -> Steps[Collapsed]:
    """Count the components of every label's own surface in the faces, (F,) bool, that were removed."""
    collapsed = {}
    for label, (faces, _, used) in borders_of(mesh.faces[removed], mesh.sides[removed]).items():
        component = yield from component_numbers_steps(faces, len(used))
        volumes = np.abs((yield from component_volumes_steps(mesh.vertices[used], faces, component)))
        collapsed[label] = CollapsedComponents(len(volumes), float(volumes.max()), math.fsum(volumes.tolist()))
    return collapsed


def _parts(mesh: ComplexMesh, flats: Sequence[Flat]) -> list[_Part]:
    """The parts of a complex that share no label and no vertex, in the order of their lowest labels."""
    flat = on_flats(flats, mesh.vertices.T) != 0 if flats else None
    labels, interface = interfaces_of(mesh.sides)
    names, number = np.unique(labels, return_inverse=True)
    larger, other = number.reshape(labels.shape).astype(np.int32)
    links = [np.stack([larger, np.where(labels[1] == 0, larger, other)], axis=1)]
    at_vertex = np.empty(len(mesh.vertices), np.int32)
    for corner in mesh.faces.T:
        at_vertex[corner] = interface
    for corner in mesh.faces.T:
        there = at_vertex[corner]
        differ = np.flatnonzero(interface != there)
        links.append(larger[np.stack([interface[differ], there[differ]], axis=1)])
    of_interface = finish(component_roots_steps(np.concatenate(links), len(names)))[larger]
    parts = []
    for lowest in np.unique(of_interface):
        own = of_interface == lowest
        faces = np.flatnonzero(own[interface])
        is_free = flat is None or not flat[mesh.faces[faces]].any()
        parts.append(_Part(faces, bool(own.sum() == 1 and labels[1, own][0] == 0 and is_free)))
    return parts


def _extracted(mesh: ComplexMesh, numbers: Indices) -> ComplexMesh:
    """These triangles, and the vertices in use."""
    if len(numbers) == len(mesh.faces):
        return mesh
    used, faces = compacted(mesh.faces[numbers], len(mesh.vertices))
    normals = None if mesh.normals is None else mesh.normals[used]
    return ComplexMesh(mesh.vertices[used], faces, mesh.sides[numbers], normals)


def _joined(meshes: list[ComplexMesh]) -> ComplexMesh:
    """All parts one after the other."""
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])[:-1]
    normals = [mesh.normals for mesh in meshes if mesh.normals is not None]
    return ComplexMesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + np.int32(start) for mesh, start in zip(meshes, starts, strict=True)]),
        np.concatenate([mesh.sides for mesh in meshes]),
        np.concatenate(normals) if normals else None,
    )
