# SPDX-License-Identifier: GPL-3.0-or-later
"""A goal of simplification, and how a mesh is brought to it as a whole."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError, SettingsError
from ..machine.budget import Budget
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import Stages, Step, Steps, equal_part
from .batches.memory import held_batches, seam_vertices
from .batches.pieces import Batch
from .bounds.bounded import hold_bound_steps
from .bounds.uncrossing import uncross_steps
from .clustering import clustered_steps
from .engine.component_removal import CollapsedComponents, Staying
from .engine.edge_collapse import CollapsingMesh
from .engine.handles import handles_text
from .policy import POLICY, Policy

STAGES = {"Simplifying": 1}
BOUNDED_STAGES = {"Simplifying": 4, "Checking the error": 1}


@dataclass(frozen=True)
class Goal:
    """Goal of simplification; exactly one of the first three is not None. See `simplify`."""

    reduction: float | None = None
    target_faces: int | None = None
    max_error: float | None = None
    largest_component: float = math.inf
    policy: Policy = POLICY

    def target(self, face_count: int) -> int:
        """Return the number of triangles to leave of a count; 0 with a maximum error, which sets no number.

        Raises
        ------
        SettingsError
            Without exactly one goal, or with one outside its limits.
        """
        reduction, target_faces, max_error = self.reduction, self.target_faces, self.max_error
        goals = {"reduction": reduction, "target_faces": target_faces, "max_error": max_error}
        given = [name for name, value in goals.items() if value is not None]
        if len(given) != 1:
            what = " and ".join(given) if given else "none"
            raise SettingsError(f"give exactly one of reduction, target_faces and max_error to simplify; given: {what}")
        if reduction is not None:
            if not 0 <= reduction < 1:
                raise SettingsError(f"reduction {reduction:g} is outside [0, 1); 0.9 removes 90 % of the triangles")
            return max(1, round(face_count * (1 - reduction)))
        if target_faces is not None:
            if target_faces < 1:
                raise SettingsError(f"target_faces {target_faces} is below 1; give the number of triangles to keep")
            return target_faces
        assert max_error is not None
        if not 0 < max_error < math.inf:
            raise SettingsError(f"max_error {max_error:g} is not above 0; give a distance in the mesh's unit")
        return 0

    def sizes(self, budget: Budget) -> tuple[int, int]:
        """Return about how many triangles a batch has, and a region of the last pass."""
        if self.max_error is None:
            return max(1, budget.whole_faces // self.policy.batches), max(1, budget.whole_faces // self.policy.regions)
        return max(1, budget.whole_faces // self.policy.batches), self.most_at_once(budget)

    def most_at_once(self, budget: Budget) -> int:
        """Return up to how many triangles of a surface that goes in batches are simplified as one."""
        return budget.whole_faces if self.max_error is None else max(1, budget.whole_faces * 3 // 4)

    def most_whole(self, budget: Budget) -> float:
        """Return up to how many triangles a surface is one mesh for: simplified as a whole, or left as it is."""
        return math.inf if self.reduction == 0 else max(budget.whole_faces, self.target_faces or 0)

    def memory_needed(self, face_count: int, left: int, budget: Budget, vertex_count: int = 0, layers: int = 0) -> int:
        """Return the bytes that simplifying a number of triangles takes on one thread.

        Parameters
        ----------
        face_count : int
            Triangles that come, in pieces.
        left : int
            Triangles that stay.
        budget : Budget
        vertex_count, layers : int
            Vertices that come, and in how many layers of voxels: batches share those between two layers.
        """
        if face_count <= self.most_whole(budget):
            return budget.work_bytes + self.bytes_at_once(face_count)
        policy = self.policy
        share, border = min(1.0, policy.spare * left / face_count), self._border_faces(vertex_count, layers)
        batch, _ = self.sizes(budget)
        merges = self.max_error is None
        batches = held_batches(face_count, share, batch, layers, border, budget.whole_faces // policy.merged, merges)
        held = batches.held * policy.held_face_bytes
        simplifying = max(self.bytes_at_once(batch), batches.merged * policy.merge_face_bytes)
        most = self.most_at_once(budget)
        # The first regions are small, and the next ones come after half has gone.
        region = most if self.max_error is not None else min(max(left, batches.held // 2), most)
        # In the last pass nothing is extracted, and all triangles are there twice: as one surface, and in regions.
        return max(budget.work_bytes + held + simplifying, 2 * held + self.bytes_at_once(region))

    def has_thin_batches(self, budget: Budget, vertex_count: int, layers: int) -> bool:
        """Return whether seams keep more than half of a batch, so that memory hardly follows what is left."""
        return 2 * self._border_faces(vertex_count, layers) > self.sizes(budget)[0]

    def _border_faces(self, vertex_count: int, layers: int) -> int:
        """Return about how many triangles stay along the two seams of a batch."""
        return self.policy.seam_faces * seam_vertices(vertex_count, layers)

    def bytes_at_once(self, face_count: int) -> int:
        """Return the bytes that simplifying a number of triangles at once takes."""
        policy = self.policy
        return face_count * (policy.face_bytes if self.max_error is None else policy.bounded_face_bytes)


@dataclass(frozen=True, eq=False)
class Simplification:
    """A simplified surface, the components that were collapsed, and how many handles were cut.

    mesh : TriangleMesh
    collapsed : CollapsedComponents
        Small components that went as a whole.
    handles_cut : int
        Each cut makes the Euler number larger by two.
    self_intersections : int or None
        Pairs of triangles that cross, touch or overlap each other, as tested; simplification adds none to those of
        the surface that it is given. None where nothing was simplified, and so nothing tested.
    """

    mesh: TriangleMesh
    collapsed: CollapsedComponents
    handles_cut: int = 0
    self_intersections: int | None = None

    def message(self, target: int) -> str:
        """Return the number of triangles, why it is not `target` where that is not 0, and what else was removed."""
        count = len(self.mesh.faces)
        message = f"{count} triangles"
        if target and count > target:
            message += (
                f" instead of {target}: no further edge can be removed without moving a border, tearing or crossing "
                "the surface, or losing a component that must stay"
            )
        if self.collapsed.count:
            message += f"; {self.collapsed.sentence()}"
        if self.handles_cut:
            message += f"; {handles_text(self.handles_cut)}"
        if self.self_intersections:
            message += f"; pairs of triangles that cross each other: {self.self_intersections}"
        return message


def whole_steps(mesh: TriangleMesh, goal: Goal, budget: Budget) -> Steps[Simplification]:
    """Simplify a mesh as a whole.

    Raises
    ------
    MeshError
        If a vertex is not finite.
    MemoryLimitError
        Before the work, if it would take more memory than the budget has.
    """
    target, max_error = goal.target(len(mesh.faces)), goal.max_error
    require_finite(mesh)
    if target >= len(mesh.faces):
        return Simplification(mesh, CollapsedComponents())
    budget.require(
        goal.bytes_at_once(len(mesh.faces)),
        f"simplifying {len(mesh.faces)} triangles",
        "use a larger stride or a region",
    )
    before, policy = None, goal.policy
    if max_error is None and len(mesh.faces) > policy.clustered * target:
        batch = Batch(mesh, np.arange(len(mesh.vertices)))
        batch, before = yield from clustered_steps(batch, round(policy.left_by_clusters * target), policy)
        mesh = batch.mesh
    collapsing = CollapsingMesh(mesh, max_error, policy)
    if before is not None:
        volumes = before.volumes[before.component]
        collapsing.components.volume_before = volumes * float(collapsing.scale) ** 3
    collapsing.components.staying = Staying(goal.largest_component * float(collapsing.scale) ** 3)
    stages = Stages(STAGES if max_error is None else BOUNDED_STAGES)
    yield from stages.run("Simplifying", collapse_steps(collapsing, target))
    if max_error is not None:
        yield from stages.run("Checking the error", hold_bound_steps(collapsing))
    collapsed, crossing = collapsing.collapsed_components, collapsing.crossing_count
    simplification = Simplification(collapsing.mesh(), collapsed, collapsing.handles_cut, crossing)
    yield Step(1.0, simplification.message(target))
    return simplification


def collapse_steps(collapsing: CollapsingMesh, target: int, last: bool = True) -> Steps[None]:
    """Collapse edges and remove components until there are `target` faces, or nothing more can go.

    Where edges are left no more, components go at any cost, if this is the `last` that is done to the surface.
    """
    start, policy = collapsing.face_count, collapsing.policy
    yield from collapsing.prepare_steps()
    changed = True
    while changed:
        while (excess := collapsing.face_count - target) > 0:
            done = start - collapsing.face_count
            if not (yield from equal_part(_round_steps(collapsing, excess, last), done, start - target)):
                break
            log = collapsing.log
            if log is None or collapsing.bound is not None:
                continue  # within a maximum error crossings are undone at the end, together with what exceeds it
            if policy.far * target < collapsing.face_count < policy.test_again * log.face_count:
                yield from uncross_steps(collapsing, hold=False)
        changed = collapsing.bound is None and (yield from uncross_steps(collapsing, hold=True))


def _round_steps(collapsing: CollapsingMesh, excess: int, last: bool) -> Steps[bool]:
    """Remove at most `excess` faces in one round; return whether there was anything to try."""
    faces = collapsing.face_count
    if excess > collapsing.policy.last * faces or collapsing.poor_rounds:
        yield from collapsing.cut_handles_steps()
    excess += collapsing.face_count - faces
    if not (yield from collapsing.can_collapse_steps()):
        return last and (yield from collapsing.remove_components_steps(excess, stuck=True))
    faces = collapsing.face_count
    yield from collapsing.remove_components_steps(excess)
    excess -= faces - collapsing.face_count
    if excess > 0:
        yield from collapsing.collapse_round_steps(-(-excess // 2))
    return True


def require_finite(mesh: TriangleMesh, numbers: NDArray[np.int64] | None = None) -> None:
    """Raise a `MeshError` where a vertex is not finite; it is called by its number, which is its place by default."""
    finite = np.isfinite(mesh.vertices).all(axis=1)
    if not finite.all():
        vertex = int(np.argmin(finite))
        x, y, z = mesh.vertices[vertex].tolist()
        vertex = vertex if numbers is None else int(numbers[vertex])
        raise MeshError(f"vertex {vertex} is at ({x:g}, {y:g}, {z:g}), which is not finite; move or delete it first")
